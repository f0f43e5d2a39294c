#!/usr/bin/env -S uv run --script
# /// script
# requires-python = ">=3.11"
# dependencies = ["numpy>=2", "esm_py"]
# [tool.uv.sources]
# esm_py = { path = "../../crates/esm-py" }
# ///
"""A thousand clouds that must not be located: other worlds, other parts of the drive, shuffled segments. A Markdown table.

    python/eval/negatives.py ../shared/data/kitti00 --work negatives/ --esm-cli target/release/esm-cli

- **Other parts of the drive**: KITTI 00, frames more than 70 m off a map of frames 1-360.
- **Other worlds**: real clouds in simulated maps, simulated clouds in the real map, and simulated ones in the map of another
  seed of their own preset (seeds 200 and 201, judging seeds).
- **Shuffled segments**: the clouds of the KITTI query in the map of the same streets, each segment carried to the place of
  another one of its cloud (one cycle through all of them, by a seed); ground and segments stay as they are. All objects are
  there, their constellation is not.

Everything is localized without a guess, each cloud by itself and, but for the shuffled ones, with odometry too; a located
cloud is a false one. WORK takes simulations, maps and results; what is there already is not made again, so a run that was
stopped goes on. The exit code is 1 where anything was located.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# Of the drive's map recording: what is mapped, and what lies more than 70 m off that.
PART, ELSEWHERE = "1-360", "410-510,690-950,1040-1340"
# Preset: scale, metres of travel in a cloud.
WORLDS = {"kitti": (0.2, 20.0), "train-forest": (0.1, 8.0)}
SEEDS = (200, 201)


@dataclass(frozen=True)
class Case:
    """Clouds of a recording in a map where they were not taken."""

    kind: str
    name: str
    map: str
    recording: Path
    accumulate: float
    frames: str = ""


class Work:
    """The folder of simulations, maps and results."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.dir, self.kitti, self.cli = options.work, options.kitti, options.esm_cli
        self.dir.mkdir(parents=True, exist_ok=True)

    def run(self, *arguments: object, fail: bool = True) -> str:
        """Standard output of the program."""
        command = [str(self.cli), *(str(a) for a in arguments)]
        print("+", " ".join(command), file=sys.stderr, flush=True)
        done = subprocess.run(command, check=False, stdout=subprocess.PIPE, text=True)
        if done.returncode not in (0, 1) or (fail and done.returncode):
            sys.exit(f"{' '.join(command)}: exit code {done.returncode}")
        return done.stdout

    def world(self, preset: str, seed: int) -> Path:
        """A simulated world; the program itself goes on with one that is not complete."""
        folder = self.dir / f"{preset}-{seed}"
        self.run("simulate", preset, "--seed", seed, "--scale", WORLDS[preset][0], "-o", folder, "--quiet")
        return folder

    def map(self, name: str, descriptor: str) -> Path:
        """A map: `kitti00`, `kitti00-part`, or a simulated world's first visit."""
        path = self.dir / f"{name}-{descriptor}.esm"
        if path.exists():
            return path
        build = ["map", "build", "--descriptor", descriptor, "--quiet", "-o", path]
        if name.startswith("kitti00"):
            frames = ["--frames", PART] if name.endswith("-part") else []
            self.run(*build, self.kitti / "map.mcap", *frames)
        else:
            preset, seed = name.rsplit("-", 1)
            folder = self.world(preset, int(seed))
            travel = WORLDS[preset][1]
            self.run(*build, folder / "map.mcap", "--poses", folder / "map_truth.tum", "--accumulate", travel)
        return path

    def remembered(self, name: str, make: Callable[[], dict[str, int]]) -> dict[str, int]:
        """Clouds and located ones of a run; made once."""
        path = self.dir / f"{name}.json"
        if not path.exists():
            part = path.with_suffix(".part")
            part.write_text(json.dumps(make()))
            part.rename(path)
        return json.loads(path.read_text())


def cases(work: Work) -> Iterator[Case]:
    """All but the shuffled ones."""
    kitti = work.kitti
    for metres in (20.0, 0.0):
        what = f"{metres:.0f} m" if metres else "single sweeps"
        name = f"KITTI 00, frames 1-360, {what}"
        yield Case("other parts of the drive", name, "kitti00-part", kitti / "map.mcap", metres, ELSEWHERE)
    for preset, (_, metres) in WORLDS.items():
        first, second = SEEDS
        site, other = f"{preset}-{first}", f"`{preset}` {second}"
        yield Case("real clouds in a simulated map", f"`{preset}` {first}", site, kitti / "query.mcap", metres)
        live = work.world(preset, second) / "live.mcap"
        yield Case("simulated clouds in another seed's map", f"{other} in {first}", site, live, metres)
        yield Case("simulated clouds in a real map", f"{other} in KITTI 00", "kitti00", live, metres)


