#!/usr/bin/env -S uv run --script
# /// script
# requires-python = ">=3.11"
# dependencies = ["numpy>=2", "matplotlib>=3.9", "esm_py"]
# [tool.uv.sources]
# esm_py = { path = "../../crates/esm-py" }
# ///
"""How much evidence false places have: the constants of `verify/chance.rs`, from simulated tuning worlds.

Simulate a few worlds of tuning seeds (100-199), then look for the clouds of one in the map of another, and in its own map
without the stretches within 60 m. Nothing there is right, so everything that is found is false:

    for seed in 120 122; do esm-cli simulate kitti --seed $seed --scale 0.4 -o sim/kitti-$seed; done    # and others
    python/eval/calibrate_verdict.py collect sim/kitti-120 sim/kitti-122 --accumulate 20 6 0 -o evidence.jsonl
    python/eval/calibrate_verdict.py fit evidence.jsonl --plot evidence.png

`fit` prints for each group of clouds the fall of the evidence above its 80 % quantile. The constants of the slowest one are
those of the crate: ANCHOR, SHARE, FOLD.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

MATCHES = 0.5
SHARE = 0.2
FAR_M = 60.0
LENIENT = {"min_seen": 0.0, "max_false_per_thousand": 1000.0, "max_runner_up": 1.0}


def nearest(rows: np.ndarray, stamp: float) -> np.ndarray:
    """Row of a TUM trajectory at a time."""
    return rows[np.argmin(np.abs(rows[:, 0] - stamp))]


def off(pose: np.ndarray, row: np.ndarray) -> tuple[float, float]:
    """Metres and degrees between a pose and a row of a TUM trajectory."""
    x, y, z, w = row[4:8]
    truth = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    cosine = (np.trace(truth.T @ pose[:3, :3]) - 1) / 2
    return float(np.linalg.norm(pose[:3, 3] - row[1:4])), float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def collect(options: argparse.Namespace) -> None:
    """Writes the evidence of the best place of every cloud, one JSON object a line."""
    import esm_py

    def config(travel_m: float) -> esm_py.Config:
        settings = {"descriptor": options.descriptor, "accumulate": {"distance_m": travel_m}, "verify": LENIENT}
        return esm_py.Config(settings)

    def build(folder: Path, keep: np.ndarray) -> esm_py.Map | None:
        rows = np.loadtxt(folder / "map_truth.tum")
        builder, gap = esm_py.MapBuilder(config(max(options.accumulate))), True
        for sweep in esm_py.Recording(folder / "map.mcap", poses=folder / "map_truth.tum"):
            if keep[np.argmin(np.abs(rows[:, 0] - sweep.stamp))]:
                builder.push_sweep(sweep)
                gap = False
            elif not gap:
                builder.interrupt()
                gap = True
        return builder.finish() if keep.any() else None

    with options.output.open("a") as out:
        for folder in options.worlds:
            live, mapped = np.loadtxt(folder / "live_truth.tum"), np.loadtxt(folder / "map_truth.tum")
            maps: list[tuple[str, esm_py.Map, np.ndarray]] = []
            for other in options.worlds:
                rows = np.loadtxt(other / "map_truth.tum")
                everything = np.ones(len(rows), bool)
                if other != folder:
                    maps.append(("other", build(other, everything), np.empty((0, 2))))
                    continue
                maps.append(("own", build(folder, everything), np.empty((0, 2))))
                part = np.arange(len(rows)) * 4 // len(rows)
                maps += [("without", build(folder, part != q), mapped[part != q, 1:3]) for q in range(4)]
            for travel_m in options.accumulate:
                localizers = [(how, esm_py.Localizer(m, config(travel_m)), path) for how, m, path in maps]
                accumulator, last = esm_py.Accumulator(config(travel_m)), None
                for sweep in esm_py.Recording(folder / "live.mcap"):
                    cloud = accumulator.push_sweep(sweep)
                    row = nearest(live, sweep.stamp)
                    if cloud is None or cloud.travel_m < 0.95 * travel_m:
                        continue
                    if last is not None and np.linalg.norm(row[1:4] - last) < max(travel_m / 4, 2.0):
                        continue
                    last = row[1:4]
                    for how, localizer, path in localizers:
                        if how == "without" and np.linalg.norm(path - row[1:3], axis=1).min() < FAR_M:
                            continue
                        answer = localizer.localize(cloud)
                        if answer.pose_map_sensor is None:
                            continue
                        metres, degrees = off(answer.pose_map_sensor, row)
                        line = {
                            "world": folder.name,
                            "travel_m": travel_m,
                            "right": how == "own" and metres < 2.0 and degrees < 5.0,
                            "strange": how != "own",
                            "inliers": answer.inliers,
                            "overlap": answer.overlap,
                            "seen": answer.seen,
                        }
                        out.write(json.dumps(line) + "\n")
                print(f"{folder.name} at {travel_m:g} m is done", file=sys.stderr)


def fit(options: argparse.Namespace) -> None:
    """Prints the fall of the evidence of false places, group by group, and draws it."""
    lines = [json.loads(line) for file in options.evidence for line in file.read_text().splitlines()]
    lines = [line for line in lines if line["seen"] >= 0.3 and line["inliers"] >= 1]
    overlap = np.clip([line["overlap"] for line in lines], 0.001, 0.999)
    evidence = np.log(overlap / (1 - overlap)) + MATCHES * np.log([line["inliers"] for line in lines])
    right = np.array([line["right"] for line in lines])
    strange = np.array([line["strange"] for line in lines])
    groups = np.array([f"{line['world']}, {line['travel_m']:g} m" for line in lines])
    print(f"{'group':32} {'false':>6} {'80 %':>6} {'fold':>6} {'1e-4 at':>8}")
    slowest = (-np.inf, 0.0, 0.0)
    for group in sorted(set(groups[strange])):
        values = evidence[strange & (groups == group)]
        if len(values) < 30:
            continue
        anchor = float(np.quantile(values, 1 - SHARE))
        fold = float((values[values > anchor] - anchor).mean())
        rare = anchor + fold * np.log(SHARE / 1e-4)
        slowest = max(slowest, (rare, anchor, fold))
        print(f"{group:32} {len(values):6} {anchor:6.2f} {fold:6.3f} {rare:8.2f}")
    print(f"slowest: ANCHOR {slowest[1]:.2f}, FOLD {slowest[2]:.2f}; {right.sum()} right places, of them ", end="")
    print(f"{(evidence[right] > slowest[0]).mean():.1%} with more evidence than 1 in 10,000 false ones")
    if options.plot:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot as plt

        figure, axes = plt.subplots(figsize=(8, 5))
        for kind, name, color in ((strange, "false places", "tab:red"), (right, "right places", "tab:green")):
            values = np.sort(evidence[kind])
            share = 1 - np.arange(len(values)) / len(values)
            if name == "right places":
                share = np.arange(1, len(values) + 1) / len(values)
            axes.step(values, share, color=color, label=f"{name}, {'less' if kind is right else 'more'} evidence")
        x = np.linspace(slowest[1], slowest[0] + 0.5)
        tail = SHARE * np.exp(-(x - slowest[1]) / slowest[2])
        axes.plot(x, tail, "k--", label="chance_false: the slowest fall of a world")
        axes.axvline(slowest[0], color="gray", lw=0.8, label="0.1 in a thousand")
        axes.set(yscale="log", xlabel="evidence: logit(overlap) + 0.5 ln(matches)", ylabel="share", ylim=(5e-5, 1.2))
        axes.legend()
        axes.grid(alpha=0.3)
        figure.tight_layout()
        figure.savefig(options.plot, dpi=110)


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    gather = commands.add_parser("collect")
    gather.set_defaults(call=collect)
    gather.add_argument("worlds", nargs="+", type=Path, help="folders of `esm-cli simulate`")
    gather.add_argument("--accumulate", nargs="+", type=float, default=[20.0, 6.0, 0.0], help="metres of travel")
    gather.add_argument("--descriptor", default="shape")
    gather.add_argument("-o", "--output", type=Path, required=True)
    judge = commands.add_parser("fit")
    judge.set_defaults(call=fit)
    judge.add_argument("evidence", nargs="+", type=Path)
    judge.add_argument("--plot", type=Path)
    options = parser.parse_args()
    options.call(options)


if __name__ == "__main__":
    main()
