#!/usr/bin/env bash
# Makes the README's table and picture: breeds a filter with the quick preset
# (a minute on two cores) and scores it beside the named ones.
#
#   scripts/results.sh [SCENES...]
#
# SCENES are further folders with 4spp.exr and reference.exr in or below them.
# Writes out/best.toml, out/results.md and docs/courtyard.png.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

cargo build --release
tamis=target/release/tamis
"$tamis" evolve --preset quick --out out
"$tamis" score --markdown --scenes data/test "$@" \
    --filters bilateral cross-bilateral kan2017 out/best.toml tamis-1 tamis-2 > out/results.md
"$tamis" sheet data/test/courtyard -o docs/courtyard.png --filters tamis-2
cat out/results.md
