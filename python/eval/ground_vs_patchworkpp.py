"""Ground removal beside Patchwork++ on the same SemanticKITTI scans: precision, recall, F1, time.

    cargo build --release -p esm-core --example ground_flags
    uv run --with numpy --with pypatchworkpp python/eval/ground_vs_patchworkpp.py [DATA] [--binary PATH]

DATA is a folder of `NN/000000.bin` (x y z reflectance, float32) with `NN/000000.label` (default: kitti_scans of
`$ESM_SHARED_DATA`, or of `../shared/data` beside the repository). Ground are the labels 40, 44, 48, 49, 60, 72;
0, 1, 52, 99 and vegetation, 70, are not counted. Patchwork++ runs with its own defaults, which fit this sensor
(mounted at 1.723 m); ours is told nothing about the sensor.
"""

import argparse
import os
import pathlib
import subprocess
import tempfile
import time

import numpy as np
import pypatchworkpp

GROUND = [40, 44, 48, 49, 60, 72]
NOT_COUNTED = [0, 1, 52, 70, 99]
REPOSITORY = pathlib.Path(__file__).resolve().parents[2]


def scores(flags: np.ndarray, labels: np.ndarray) -> tuple[float, float, float]:
    """Precision, recall and F1 over the counted points."""
    counted = ~np.isin(labels, NOT_COUNTED)
    truth = np.isin(labels, GROUND)[counted]
    flags = flags[counted]
    hits = np.count_nonzero(flags & truth)
    precision = hits / max(np.count_nonzero(flags), 1)
    recall = hits / max(np.count_nonzero(truth), 1)
    return precision, recall, 2 * precision * recall / max(precision + recall, 1e-9)


def ours(binary: pathlib.Path, scan: pathlib.Path) -> tuple[np.ndarray, float]:
    """One flag a point, and the milliseconds the binary reports for the ground filter alone."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "flags"
        run = subprocess.run([binary, scan, out], check=True, capture_output=True, text=True)
        return np.fromfile(out, np.uint8).astype(bool), float(run.stdout.split()[0])


def patchworkpp(points: np.ndarray) -> tuple[np.ndarray, float]:
    """One flag a point by a fresh Patchwork++ (it adapts from scan to scan), and its milliseconds."""
    filter_ = pypatchworkpp.patchworkpp(pypatchworkpp.Parameters())
    start = time.perf_counter()
    filter_.estimateGround(points)
    elapsed = (time.perf_counter() - start) * 1e3
    flags = np.zeros(len(points), bool)
    flags[np.asarray(filter_.getGroundIndices(), int)] = True
    return flags, elapsed


def main() -> None:
    shared = pathlib.Path(os.environ.get("ESM_SHARED_DATA", REPOSITORY.parent / "shared" / "data"))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="?", type=pathlib.Path, default=shared / "kitti_scans")
    parser.add_argument("--binary", type=pathlib.Path, default=REPOSITORY / "target/release/examples/ground_flags")
    args = parser.parse_args()

    rows = []
    print(f"{'scan':>4}  {'ours P':>7} {'R':>7} {'F1':>7} {'ms':>6}   {'pw++ P':>7} {'R':>7} {'F1':>7} {'ms':>6}")
    for scan in sorted(args.data.glob("*/000000.bin")):
        points = np.fromfile(scan, np.float32).reshape(-1, 4)
        labels = np.fromfile(scan.with_suffix(".label"), np.uint32) & 0xFFFF
        row = []
        for flags, elapsed in (ours(args.binary, scan), patchworkpp(points)):
            row += [*scores(flags, labels), elapsed]
        rows.append(row)
        print_row(scan.parent.name, row)
    if not rows:
        raise SystemExit(f"{args.data}: no NN/000000.bin in it\nhint: point the first argument at kitti_scans")
    print_row("mean", np.mean(rows, axis=0))


def print_row(name: str, row) -> None:
    print(f"{name:>4}  {row[0]:7.4f} {row[1]:7.4f} {row[2]:7.4f} {row[3]:6.1f}", end="   ")
    print(f"{row[4]:7.4f} {row[5]:7.4f} {row[6]:7.4f} {row[7]:6.1f}")


if __name__ == "__main__":
    main()
