#!/usr/bin/env bash
# Makes the table of precisions in docs/NUMERICS.md: what each costs and how far it is
# from the exact filter, in one run on the test scenes (minutes, most of them for
# `exact`).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

cargo build --release
target/release/tamis bench --precision fast standard exact --backend jit --radii 5 --rounds 3 \
    --filters bilateral cross-bilateral kan2017 tamis --output out/precision
document=docs/NUMERICS.md
{
    sed '/^<!-- precisions/q' "$document"
    cat out/precision/table.md
    sed '1,/^<!-- precisions/d' "$document" | sed -n '/^<!-- end -->$/,$p'
} > out/precision/NUMERICS.md
cp out/precision/NUMERICS.md "$document"
