"""Ten real and ten simulated segments side by side, from the files that `realism` leaves in its work directory.

    uv run --with numpy --with matplotlib python/eval/realism_segments.py WORK_DIR street PICTURE.png [--seed N] [--sim-only]

The picture holds real points unless `--sim-only` is given: only that one may be passed on.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

Segment = np.ndarray
LIMIT_M = 7.0


def read(path: Path) -> list[Segment]:
    """Segments as (n, 3) arrays."""
    data = path.read_bytes()
    segments, at = [], 0
    while at < len(data):
        count = int(np.frombuffer(data, "<u4", 1, at)[0])
        segments.append(np.frombuffer(data, "<f4", 3 * count, at + 4).reshape(-1, 3).astype(float))
        at += 4 + 12 * count
    return segments


def box(segment: Segment) -> tuple[float, float, float]:
    """Length, width (along the principal horizontal axes) and height."""
    flat = segment[:, :2] - segment[:, :2].mean(0)
    _, vectors = np.linalg.eigh(flat.T @ flat)
    sides = np.ptp(flat @ vectors, axis=0)
    return float(sides[1]), float(sides[0]), float(np.ptp(segment[:, 2]))


def kind(segment: Segment) -> str | None:
    """A guess at what it is, from its box alone: the same rule for both sides."""
    length, width, height = box(segment)
    fill = len(segment) / max(length, 0.5)
    if length < 1.0 and height > 1.7:
        return "upright, thin"
    if 3.0 < length < 5.2 and 1.2 < width < 2.3 and 0.9 < height < 2.1 and fill > 25:
        return "like a car"
    if length > 4.0 and width < 1.0:
        return "long, thin"
    if length < 3.0 and width > 0.7 and height < 2.2:
        return "small, round"
    if height > 2.5 and width > 1.5:
        return "large"
    return None


KINDS = ["like a car", "upright, thin", "long, thin", "small, round", "large"]


def choose(segments: list[Segment], seed: int) -> list[tuple[str, Segment]]:
    """Two of each kind, by chance."""
    rng = np.random.default_rng(seed)
    chosen = []
    for name in KINDS:
        of_kind = [s for s in segments if kind(s) == name]
        for n in rng.permutation(len(of_kind))[:2]:
            chosen.append((name, of_kind[n]))
    return chosen


def draw(ax: plt.Axes, segment: Segment, name: str) -> None:
    flat = segment - [*segment[:, :2].mean(0), segment[:, 2].min()]
    _, vectors = np.linalg.eigh(flat[:, :2].T @ flat[:, :2])
    flat[:, :2] = flat[:, :2] @ vectors[:, ::-1]
    depth = flat[:, 1]
    order = np.argsort(-depth)
    ax.scatter(*flat[order].T, c=depth[order], cmap="gray", s=3, vmin=-2.5, vmax=3.5, linewidths=0)
    reach = 0.5 * LIMIT_M
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(0, 0.6 * LIMIT_M))
    ax.set_box_aspect((1, 1, 0.6), zoom=1.5)
    ax.view_init(elev=22, azim=-62)
    ax.set_axis_off()
    ax.text2D(0.5, 0.02, f"{name}, {len(segment)} points", transform=ax.transAxes, ha="center", fontsize=7)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("name")
    parser.add_argument("picture", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sim-only", action="store_true")
    args = parser.parse_args()
    sides = ["sim"] if args.sim_only else ["real", "sim"]
    figure = plt.figure(figsize=(15, 6.4 * len(sides)), layout="constrained")
    parts = np.atleast_1d(figure.subfigures(len(sides), 1))
    for part, side in zip(parts, sides, strict=True):
        segments = read(args.work / f"{args.name}_{side}.bin")
        part.suptitle({"real": "real", "sim": "simulated"}[side])
        for n, (name, segment) in enumerate(choose(segments, args.seed)):
            draw(part.add_subplot(2, 5, n + 1, projection="3d"), segment, name)
    figure.savefig(args.picture, dpi=90)


if __name__ == "__main__":
    main()
