"""Small synthetic sets and the tiny network."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from esm_train.config import BatchConfig, Config, DataConfig, OptimConfig, RunConfig, ValidationConfig
from esm_train.plan import tiny_plan
from esm_train.synthetic import write_synthetic

torch.set_num_threads(1)


def needed(variable: str) -> str:
    """The program that an environment variable names; in CI it must."""
    program = os.environ.get(variable)
    if program is None:
        if os.environ.get("CI") == "true":
            pytest.fail(f"{variable} must name the program")
        pytest.skip(f"{variable} does not name the program")
    return program


@pytest.fixture(scope="session")
def sets(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Training set, and map and live set of another place."""
    root = tmp_path_factory.mktemp("sets")
    write_synthetic(root / "train", objects=60, observations=3, seed=1)
    write_synthetic(root / "map", objects=50, observations=1, seed=2, place="synthetic:2")
    write_synthetic(root / "live", objects=50, observations=1, seed=2, place="synthetic:2", visit=1)
    return {name: str(root / name) for name in ("train", "map", "live")}


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every configuration trains the tiny network."""
    monkeypatch.setattr(Config, "plan", lambda _self: tiny_plan())


@pytest.fixture
def config(sets: dict[str, str], tmp_path: Path) -> Callable[..., Config]:
    """A configuration of a few steps; `steps`, `out` and `workers` vary."""

    def make(steps: int = 6, out: str = "run", workers: int = 0) -> Config:
        return Config(
            run=RunConfig(out=str(tmp_path / out), device="cpu", threads=1, workers=workers, log_every=2),
            data=DataConfig(train=(sets["train"],)),
            batch=BatchConfig(classes=8),
            optim=OptimConfig(steps=steps, learning_rate=3e-3),
            validation=ValidationConfig(map=(sets["map"],), live=(sets["live"],), every=3),
        )

    return make
