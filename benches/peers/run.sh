#!/bin/sh
# Times this workspace and its peers in turns, so that each ratio comes from one run on one machine in
# one state, and writes a dated table to benches/results/.
#
#   benches/peers/run.sh [ROUNDS] [BENCH..]     default: 3 rounds of gemm, conv, losses, nets, raster
#
# PYTHON   an interpreter with torch, scipy, deodr, trimesh and mitsuba (default: a virtual environment in target/peers, made
#          here); mitsuba looks for LLVM, which DRJIT_LIBLLVM_PATH can name
# PRIORITY a command to run the measurements under, e.g. "chrt -f 10", where other work shares the machine
set -eu
cd "$(dirname "$0")/../.."
rounds=${1:-3}
[ $# -gt 0 ] && shift
[ $# -gt 0 ] || set -- gemm conv losses nets raster
target=${CARGO_TARGET_DIR:-target}
out=$target/peers
mkdir -p "$out" benches/results

if [ -z "${PYTHON:-}" ]; then
    PYTHON=$out/python/bin/python
    if [ ! -x "$PYTHON" ]; then
        python3 -m venv "$out/python"
        "$out/python/bin/pip" install --quiet torch scipy numpy deodr trimesh mitsuba
    fi
fi

# Everything is built before anything is timed.
cargo build --quiet --release --locked --manifest-path benches/peers/rust/Cargo.toml --target-dir "$out/rust"
crates=$out/rust/release/unsphere-peers
for bench in "$@"; do
    cargo bench --quiet -p unsphere-benches --bench "$bench" --no-run
done
rm -rf "$out"/round-*.jsonl "$target/criterion"
round=1
while [ "$round" -le "$rounds" ]; do
    echo "round $round of $rounds" >&2
    ${PRIORITY:-} "$PYTHON" benches/peers/peers.py >"$out/round-$round.jsonl"
    RAYON_NUM_THREADS=1 ${PRIORITY:-} "$crates" products >>"$out/round-$round.jsonl"
    RAYON_NUM_THREADS=2 ${PRIORITY:-} "$crates" convolutions encoder neighbors rasterizer >>"$out/round-$round.jsonl"
    for bench in "$@"; do
        ${PRIORITY:-} cargo bench --quiet -p unsphere-benches --bench "$bench" -- --quiet
    done
    python3 benches/peers/table.py --round "$target/criterion" >>"$out/round-$round.jsonl"
    round=$((round + 1))
done

table=benches/results/$(date -u +%Y-%m-%d)-peers.md
python3 benches/peers/table.py "$out"/round-*.jsonl >"$table"
echo "$table" >&2
