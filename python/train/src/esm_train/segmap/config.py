"""The TOML file of a SegMap training; unknown keys and wrong types are refused as everywhere."""

from __future__ import annotations

import dataclasses
import typing
from dataclasses import dataclass, field
from pathlib import Path

from esm_train.augment import Augmentation
from esm_train.config import DataConfig, build, read_tables, under
from esm_train.errors import TrainError


@dataclass(frozen=True)
class SegMapRun:
    """Where and how the training runs."""

    out: str = "runs/segmap"
    """Directory of checkpoints, history and curves."""
    seed: int = 0
    precision: str = "fp32"
    """fp32 or bf16."""
    threads: int = 1
    workers: int = 1
    """Processes that read, augment and fill grids; 0 does it in the training process."""
    log_every: int = 10
    checkpoint_every: int = 200


@dataclass(frozen=True)
class SegMapTraining:
    """Published: 256 passes over about 2,500 classes in batches of 64 at a rate of 1e-4."""

    classes: int = 4096
    """Objects that are told apart."""
    min_observations: int = 10
    """Live clouds that must have seen an object for it to be a class."""
    batch: int = 64
    steps: int = 10_000
    """May be changed when a training is resumed: the rate then follows the new number."""
    learning_rate: float = 1e-3
    """Falls along half a cosine."""
    learning_rate_end: float = 1e-5
    class_rate: float = 1.0
    """Factor on the rate of the classes' own weights: a class that is met a few dozen times only has to learn fast."""
    warmup_steps: int = 20
    dropout: float = 0.5
    """Of the 512 hidden numbers."""
    class_dropout: float = 0.35
    """Of the descriptor on its way to the classes."""
    reconstruction_weight: float = 200.0


@dataclass(frozen=True)
class SegMapValidation:
    """Recall on sets that are not trained on, by object."""

    map: tuple[str, ...] = ()
    live: tuple[str, ...] = ()
    every: int = 500
    max_live: int = 600
    max_map: int = 4000


@dataclass(frozen=True)
class SegMapExport:
    """Where the weights go, and what is said about them."""

    weights: str = ""
    """A .safetensors file; empty writes `segmap.safetensors` into the run's directory."""
    training_data: str = ""


@dataclass(frozen=True)
class SegMapConfig:
    """A whole training."""

    run: SegMapRun = field(default_factory=SegMapRun)
    data: DataConfig = field(default_factory=DataConfig)
    augment: Augmentation = field(default_factory=Augmentation)
    training: SegMapTraining = field(default_factory=SegMapTraining)
    validation: SegMapValidation = field(default_factory=SegMapValidation)
    export: SegMapExport = field(default_factory=SegMapExport)


def load_segmap_config(file: Path, overrides: typing.Sequence[str] = ()) -> SegMapConfig:
    """Reads a configuration; paths become absolute."""
    c: SegMapConfig = build(SegMapConfig, read_tables(file, overrides), str(file), "")
    t = c.training
    checks = [
        (t.classes >= 2, "training.classes", t.classes, "at least 2"),
        (t.min_observations >= 2, "training.min_observations", t.min_observations, "at least 2"),
        (t.batch >= 2, "training.batch", t.batch, "at least 2"),
        (t.steps >= 1, "training.steps", t.steps, "at least 1"),
        (t.learning_rate_end > 0.0, "training.learning_rate_end", t.learning_rate_end, "above 0"),
        (t.learning_rate >= t.learning_rate_end, "training.learning_rate", t.learning_rate, "at least the last rate"),
        (t.class_rate > 0.0, "training.class_rate", t.class_rate, "above 0"),
        (0.0 <= t.dropout < 1.0, "training.dropout", t.dropout, "0 to below 1"),
        (0.0 <= t.class_dropout < 1.0, "training.class_dropout", t.class_dropout, "0 to below 1"),
        (c.run.precision in ("fp32", "bf16"), "run.precision", c.run.precision, "fp32 or bf16"),
        (c.run.log_every >= 1, "run.log_every", c.run.log_every, "at least 1"),
        (c.run.checkpoint_every >= 1, "run.checkpoint_every", c.run.checkpoint_every, "at least 1"),
        (c.validation.every >= 1, "validation.every", c.validation.every, "at least 1"),
    ]
    for good, name, value, allowed in checks:
        if not good:
            raise TrainError(f"{file}: {name} = {value!r}: expected {allowed}")
    base = file.resolve().parent
    replace = dataclasses.replace
    return replace(
        c,
        run=replace(c.run, out=under(base, c.run.out)),
        data=replace(c.data, train=tuple(under(base, p) for p in c.data.train)),
        validation=replace(
            c.validation,
            map=tuple(under(base, p) for p in c.validation.map),
            live=tuple(under(base, p) for p in c.validation.live),
        ),
        export=replace(c.export, weights=under(base, c.export.weights)),
    )
