#!/bin/sh
# Clustering by us and by PCL, of the same points, in one run: pcl_cluster.sh RECORDING [SWEEP...]
#
# Each SWEEP (from 1) names a live cloud of 20 m of travel that ends there. Needs g++ and PCL's development files:
# apt-get install libpcl-dev, or any folder that holds an unpacked /usr of them, named by PCL_ROOT.
set -eu
recording=${1:?usage: pcl_cluster.sh RECORDING [SWEEP...]}
shift
[ $# -gt 0 ] || set -- 300 1100
root=${PCL_ROOT:-}
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

include=$(find "$root/usr/include" -maxdepth 1 -name 'pcl-*' | head -1)
lib=$root/usr/lib/$(gcc -print-multiarch)
g++ -std=c++17 -O3 -DNDEBUG -w -I"$include" -I"$root/usr/include/eigen3" -I"$root/usr/include" \
    "$here/pcl_cluster.cpp" -o "$work/pcl_cluster" -L"$lib" -Wl,-rpath-link,"$lib" \
    -lpcl_segmentation -lpcl_search -lpcl_kdtree -lpcl_common
manifest=$here/../Cargo.toml
cargo build --release --quiet --manifest-path "$manifest" --example live_objects

for sweep in "$@"; do
    ours=$(cargo run --release --quiet --manifest-path "$manifest" --example live_objects -- \
        "$recording" "$sweep" "$work/points" "$work/ours")
    pcl=$(LD_LIBRARY_PATH=$lib "$work/pcl_cluster" "$work/points" "$work/pcl" 0.5 40 15000 10)
    points=$(($(wc -c <"$work/points") / 12))
    same=different
    cmp -s "$work/ours" "$work/pcl" && same=identical
    echo "sweep $sweep: $points points; ours $ours, PCL $pcl (ms, clusters): $same"
done
