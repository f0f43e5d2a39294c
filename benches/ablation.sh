#!/usr/bin/env bash
# What each part of the back end brings, on simulated sites: every way of searching a pose, on tuning seed 120 (how many matches a
# place must have) and then, frozen, on judging seed 200; prints Markdown tables.
#   benches/ablation.sh WORK [DESCRIPTOR ...]
# Recordings, maps and tables stay in WORK, and what is there is not made again. Hours on two cores.
set -euo pipefail
work=$(realpath -m "${1:?usage: benches/ablation.sh WORK [DESCRIPTOR ...]}")
shift
descriptors=("$@")
((${#descriptors[@]})) || descriptors=(eigen esm-swift)
cd "$(dirname "$0")/.."
cargo build --release --locked -p esm-cli
cargo build --release --locked -p esm-benches --example pose_ablation
target=${CARGO_TARGET_DIR:-target}
mkdir -p "$work"

run() { # descriptor preset seed every rate [accumulation flags]
    local descriptor=$1 preset=$2 seed=$3 every=$4 rate=$5
    shift 5
    local site=$work/$preset-$seed name=$preset-$seed-$descriptor
    local frozen=$work/wanted-$descriptor.json
    [[ -e $work/$name.md ]] && return
    [[ -e $site/live_truth.tum ]] || "$target/release/esm-cli" simulate "$preset" --seed "$seed" -o "$site"
    [[ -e $work/$name.esm ]] || "$target/release/esm-cli" map build "$site/map.mcap" --poses "$site/map_truth.tum" \
        --accumulate "$2" --descriptor "$descriptor" -o "$work/$name.esm"
    # Only networks have a quality, and distances from a ROC.
    local pruned=() use=(--frozen "$frozen")
    [[ $descriptor == esm* ]] && pruned=(--min-quality 0.2 --max-false-positive-rate "$rate")
    ((seed < 200)) && use=(--tune "$frozen")
    "$target/release/examples/pose_ablation" "$work/$name.esm" "$site/live.mcap" "$site/live_truth.tum" \
        --every "$every" "${pruned[@]}" "${use[@]}" "$@" >"$work/$name.part"
    mv "$work/$name.part" "$work/$name.md"
}

for descriptor in "${descriptors[@]}"; do
    for seed in 120 200; do
        run "$descriptor" george-square "$seed" 1 0.2 --accumulate 17 --swathes
        run "$descriptor" burgess "$seed" 2 0.2 --accumulate 22 --swathes
        run "$descriptor" kitti "$seed" 5 0.1 --accumulate 20
        run "$descriptor" cornbury "$seed" 20 0.2 --accumulate 8
    done
done
for table in "$work"/*-200-*.md; do
    printf '\n### %s\n\n' "$(basename "$table" .md)"
    cat "$table"
done
