#!/usr/bin/env -S uv run --script
# /// script
# requires-python = ">=3.11,<3.14"
# dependencies = ["kiss-matcher==1.0.2", "map-closures==2.2.0", "mcap-ros2-support==0.6.0", "numpy==2.2.6"]
# ///
"""KISS-Matcher and MapClosures beside ours, on the same clouds, counted alike: a Markdown table.

    D=../shared/data/kitti00
    esm-cli map build --descriptor esm-swift $D/map.mcap -o kitti00.esm
    python/eval/peers_localization.py kitti00.esm $D/map.mcap $D/query.mcap $D/query_truth.tum

- **KISS-Matcher** registers two clouds and can't search a map: it is told the right place, the map's points within --radius
  metres of the true position, in the map's axes. Nothing tells it how the live cloud is turned.
- **MapClosures** searches the whole map: local maps of --window metres of travel, one every --step metres, each in the frame
  of its newest sweep, and live clouds of --window metres of travel. It answers with the number of inliers; besides its own
  threshold (more than 5) the table says how many are right at the one above which none is false (chosen on these very clouds,
  in its favour). The local maps and their features are made before time is taken.
- **Ours** searches the whole map, each cloud by itself.

KISS-Matcher and ours get live clouds of --accumulate metres of travel: points within 50 m of each sensor. Every --every-th
cloud of the query is asked for, the same of all. Localizable: within 10 m of the mapped path, and holding 95 % of
--accumulate. Right: within 2 m and 5 degrees of the truth; false: any other answer. All run on one core (--cores for more).
Time is that of the call, without putting the cloud together; besides wall time the processor's, which other work on the
machine makes no longer (ours tells wall time alone).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import numpy as np

CORRECT_M, CORRECT_DEG, NEAR_M, TRAVEL_SHARE, RANGE_M = 2.0, 5.0, 10.0, 0.95, 50.0
# A sweep is kept for later clouds only this far after the last one that was, metres: as `accumulate.min_step_m`.
MIN_STEP_M = 0.5


def pose(translation: np.ndarray, q: np.ndarray) -> np.ndarray:
    """4 x 4 from a position and a quaternion x y z w."""
    x, y, z, w = q / np.linalg.norm(q)
    out = np.eye(4)
    out[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    out[:3, 3] = translation
    return out


def off(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Metres and degrees between two poses."""
    cosine = (np.trace(truth[:3, :3].T @ found[:3, :3]) - 1) / 2
    return float(np.linalg.norm(found[:3, 3] - truth[:3, 3])), float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


@dataclass
class Drive:
    """The sweeps of a recording: stamps (seconds), points (n, 3) in the sensor frame, poses (4, 4) of the sensor."""

    stamps: list[float] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    poses: list[np.ndarray] = field(default_factory=list)

    @classmethod
    def read(cls, path: Path) -> Drive:
        """From an MCAP with one topic of PointCloud2 and one of Odometry of the same stamps."""
        from mcap_ros2.reader import read_ros2_messages

        odometry: dict[int, np.ndarray] = {}
        clouds: dict[int, np.ndarray] = {}
        for message in read_ros2_messages(str(path)):
            ros = message.ros_msg
            stamp = ros.header.stamp.sec * 1_000_000_000 + ros.header.stamp.nanosec
            if hasattr(ros, "point_step"):
                rows = np.frombuffer(ros.data, np.uint8).reshape(-1, ros.point_step)
                at = {f.name: f.offset for f in ros.fields}
                xyz = [rows[:, at[n] : at[n] + 4].copy().view(np.float32)[:, 0] for n in "xyz"]
                clouds[stamp] = np.stack(xyz, axis=1)
            else:
                p, q = ros.pose.pose.position, ros.pose.pose.orientation
                odometry[stamp] = pose(np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w]))
        drive = cls()
        for stamp in sorted(clouds.keys() & odometry.keys()):
            points = clouds[stamp]
            points = points[np.isfinite(points).all(axis=1) & (np.linalg.norm(points, axis=1) <= RANGE_M)]
            drive.stamps.append(stamp * 1e-9)
            drive.points.append(points.astype(np.float64))
            drive.poses.append(odometry[stamp])
        if not drive.stamps:
            sys.exit(f"{path}: no sweep with odometry of its stamp")
        return drive

    def travel(self) -> np.ndarray:
        """Metres of travel up to each sweep, (n,)."""
        at = np.array([p[:3, 3] for p in self.poses])
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(at, axis=0), axis=1))])

    def cloud(self, newest: int, distance_m: float) -> np.ndarray:
        """The last metres of travel in the sensor frame of the newest sweep, (n, 3)."""
        travel = self.travel()
        parts, last = [self.points[newest]], travel[newest]
        to_newest = np.linalg.inv(self.poses[newest])
        for i in range(newest - 1, -1, -1):
            if travel[newest] - travel[i] > distance_m:
                break
            if last - travel[i] >= MIN_STEP_M:
                move = to_newest @ self.poses[i]
                parts.append(self.points[i] @ move[:3, :3].T + move[:3, 3])
                last = travel[i]
        return np.concatenate(parts)


