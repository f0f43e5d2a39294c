#!/usr/bin/env bash
# Simulates the worlds for learning, for tuning and for judging, and cuts them into labelled segments:
#   python/train/make-data.sh [JOBS]
# Everything goes into python/train/data (ESM_DATA names another folder), a folder of sets a kind: train/, tune/ and judge/.
# Visit 0 of a set is its map, visit 1 what is to be found in it. A set that exists is kept, so that an interrupted run goes on
# where it was. Recordings are deleted once they are cut. ESM_CLI names the program where it is not ../../target/release/esm-cli.
set -euo pipefail
cd "$(dirname "$0")"
export ESM_CLI=$(realpath "${ESM_CLI:-../../target/release/esm-cli}")
export ESM_DATA=$(realpath -m "${ESM_DATA:-data}")
jobs=${1:-$(nproc)}

# One world: KIND (train, tune or judge), preset, seed, scale, lengths of accumulation, metres between clouds.
world() {
    local kind=$1 preset=$2 seed=$3 scale=$4 lengths=$5 step=$6
    local name=$preset-$seed sim=$ESM_DATA/sim/$preset-$seed
    [[ -e $ESM_DATA/$kind/$name ]] && return
    "$ESM_CLI" simulate "$preset" --seed "$seed" --scale "$scale" --threads 1 --quiet --json -o "$sim" >"$ESM_DATA/log/$name.json"
    "$ESM_CLI" segments --quiet --threads 1 --accumulate "$lengths" --step "$step" -o "$ESM_DATA/$kind/$name" "$sim"
    rm -r "$sim"
}
export -f world

mkdir -p "$ESM_DATA"/{sim,log,train,tune,judge}
{
    # The four data sets' kinds at tuning seeds, and at judging seeds.
    for n in 0 1; do
        for kind in tune judge; do
            [[ $kind == tune ]] && seed=$((110 + n)) || seed=$((210 + n))
            echo "$kind kitti $seed 0.25 20 10"
            echo "$kind cornbury $seed 0.3 10 10"
            echo "$kind train-forest $seed 0.3 10 10"
            echo "$kind burgess $seed 0.15 22 11"
            echo "$kind george-square $seed 0.8 17 8"
        done
    done
    # Streets and woods for learning; a few of the push-broom's and of the HDL-32E's views of other worlds than the judged ones.
    for seed in $(seq 0 79); do
        echo "train train-urban $seed 0.16 20,6,0 6"
        ((seed % 2 == 0)) && echo "train train-forest $seed 0.16 10,4 5"
        ((seed % 4 == 1)) && echo "train burgess $seed 0.08 22 6"
        ((seed % 4 == 3)) && echo "train george-square $seed 0.4 17 5"
        ((seed % 4 == 2)) && echo "train cornbury $seed 0.2 10,0 6"
        true
    done
} | xargs -P "$jobs" -L 1 bash -euo pipefail -c 'world "$@"' world
echo "segments are in $ESM_DATA" >&2
