"""Checkpoints: everything a training needs to go on to the bit, written to a temporary name and renamed."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from esm_train.config import Config
from esm_train.errors import TrainError
from esm_train.model import EsmNet, QualityHead
from esm_train.plan import Plan, XConvSpec

VERSION = 1


def atomically(file: Path, write: Callable[[Path], None]) -> None:
    """Calls `write` with a temporary name in the same directory, syncs, renames."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    try:
        write(part)
        # Some writers make files for their owner alone; these are meant to be read.
        umask = os.umask(0)
        os.umask(umask)
        part.chmod(0o666 & ~umask)
        with part.open("rb+") as handle:
            os.fsync(handle.fileno())
        part.rename(file)
    finally:
        part.unlink(missing_ok=True)


def plan_as_dict(plan: Plan) -> dict[str, Any]:
    """Plain values, as checkpoints hold them."""
    return dataclasses.asdict(plan)


def plan_from_dict(raw: dict[str, Any]) -> Plan:
    """The plan that `plan_as_dict` took apart."""
    values = dict(raw)
    values["layers"] = tuple(XConvSpec(**layer) for layer in values["layers"])
    return Plan(**values)


def save_checkpoint(
    file: Path,
    *,
    model: EsmNet,
    step: int,
    history: list[dict[str, float]],
    config: Config,
    optimizer: torch.optim.Optimizer | None = None,
) -> None:
    """Writes network, optimiser, step, history and configuration."""
    state = {
        "format": "esm-checkpoint",
        "format_version": VERSION,
        "plan": plan_as_dict(model.plan),
        "model": model.state_dict(),
        "optimizer": None if optimizer is None else optimizer.state_dict(),
        "step": step,
        "history": history,
        "config": dataclasses.asdict(config),
    }
    atomically(file, lambda part: torch.save(state, part))


def load_checkpoint(file: Path) -> dict[str, Any]:
    """The state that `save_checkpoint` wrote; tensors on the CPU."""
    try:
        state = torch.load(file, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise TrainError(f"{file}: no such checkpoint", "train first, or leave --resume away") from None
    except Exception as error:  # torch.load raises a dozen kinds for damaged files
        raise TrainError(f"{file}: cannot be read: {type(error).__name__}: {error}") from None
    if not isinstance(state, dict) or state.get("format") != "esm-checkpoint":
        raise TrainError(f"{file}: no checkpoint of esm-train")
    if state.get("format_version") != VERSION:
        raise TrainError(f"{file}: checkpoint version {state.get('format_version')!r}, this program reads {VERSION}")
    return state


def model_of(state: dict[str, Any]) -> EsmNet:
    """The network of a checkpoint."""
    model = EsmNet(plan_from_dict(state["plan"]))
    model.load_state_dict(state["model"])
    return model


def quality_state(head: QualityHead, facts: dict[str, float]) -> dict[str, Any]:
    """What `quality.pt` holds."""
    return {"head": head.state_dict(), "temperature": head.temperature, "facts": facts}
