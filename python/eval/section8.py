# /// script
# requires-python = ">=3.11"
# dependencies = ["esm_py", "numpy>=2"]
#
# [tool.uv.sources]
# esm_py = { path = "../../crates/esm-py" }
# ///
"""KITTI 00 cut into segments by a plain protocol, for judging descriptors apart from our own segmentation.

    uv run python/eval/section8.py ../shared/data/kitti00 OUT

The last 10 key frames accumulated, points within 50 m of each sensor, voxels of 0.2 m, ground = all below 0.4 m above the lowest
point of its 5 x 5 m cell, single linkage at 0.5 m, 40 to 15,000 points. OUT/map holds windows every 5th frame from 11 to 1340,
not merged, OUT/query clouds every 8th frame from 1362 to 1600; both are sets as `python/train/DATA.md` describes them:

    cd python/train
    uv run esm-train evaluate --truth position --map OUT/map --live OUT/query --weights ../../weights/esm-swift.safetensors -o REPORT
"""

import sys
from collections import deque
from pathlib import Path

import esm_py
import numpy as np

FRAMES, RANGE_M, CELL_M, ABOVE_M = 10, 50.0, 5.0, 0.4
CONFIG = esm_py.Config({"segment": {"voxel": 0.2, "tolerance": 0.5, "min_points": 40, "max_points": 15000}})


def standing(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is more than 0.4 m above the lowest point of its cell, and what is not; z up."""
    cells = np.floor(points[:, :2] / CELL_M).astype(np.int64)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    cell = cell.ravel()
    lowest = np.full(cell.max() + 1, np.inf)
    np.minimum.at(lowest, cell, points[:, 2])
    above = points[:, 2] > lowest[cell] + ABOVE_M
    return points[above], points[~above]


def segments(window: deque[tuple[np.ndarray, np.ndarray]]) -> list[esm_py.Segment]:
    """Segments of accumulated frames (points, pose_odom_sensor) in the newest sensor's frame."""
    newest = np.linalg.inv(window[-1][1])
    parts = []
    for points, pose in window:
        near = points[np.linalg.norm(points, axis=1) <= RANGE_M]
        to_newest = newest @ pose
        parts.append(near @ to_newest[:3, :3].T + to_newest[:3, 3])
    cloud, ground = standing(esm_py.voxel_filter(np.concatenate(parts), CONFIG))
    return esm_py.segments_of(cloud, esm_py.euclidean_clusters(cloud, CONFIG), ground)


def cut(recording: Path, truth: Path | None, first: int, wanted: range, target: Path, visit: int) -> None:
    """Writes the segments of the wanted frames; `first` is the number of the recording's first frame."""
    known = esm_py.read_tum(truth) if truth else None
    poses = {} if known is None or known.stamps_ns is None else dict(zip(known.stamps_ns.tolist(), known.poses, strict=True))
    window: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=FRAMES)
    with esm_py.SegmentSetWriter(target, places=["kitti00"], classes=[], voxel_m=0.2, source="section8.py") as out:
        count = 0
        for number, sweep in enumerate(esm_py.Recording(recording), first):
            window.append((sweep.points.astype(np.float64), sweep.pose_odom_sensor))
            if number not in wanted or len(window) < FRAMES:
                continue
            pose = poses[sweep.stamp_ns] if truth else sweep.pose_odom_sensor
            for segment in segments(window):
                points = segment.points.astype(np.float64)
                centroid = points.mean(axis=0)
                turned = (points - centroid) @ pose[:3, :3].T
                about = {"above_ground": segment.above_ground, "rings": segment.rings}
                place = pose[:3, :3] @ centroid + pose[:3, 3]
                out.push(turned, place, object=-1, observation=number, visit=visit, **about)
                count += 1
    print(f"{target}: {count} segments of {len(wanted)} clouds")


def main() -> None:
    """Both sets."""
    if len(sys.argv) != 3:
        sys.exit("usage: uv run python/eval/section8.py KITTI00 OUT")
    kitti, out = Path(sys.argv[1]), Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    cut(kitti / "map.mcap", None, 1, range(11, 1341, 5), out / "map", 0)
    cut(kitti / "query.mcap", kitti / "query_truth.tum", 1341, range(1362, 1601, 8), out / "query", 1)


if __name__ == "__main__":
    main()
