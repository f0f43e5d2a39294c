"""Makes small recordings with the simulator: `$ESM_SIMULATE`, or the crate's example by cargo."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

REPO = Path(__file__).resolve().parents[3]
# Preset, share of its length, lasers, seconds of a sweep: a wood with points at their own times, and streets.
SMALL = [("train-forest", 0.006, 16, 0.1), ("train-urban", 0.006, 64, 0.1), ("burgess", 0.005, 1, 0.015)]


class Simulated(NamedTuple):
    """A simulated data set and what must be true of it."""

    folder: Path
    lasers: int
    sweep_s: float


def simulator() -> list[str]:
    """Tell the command that simulates."""
    if given := os.environ.get("ESM_SIMULATE"):
        return [given]
    return ["cargo", "run", "--quiet", "--locked", "-p", "esm-sim", "--example", "simulate", "--"]


@pytest.fixture(scope="session", params=SMALL, ids=[small[0] for small in SMALL])
def simulated(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """Simulate a preset once for all tests."""
    preset, scale, lasers, sweep_s = request.param
    folder = tmp_path_factory.mktemp(preset)
    command = [*simulator(), preset, "7", str(scale), str(folder)]
    subprocess.run(command, check=True, cwd=REPO, capture_output=True)  # noqa: S603
    return Simulated(folder, lasers, sweep_s)


@pytest.fixture(params=["map", "live"])
def visit(request: pytest.FixtureRequest) -> str:
    """Name one of the two visits of a data set."""
    name = request.param
    assert isinstance(name, str)
    return name