def thinned(points: np.ndarray, edge: float) -> np.ndarray:
    """One point a voxel, the first."""
    _, first = np.unique(np.floor(points / edge).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]


@dataclass
class Query:
    """A cloud that is asked for."""

    number: int
    stamp: float
    truth: np.ndarray
    localizable: bool


@dataclass
class Answer:
    """What a method said of a cloud: a pose in the map, if any, how sure it is, and what it took."""

    found: np.ndarray | None
    sure: float
    ms: float
    cpu_ms: float | None = None


class Clock:
    """Wall and processor time of a call, milliseconds."""

    def __enter__(self) -> Self:
        self.began = time.perf_counter(), time.process_time()
        return self

    def __exit__(self, *_: object) -> None:
        self.ms = 1e3 * (time.perf_counter() - self.began[0])
        self.cpu_ms = 1e3 * (time.process_time() - self.began[1])


def kiss_matcher(queries: list[Query], drive: Drive, mapped: Drive, options: argparse.Namespace) -> list[Answer]:
    """Registers each cloud with the map around its true position."""
    import kiss_matcher as km

    points = np.concatenate([p @ t[:3, :3].T + t[:3, 3] for p, t in zip(mapped.points, mapped.poses, strict=True)])
    points = thinned(points, options.voxel / 2)
    answers = []
    for query in queries:
        middle = query.truth[:3, 3]
        near = points[np.linalg.norm(points[:, :2] - middle[:2], axis=1) <= options.radius] - middle
        live = drive.cloud(query.number, options.accumulate)
        source, target = (np.ascontiguousarray(p, np.float32) for p in (live, near))
        matcher = km.KISSMatcher(km.KISSMatcherConfig(options.voxel))
        with Clock() as clock:
            solution = matcher.estimate(list(source), list(target))
        found = np.eye(4)
        found[:3, :3], found[:3, 3] = solution.rotation, np.ravel(solution.translation) + middle
        inliers = matcher.get_num_final_inliers()
        # Fewer than five are no answer by its own examples.
        answers.append(Answer(found if solution.valid and inliers >= 5 else None, inliers, clock.ms, clock.cpu_ms))
    return answers


def map_closures(queries: list[Query], drive: Drive, mapped: Drive, options: argparse.Namespace) -> list[Answer]:
    """Looks for each cloud among the local maps of the whole map."""
    from map_closures.config import MapClosuresConfig
    from map_closures.map_closures import MapClosures

    config = MapClosuresConfig()
    closures, travel = MapClosures(config), mapped.travel()
    windows: list[int] = []
    for i, metres in enumerate(travel):
        if not windows or metres - travel[windows[-1]] >= options.step:
            local = thinned(mapped.cloud(i, options.window), config.density_map_resolution)
            closures.get_closures(len(windows), local)
            windows.append(i)
    print(f"MapClosures: {len(windows)} local maps", file=sys.stderr)
    answers = []
    for k, query in enumerate(queries):
        live = thinned(drive.cloud(query.number, options.window), config.density_map_resolution)
        # It adds what it is asked for to its map; far enough in number to be compared with all local maps, and what
        # resembles an earlier query is passed over.
        with Clock() as clock:
            found = closures.get_closures(len(windows) + 10 * (k + 1), live)
        ours = [c for c in found if c.source_id < len(windows)]
        best = max(ours, key=lambda c: c.number_of_inliers, default=None)
        if best is None:
            answers.append(Answer(None, 0, clock.ms, clock.cpu_ms))
            continue
        # The pose takes the local map of the source to the query's.
        at = mapped.poses[windows[best.source_id]] @ np.linalg.inv(np.asarray(best.pose))
        answers.append(Answer(at, best.number_of_inliers, clock.ms, clock.cpu_ms))
    return answers


