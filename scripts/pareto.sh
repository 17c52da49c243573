#!/usr/bin/env bash
# Makes the README's section "Time against error": the chart docs/pareto.svg and the
# table docs/pareto.md, in one run on the test scenes.
#
#   scripts/pareto.sh [ARGUMENTS of `tamis bench`...]
#
# clang and gcc take part if they are installed, a GPU if there is one (a software one, too), and
# Open Image Denoise if its `oidnDenoise` is on the PATH or named with --oidn.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

cargo build --release
compilers=()
for compiler in clang gcc; do
    if command -v "$compiler" > /dev/null; then compilers+=("$compiler"); fi
done
if ((${#compilers[@]})); then set -- --cc "${compilers[@]}" "$@"; fi
if target/release/tamis gpus > /dev/null 2>&1; then set -- --backend jit interp gpu "$@"; fi
target/release/tamis bench "$@"
cp out/bench/pareto.svg docs/pareto.svg
cp out/bench/table.md docs/pareto.md
