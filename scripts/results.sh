#!/usr/bin/env bash
# Makes the README's tables and picture: breeds a filter with the quick preset
# (a minute on two cores) and scores it beside the named ones.
#
#   scripts/results.sh [SCENES...]
#
# SCENES are further folders with 4spp.exr and reference.exr in or below them.
# Writes out/best.toml, out/results.md and docs/courtyard.png. FLIP is judged by PyPI's
# flip-evaluator, which is installed below out/venv.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

cargo build --release
tamis=target/release/tamis
"$tamis" evolve --preset quick --out out
"$tamis" score --markdown --scenes data/test "$@" \
    --filters bilateral cross-bilateral kan2017 out/best.toml tamis-1 tamis-2 tamis-3 \
    > out/results.md
"$tamis" sheet data/test/courtyard -o docs/courtyard.png --filters tamis-3

if [[ ! -x out/venv/bin/python ]]; then
    python3 -m venv out/venv
    out/venv/bin/pip install --quiet flip-evaluator numpy OpenEXR
fi
folders=()
for scenes in data/test "$@"; do
    while IFS= read -r file; do folders+=("$(dirname "$file")"); done \
        < <(find "$scenes" -name 4spp.exr | sort)
done
filters=cross-bilateral,kan2017,out/best.toml,tamis-1,tamis-2,tamis-3
{
    echo
    out/venv/bin/python scripts/flip.py "$tamis" "$filters" "${folders[@]}"
} >> out/results.md
cat out/results.md
