#!/usr/bin/env -S uv run --script
# /// script
# requires-python = ">=3.11"
# dependencies = ["numpy>=2", "scipy>=1.14", "matplotlib>=3.9"]
# ///
"""Is the covariance honest? The normalised estimation error squared (NEES) of located clouds against exact truth.

    esm-cli simulate kitti --seed 200 -o kitti/                     # and others
    esm-cli map build kitti/map.mcap --poses kitti/map_truth.tum --accumulate 20 --descriptor esm-swift -o kitti.esm
    esm-cli localize --single --map kitti.esm kitti/live.mcap --accumulate 20 --json > kitti.jsonl
    python/eval/nees.py kitti.jsonl kitti/live_truth.tum [more.jsonl more_truth.tum]... --plot nees.png

e is the error of a pose as a right perturbation in the sensor frame (x y z rx ry rz, metres and radians), as the
covariance C is told; e' C^-1 e follows a chi-square distribution of 6 degrees of freedom where C is right, so its mean
over N independent clouds lies in [chi2(0.025, 6 N), chi2(0.975, 6 N)] / N in 95 of 100 cases. Clouds of one drive are not
independent: neighbours hold the same sweeps. So only clouds without a common sweep are counted, one for each `travel_m`
of the drive (and no two within --least metres, for single sweeps see the same things). What is left common (the season,
the map, the odometry's drift, which stays alike over some 30 m) widens the band in truth; it is not taken into account.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass
class Sample:
    """Errors (N, 6) and covariances (N, 6, 6) of the clouds that count, and the NEES of all located ones."""

    name: str
    errors: np.ndarray
    covariances: np.ndarray
    located: int

    def nees(self, axes: slice = slice(0, 6)) -> np.ndarray:
        """One value a cloud, of all axes or of a group."""
        e, c = self.errors[:, axes], self.covariances[:, axes, axes]
        return np.einsum("ni,ni->n", e, np.linalg.solve(c, e[:, :, None])[:, :, 0])


def matrix(q: np.ndarray) -> np.ndarray:
    """Rotation of a quaternion x y z w."""
    x, y, z, w = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_vector(r: np.ndarray) -> np.ndarray:
    """Axis times angle, radians; the angles here are small."""
    v = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    sine = float(np.linalg.norm(v))
    return v if sine < 1e-9 else v * (np.arcsin(min(sine, 1.0)) / sine)


def read(result: Path, truth: Path, least_m: float) -> Sample:
    """The clouds of a run that count."""
    rows = np.loadtxt(truth)
    walked = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(rows[:, 1:4], axis=0), axis=1))]
    errors, covariances, located, last = [], [], 0, -np.inf
    for text in result.read_text().splitlines():
        line = json.loads(text)
        if line.get("verdict") != "located":
            continue
        i = int(np.argmin(np.abs(rows[:, 0] - line["stamp"])))
        if abs(rows[i, 0] - line["stamp"]) > 1e-3:
            raise SystemExit(f"{truth}: no pose at {line['stamp']}\nhint: give the truth of this recording")
        located += 1
        # 5 %: swathes follow each other a little closer than their length.
        if walked[i] - last < max(0.95 * line["travel_m"], least_m):
            continue
        last = walked[i]
        r = matrix(np.array(line["pose"]["q"]))
        t = r.T @ (rows[i, 1:4] - np.array(line["pose"]["t"]))
        errors.append(np.r_[t, rotation_vector(r.T @ matrix(rows[i, 4:8]))])
        covariances.append(np.array(line["covariance"]).reshape(6, 6))
    if not errors:
        raise SystemExit(f"{result}: no located cloud\nhint: give the output of `esm-cli localize --json`")
    return Sample(result.stem, np.array(errors), np.array(covariances), located)


def report(s: Sample) -> str:
    """A row of the table."""
    n = len(s.errors)
    low, high = chi2.ppf([0.025, 0.975], 6 * n) / n
    mean = s.nees().mean()
    inside = [(s.nees(g) <= chi2.ppf(0.95, 3)).mean() for g in (slice(0, 3), slice(3, 6))]
    normalised = np.sqrt((s.errors**2 / np.diagonal(s.covariances, axis1=1, axis2=2)).mean(axis=0))
    where = "in" if low <= mean <= high else "below" if mean < low else "above"
    return (
        f"{s.name:28} {s.located:6} {n:6} {mean:6.2f}  {low:.2f}-{high:.2f} {where:>6} "
        f"{(s.nees() <= chi2.ppf(0.95, 6)).mean():6.1%} {inside[0]:6.1%} {inside[1]:6.1%}  "
        + " ".join(f"{v:5.2f}" for v in normalised)
    )


def plot(samples: list[Sample], path: Path) -> None:
    """The distribution of the NEES against what it should be, and its mean by world."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5))
    x = np.linspace(0, 25, 300)
    left.plot(x, chi2.cdf(x, 6), "k--", label="chi-square, 6 degrees of freedom")
    for s in samples:
        values = np.sort(s.nees())
        left.step(values, np.arange(1, len(values) + 1) / len(values), label=f"{s.name} ({len(values)})", where="post")
    left.set(xlim=(0, 25), ylim=(0, 1), xlabel="NEES", ylabel="share of the clouds with no more")
    left.legend(fontsize=8)
    for i, s in enumerate(samples):
        n = len(s.errors)
        low, high = chi2.ppf([0.025, 0.975], 6 * n) / n
        right.plot([i, i], [low, high], color="gray", lw=8, alpha=0.4, label="95 % band" if i == 0 else None)
        right.plot(i, s.nees().mean(), "ko", label="mean NEES" if i == 0 else None)
    right.set_xticks(range(len(samples)), [s.name for s in samples], rotation=20, ha="right", fontsize=8)
    right.set(ylabel="mean NEES", ylim=(0, None))
    right.axhline(6, color="k", lw=0.6, ls="--")
    right.legend()
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path, metavar="RESULT.jsonl TRUTH.tum", help="pairs")
    parser.add_argument("--least", type=float, default=5.0, help="metres between two clouds that count, at least")
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    if len(options.files) % 2:
        parser.error("give pairs: RESULT.jsonl TRUTH.tum")
    samples = [read(a, b, options.least) for a, b in zip(options.files[::2], options.files[1::2], strict=True)]
    print(f"{'':28} {'':6} {'':6} {'mean':>6}  {'95 %':9} {'':6} {'inside the 95 % ellipsoid':^20}  RMS error over sigma")
    groups = f"{'all':>6} {'shift':>6} {'turn':>6}"
    print(
        f"{'clouds':28} {'located':>6} {'count':>5} {'NEES':>6}  {'band':9} {'':6} {groups}  "
        + " ".join(f"{a:>5}" for a in AXES)
    )
    for s in samples:
        print(report(s))
    if len(samples) > 1:
        together = Sample(
            "together",
            np.concatenate([s.errors for s in samples]),
            np.concatenate([s.covariances for s in samples]),
            sum(s.located for s in samples),
        )
        print(report(together))
    if options.plot:
        plot(samples, options.plot)


if __name__ == "__main__":
    main()