def ours(queries: list[Query], options: argparse.Namespace) -> list[Answer]:
    """Each cloud by itself in the whole map, by the command line."""
    command = [options.esm_cli, "localize", "--map", options.esm_map, options.query, "--single", "--json"]
    command += ["--accumulate", str(options.accumulate), "--threads", str(options.cores), "--quiet"]
    done = subprocess.run([str(c) for c in command], check=False, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(done.stderr)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    by_stamp = {round(line["stamp"], 3): line for line in lines if "verdict" in line}
    answers = []
    for query in queries:
        line = by_stamp[round(query.stamp, 3)]
        found = None
        if line["verdict"] == "located":
            found = pose(np.array(line["pose"]["t"]), np.array(line["pose"]["q"]))
        answers.append(Answer(found, line["score"], line["timings_ms"]["total"]))
    return answers


def row(name: str, told: str, queries: list[Query], answers: list[Answer], more_than: float = -1.0) -> str:
    """One line of the table; answers of less than this count as none."""
    right, false, errors = 0, 0, []
    for query, answer in zip(queries, answers, strict=True):
        if answer.found is None or answer.sure <= more_than:
            continue
        metres, degrees = off(answer.found, query.truth)
        if metres <= CORRECT_M and degrees <= CORRECT_DEG:
            right += query.localizable
            errors.append((metres, degrees))
        else:
            false += 1
    localizable = sum(q.localizable for q in queries)
    middle = "{:.2f} m, {:.2f}°".format(*np.median(np.array(errors), axis=0)) if errors else ""
    ms = np.median([a.ms for a in answers])
    times = [a.cpu_ms for a in answers if a.cpu_ms is not None]
    cpu = f"{np.median(times):.0f}" if times else ""
    share = 100 * right / max(localizable, 1)
    cells = [
        name,
        told,
        len(queries),
        localizable,
        right + false,
        f"{right} ({share:.1f} %)",
        false,
        middle,
        f"{ms:.0f}",
        cpu,
    ]
    return "| " + " | ".join(str(c) for c in cells) + " |"


def highest_false(queries: list[Query], answers: list[Answer]) -> float:
    """How sure the surest false answer is."""
    wrong = []
    for query, answer in zip(queries, answers, strict=True):
        if answer.found is not None:
            metres, degrees = off(answer.found, query.truth)
            if metres > CORRECT_M or degrees > CORRECT_DEG:
                wrong.append(answer.sure)
    return max(wrong, default=-1.0)


def main() -> None:
    """Runs the methods and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("esm_map", type=Path, help="our map of the same recording")
    parser.add_argument("map", type=Path, help="recording of the map: its odometry is the map frame")
    parser.add_argument("query", type=Path, help="recording to be localized")
    parser.add_argument("truth", type=Path, help="its poses in the map frame (TUM)")
    parser.add_argument("--esm-cli", default="esm-cli", help="our program (esm-cli)")
    parser.add_argument("--every", type=int, default=1, help="ask for every n-th cloud (1)")
    parser.add_argument("--accumulate", type=float, default=20.0, help="metres of travel in a live cloud (20)")
    parser.add_argument("--radius", type=float, default=50.0, help="KISS-Matcher: metres of map around the place (50)")
    parser.add_argument("--voxel", type=float, default=0.3, help="KISS-Matcher: its voxel, metres (0.3, its default)")
    parser.add_argument("--window", type=float, default=50.0, help="MapClosures: metres of travel in a local map (50)")
    parser.add_argument("--step", type=float, default=10.0, help="MapClosures: metres between local maps (10)")
    parser.add_argument("--cores", type=int, default=1, help="cores that each may use (1)")
    parser.add_argument("--only", choices=["kiss-matcher", "map-closures", "ours"], nargs="+", help="these alone")
    options = parser.parse_args()

    # Before the libraries count the cores.
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.cores])
    mapped, drive = Drive.read(options.map), Drive.read(options.query)
    path = np.array([p[:3, 3] for p in mapped.poses])
    truth = np.loadtxt(options.truth)
    travel, queries = drive.travel(), []
    for i in range(options.every - 1, len(drive.stamps), options.every):
        nearest = truth[np.argmin(np.abs(truth[:, 0] - drive.stamps[i]))]
        if abs(nearest[0] - drive.stamps[i]) > 0.01:
            continue
        true = pose(nearest[1:4], nearest[4:8])
        near = np.linalg.norm(path - true[:3, 3], axis=1).min() <= NEAR_M
        whole = travel[i] >= TRAVEL_SHARE * options.accumulate
        queries.append(Query(i, drive.stamps[i], true, bool(near and whole)))

    print("| method | told | clouds | localizable | answers | right | false | median error | ms, median | of the processor |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    wanted = options.only or ["kiss-matcher", "map-closures", "ours"]
    if "kiss-matcher" in wanted:
        answers = kiss_matcher(queries, drive, mapped, options)
        print(row("KISS-Matcher 1.0.2", "the place", queries, answers), flush=True)
    if "map-closures" in wanted:
        answers = map_closures(queries, drive, mapped, options)
        print(row("MapClosures 2.2.0", "nothing", queries, answers, 5), flush=True)
        least = max(highest_false(queries, answers), 5)
        print(row(f"the same, more than {least:.0f} inliers", "nothing", queries, answers, least), flush=True)
    if "ours" in wanted:
        print(row("ours, each cloud by itself", "nothing", queries, ours(queries, options)), flush=True)


if __name__ == "__main__":
    main()