def localized(work: Work, case: Case, descriptor: str, single: bool) -> dict[str, int]:
    """Localizes the clouds of a case."""
    command = ["localize", "--map", work.map(case.map, descriptor), case.recording, "--accumulate", case.accumulate]
    command += ["--json", "--quiet"] + (["--frames", case.frames] if case.frames else []) + (["--single"] if single else [])
    lines = [json.loads(line) for line in work.run(*command, fail=False).splitlines()]
    verdicts = [line["verdict"] for line in lines if "verdict" in line]
    return {"clouds": len(verdicts), "located": verdicts.count("located"), "ambiguous": verdicts.count("ambiguous")}


def shuffled(work: Work, descriptor: str, seed: int) -> dict[str, int]:
    """Localizes the clouds of the KITTI query with their segments carried about."""
    import esm_py

    found_map = esm_py.Map.open(str(work.map("kitti00", descriptor)))
    config = esm_py.Config({"descriptor": descriptor, "accumulate": {"distance_m": 20.0}})
    # The shuffled cloud is taken as one sweep, with all it holds.
    one = esm_py.Config({"descriptor": descriptor, "accumulate": {"distance_m": 0.0, "max_range_m": 200.0}})
    accumulator, single = esm_py.Accumulator(config), esm_py.Accumulator(one)
    localizer, random = esm_py.Localizer(found_map, config), np.random.default_rng(seed)
    count = {"clouds": 0, "located": 0, "ambiguous": 0}
    for sweep in esm_py.Recording(str(work.kitti / "query.mcap")):
        cloud = accumulator.push_sweep(sweep)
        if cloud is None:
            continue
        cut = esm_py.segment(cloud.points, config)
        order = random.permutation(len(cut.segments))
        parts = [np.asarray(cut.ground)]
        # One cycle: none stays where it is. Heights stay.
        for k, i in enumerate(order):
            here, there = cut.segments[i], cut.segments[order[(k + 1) % len(order)]]
            step = np.asarray(there.centroid) - np.asarray(here.centroid)
            parts.append(np.asarray(here.points) + np.array([step[0], step[1], 0.0], np.float32))
        live = single.push(cloud.stamp, np.concatenate(parts), None)
        if live is None:
            continue
        answer = localizer.localize(live)
        count["clouds"] += 1
        count["located"] += answer.verdict == "located"
        count["ambiguous"] += answer.verdict == "ambiguous"
    return count


def main() -> None:
    """Runs everything and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kitti", type=Path, help="folder of map.mcap and query.mcap of KITTI 00")
    parser.add_argument("--work", type=Path, required=True, help="folder for what is made")
    parser.add_argument("--esm-cli", default="esm-cli", help="the program (esm-cli)")
    parser.add_argument("--descriptor", nargs="+", default=["esm-swift", "shape"], help="(esm-swift shape)")
    parser.add_argument("--seed", type=int, default=200, help="of the shuffling (200)")
    options = parser.parse_args()
    work, located, asked = Work(options), 0, {}

    print("| negatives | map | descriptor | | clouds | located | ambiguous |\n|---|---|---|---|--:|--:|--:|")
    for descriptor in options.descriptor:
        rows = [("shuffled segments", "KITTI 00", "each by itself", lambda d=descriptor: shuffled(work, d, options.seed))]
        for case in cases(work):
            for single in (True, False):
                how = "each by itself" if single else "with odometry"
                rows.append((case.kind, case.name, how, lambda c=case, d=descriptor, s=single: localized(work, c, d, s)))
        for kind, name, how, make in rows:
            label = "".join(c if c.isalnum() else "-" for c in f"{kind} {name} {descriptor} {how}").lower()
            count = work.remembered(label, make)
            cells = [kind, name, f"`{descriptor}`", how, *(str(count[key]) for key in ("clouds", "located", "ambiguous"))]
            print(f"| {' | '.join(cells)} |", flush=True)
            located += count["located"]
            if how == "each by itself":
                asked[descriptor] = asked.get(descriptor, 0) + count["clouds"]
    told = ", ".join(f"{count} each by itself with `{descriptor}`" for descriptor, count in asked.items())
    print(f"\n{told}: {located} located.")
    sys.exit(1 if located else 0)


if __name__ == "__main__":
    main()
