#!/usr/bin/env bash
# Makes the tables of errors and the README's picture: breeds a filter with the quick preset
# (two to three minutes on two cores) and scores it beside the named ones.
#
#   scripts/results.sh [SCENES...]
#
# SCENES are further folders with 4spp.exr and reference.exr in or below them; OIDN in the
# environment is the program oidnDenoise, to be compared with.
# Writes out/best.toml, out/results.md and docs/courtyard.png. FLIP is judged by PyPI's
# flip-evaluator, which is installed below out/venv.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

cargo build --release
tamis=target/release/tamis
"$tamis" evolve --preset quick --out out --overwrite
"$tamis" score --markdown --scenes data/test "$@" \
    --filters bilateral cross-bilateral kan2017 out/best.toml tamis-formula tamis-fast tamis \
    > out/results.md
"$tamis" sheet data/test/courtyard -o docs/courtyard.png --filters tamis

if [[ ! -x out/venv/bin/python ]]; then
    python3 -m venv out/venv
    out/venv/bin/pip install --quiet flip-evaluator numpy OpenEXR
fi
oidn=()
if [[ -n ${OIDN:-} ]]; then oidn=(--oidn "$OIDN"); fi
{
    echo
    out/venv/bin/python scripts/standing.py errors "$tamis" --scenes data/test "$@" "${oidn[@]}" \
        --filters cross-bilateral kan2017 tamis-formula tamis-fast tamis
    echo
    out/venv/bin/python scripts/standing.py cleaner "$tamis" --scenes data/test \
        --filters tamis-formula tamis-fast tamis "${oidn[@]}" --qualities balanced
} >> out/results.md
cat out/results.md
