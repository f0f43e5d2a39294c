"""A small wood that is simulated once, its map, and the command line to compare with."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

import esm_py

# Machines that are busy are slow, not wrong.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")

CONFIG = esm_py.Config({"descriptor": "shape", "accumulate": {"distance_m": 8.0}, "match": {"k": 10}})
"""Clouds of 8 m find themselves in a map of 60 m."""


@dataclass(frozen=True)
class World:
    """A simulated wood, 60 m of it, and its map."""

    folder: Path
    map_file: Path
    map: esm_py.Map

    def recording(self, visit: str, *, truth: bool = False, labels: bool = False) -> esm_py.Recording:
        """One of the two visits; its motion is the odometry or the truth."""
        poses = self.folder / f"{visit}_truth.tum" if truth else None
        return esm_py.Recording(self.folder / f"{visit}.mcap", poses=poses, labels=labels)


def build(recording: esm_py.Recording, config: esm_py.Config, threads: int | None = None) -> esm_py.Map:
    """Build a map as `esm-cli map build` does."""
    builder = esm_py.MapBuilder(config, threads=threads)
    builder.set_source(recording.path.name)
    for sweep in recording:
        builder.push_sweep(sweep)
    return builder.finish()


def clouds(recording: esm_py.Recording, config: esm_py.Config, every: int = 1) -> list[esm_py.LiveCloud]:
    """The live clouds of a recording, all or every so many."""
    accumulator = esm_py.Accumulator(config)
    live = [accumulator.push_sweep(sweep) for sweep in recording]
    return [cloud for cloud in live[every - 1 :: every] if cloud is not None]


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    folder = tmp_path_factory.mktemp("wood")
    esm_py.simulate("train-forest", 101, folder, scale=0.06)
    world = World(folder, folder / "wood.esm", esm_py.Map.open(_first_map(folder)))
    assert len(world.map) > 100
    return world


def _first_map(folder: Path) -> Path:
    recording = esm_py.Recording(folder / "map.mcap", poses=folder / "map_truth.tum")
    build(recording, CONFIG).write(folder / "wood.esm")
    return folder / "wood.esm"


@pytest.fixture(scope="session")
def live(world: World) -> list[esm_py.LiveCloud]:
    """A few clouds of the second visit."""
    return clouds(world.recording("live"), CONFIG, every=24)


class Cli:
    """The command line."""

    def __init__(self, program: str) -> None:
        self.program = program

    def run(self, *arguments: str | Path, code: int = 0) -> str:
        ran = subprocess.run([self.program, *map(str, arguments)], capture_output=True, text=True, check=False)
        assert ran.returncode == code, ran.stderr
        return ran.stdout

    def lines(self, *arguments: str | Path, code: int = 0) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.run(*arguments, "--json", code=code).splitlines()]


@pytest.fixture(scope="session")
def cli() -> Cli:
    program = os.environ.get("ESM_CLI")
    if not program:
        assert os.environ.get("CI") != "true", "set ESM_CLI to the path of esm-cli"
        pytest.skip("ESM_CLI is not set: nothing is compared with the command line")
    return Cli(program)


def column(at: tuple[float, float] = (8.0, 3.0)) -> np.ndarray[Any, np.dtype[np.float32]]:
    """A floor of 20 m with a column of 2 m on it."""
    i = np.arange(10_000)
    floor = np.stack((i % 100 * 0.2, i // 100 * 0.2, 0 * i), axis=1)
    j = np.arange(360)
    stands = np.stack((at[0] + j % 6 * 0.2, at[1] + j // 6 % 6 * 0.2, j // 36 * 0.2), axis=1)
    return np.concatenate((floor, stands)).astype(np.float32)


@pytest.fixture(scope="session")
def hall() -> np.ndarray[Any, np.dtype[np.float32]]:
    return column()
