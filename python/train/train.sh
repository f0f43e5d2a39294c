#!/usr/bin/env bash
# Everything from nothing: the worlds, the labelled segments, the networks, the weights in ../../weights and their golden
# activations:
#   python/train/train.sh
# Worlds and segments take some hours on two cores, the networks two more. What was interrupted goes on when it is called again.
set -euo pipefail
cd "$(dirname "$0")"
if [[ -z ${ESM_CLI:-} ]]; then
    (cd ../.. && cargo build --release --locked -p esm-cli)
fi
./make-data.sh

export OMP_NUM_THREADS=1
# One process a core: two threads in one process are slower.
train() {
    local resume=()
    [[ -e runs/$1/latest.pt ]] && resume=(--resume)
    uv run torchrun --standalone --nproc-per-node "$(nproc)" -m esm_train "$2" --config "configs/$1.toml" "${resume[@]}"
}
golden() {
    uv run esm-train golden --segments 12 --weights "../../weights/$1.safetensors" -o "../../weights/golden/$1.safetensors"
}
train start train
for network in esm-swift esm; do
    train "$network" run
    golden "$network"
done
train esm-paper-start train
train esm-paper run
golden esm-paper
