"""One TOML file describes a training; unknown keys and wrong types are refused.

`esm-train config` prints the defaults with their meanings.
"""

from __future__ import annotations

import dataclasses
import tomllib
import types
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from esm_train.augment import Augmentation
from esm_train.errors import TrainError
from esm_train.plan import ABOVE_GROUND, SIZE_FEATURES, SIZE_MODES, VARIANTS, Plan, plan_for


@dataclass(frozen=True)
class RunConfig:
    """Where and how the training runs; nothing here changes its result but `seed` and `precision`."""

    out: str = "runs/esm-swift"
    """Directory of checkpoints, logs and pictures."""
    seed: int = 0
    device: str = "auto"
    """auto, cpu or cuda."""
    precision: str = "fp32"
    """fp32, or bf16: mixed precision, faster where the processor has it."""
    threads: int = 0
    """Threads of PyTorch; 0 leaves its default."""
    workers: int = 2
    """Processes that read and augment; 0 does it in the training process."""
    log_every: int = 10
    """Steps between lines in the log."""
    checkpoint_every: int = 500
    """Steps between checkpoints."""


@dataclass(frozen=True)
class NetworkConfig:
    """What is trained."""

    variant: str = "esm-swift"
    """esm-paper, esm or esm-swift."""
    points: tuple[int, ...] = ()
    """Points each X-conv keeps; empty takes the variant's."""
    learned_dim: int = 16
    turned: str = ""
    """yes: segments are turned about the up axis into a pose of their own before they enter; no: as they are met, as
    the paper has it; empty takes the variant's."""
    size_mode: str = ""
    """none, beside, fc or both; empty takes the variant's."""
    above_ground: bool = True
    """A seventh size: the height above ground."""
    context: str = ""
    """yes: the network knows what stands around a segment; no: it sees the segment alone; empty takes the variant's."""
    size_weight: float = 0.5
    """Starting value of the learned weights of the sizes: at first they lead, and the untrained numbers add little."""
    gain: float = 0.1
    """Factor on the first weights of the last layer: 0.1 starts distances near the margin 0.01, 0.5 near 1."""
    dropout: float = 0.5
    init_from: str = ""
    """A checkpoint or a weights file (`.safetensors`) whose weights of equal shape are the start; empty: random."""


@dataclass(frozen=True)
class DataConfig:
    """Directories in the format of DATA.md, or directories of such, relative to the configuration file."""

    train: tuple[str, ...] = ()
    size_statistics: int = 20_000
    """Segments from which the mean and deviation of sizes and context are taken."""


@dataclass(frozen=True)
class BatchConfig:
    """Composition of a batch; on several processes each has a batch of this size."""

    classes: int = 128
    per_class: int = 2
    across_visits: float = 0.5
    """How often a pair is looked for across visits, where the object has several."""
    alike_fullness: float = 0.8
    """How often the rows of an object are chosen to hold about as many points each: a single sweep's few and a full
    cloud's many rarely show the same."""
    places: int = 0
    """Places that the objects of a batch come from: of few, neighbours compete as they do in a map; 0: all."""
    hard_fraction: float = 0.0
    """Share of the batch drawn in groups of objects alike in class and size."""
    hard_group: int = 8
    """Objects a group."""
    hard_tolerance: float = 0.2
    """Height and both horizontal extents of a group differ by less than this share."""


@dataclass(frozen=True)
class LossConfig:
    """L = triplet + pair_weight * pair, both means."""

    kind: str = "triplet"
    """triplet (the paper's ratio), or a softmax over the batch: of -D / temperature (softmax) or -power log(D + margin)
    (power), which like the paper's ratio forgives pairs that look nothing alike."""
    mining: str = "all"
    """all: mean over all valid triplets of the batch; active: over those above zero; hard: the nearest negative."""
    learned_share: float = 0.0
    """Share of the loss that the learned numbers bear alone, where sizes stand beside them."""
    margin: float = 0.01
    pair_weight: float = 1.0
    temperature: float = 0.1
    """Of the softmax loss."""
    power: float = 3.0
    """Of the power loss."""


@dataclass(frozen=True)
class OptimConfig:
    """Adam with an exponentially falling rate."""

    steps: int = 20_000
    learning_rate: float = 1e-3
    learning_rate_end: float = 1e-6
    warmup_steps: int = 0
    weight_decay: float = 2e-6
    """Coupled: the gradient of 1e-6 |w|^2."""
    clip_norm: float = 0.0
    """Largest norm of the gradient; 0 does not clip."""


@dataclass(frozen=True)
class HeadConfig:
    """The last layers, trained anew on the frozen X-conv layers, with batches in which thousands of objects compete."""

    steps: int = 0
    """0: leave them as the training made them."""
    classes: int = 1024
    places: int = 8
    most_segments: int = 300_000
    """Segments whose shape numbers are held in memory."""
    learning_rate: float = 1e-3
    learning_rate_end: float = 1e-5
    dropout: float = 0.1


@dataclass(frozen=True)
class ValidationConfig:
    """Recall of the true counterpart on sets that are not trained on; DIR@0 is the first visit of the sets of DIR."""

    map: tuple[str, ...] = ()
    live: tuple[str, ...] = ()
    every: int = 500
    max_live: int = 2000
    """Live segments judged at most, the first ones in a fixed random order."""
    max_map: int = 20_000
    """Map segments at most, all counterparts among them."""
    stop_when_converged: bool = False
    """End once recall@25 gained less than a point in the last quarter of the training so far."""
    min_steps: int = 2000
    """Steps before that may happen."""


@dataclass(frozen=True)
class QualityConfig:
    """The quality head, trained on the frozen descriptor after the network."""

    map: tuple[str, ...] = ()
    live: tuple[str, ...] = ()
    """Sets of the dictionary and of the segments judged by it; empty takes those of the validation."""
    max_live: int = 20_000


@dataclass(frozen=True)
class ExportConfig:
    """Where the weights go, and what is said about them."""

    weights: str = ""
    """A .safetensors file; empty writes `weights.safetensors` into the run's directory."""
    balance: bool = True
    """Choose on the sets of [quality] how much the learned numbers weigh against the sizes beside them."""
    training_data: str = ""
    """One line for the model card: which worlds, how many segments."""


@dataclass(frozen=True)
class Config:
    """A whole training."""

    run: RunConfig = field(default_factory=RunConfig)
    network: NetworkConfig = field(default_factory=NetworkConfig)
    data: DataConfig = field(default_factory=DataConfig)
    batch: BatchConfig = field(default_factory=BatchConfig)
    augment: Augmentation = field(default_factory=Augmentation)
    loss: LossConfig = field(default_factory=LossConfig)
    optim: OptimConfig = field(default_factory=OptimConfig)
    head: HeadConfig = field(default_factory=HeadConfig)
    validation: ValidationConfig = field(default_factory=ValidationConfig)
    quality: QualityConfig = field(default_factory=QualityConfig)
    export: ExportConfig = field(default_factory=ExportConfig)

    def plan(self) -> Plan:
        """The network's plan."""
        n = self.network
        features = (*SIZE_FEATURES, ABOVE_GROUND) if n.above_ground else SIZE_FEATURES
        try:
            return plan_for(
                n.variant,
                points=n.points or None,
                size_mode=n.size_mode or None,
                size_features=features,
                learned_dim=n.learned_dim,
                turned={"": None, "yes": True, "no": False}[n.turned],
                context={"": None, "yes": True, "no": False}[n.context],
            )
        except ValueError as error:
            raise TrainError(f"[network]: {error}") from None


def read_tables(file: Path, overrides: typing.Sequence[str] = ()) -> dict[str, Any]:
    """The tables of a TOML file; `overrides` are `section.key=value` in TOML's notation."""
    try:
        raw = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise TrainError(f"{file}: {error}") from None
    for text in overrides:
        name, equals, value = text.partition("=")
        section, dot, key = name.strip().partition(".")
        if not equals or not dot:
            raise TrainError(f"--set {text}: expected section.key=value")
        try:
            parsed = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            parsed = value
        raw.setdefault(section, {})[key] = parsed
    return raw


def load_config(file: Path, overrides: typing.Sequence[str] = ()) -> Config:
    """Reads a configuration; `overrides` are `section.key=value` in TOML's notation. Paths become absolute."""
    config: Config = build(Config, read_tables(file, overrides), str(file), "")
    _check(config, file)
    return _absolute(config, file.resolve().parent)


def build(kind: Any, raw: Any, file: str, where: str) -> Any:
    """The dataclass `kind` from the tables of a file; unknown keys and wrong types are refused."""
    if not isinstance(raw, dict):
        raise TrainError(f"{file}: {where or 'the file'} is no table")
    hints = typing.get_type_hints(kind)
    for key in raw:
        if key not in hints:
            raise TrainError(
                f"{file}: unknown key {(where + '.' if where else '') + key}", f"known: {', '.join(sorted(hints))}"
            )
    values: dict[str, Any] = {}
    for key, value in raw.items():
        name = f"{where}.{key}" if where else key
        if dataclasses.is_dataclass(hints[key]):
            values[key] = build(hints[key], value, file, name)
        else:
            values[key] = _value(hints[key], value, file, name)
    return kind(**values)


def _value(hint: Any, value: Any, file: str, name: str) -> Any:
    if isinstance(hint, types.GenericAlias):
        (element, *_) = typing.get_args(hint)
        if not isinstance(value, list):
            raise TrainError(f"{file}: {name} = {value!r}: expected a list")
        return tuple(_value(element, v, file, name) for v in value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, hint) or (hint is not bool and isinstance(value, bool)):
        raise TrainError(f"{file}: {name} = {value!r}: expected {hint.__name__}")
    return value


def _check(config: Config, file: Path) -> None:
    def need(good: bool, name: str, value: object, allowed: str) -> None:
        if not good:
            raise TrainError(f"{file}: {name} = {value!r}: expected {allowed}")

    c = config
    need(c.run.device in ("auto", "cpu", "cuda"), "run.device", c.run.device, "auto, cpu or cuda")
    need(c.run.precision in ("fp32", "bf16"), "run.precision", c.run.precision, "fp32 or bf16")
    need(c.network.variant in VARIANTS, "network.variant", c.network.variant, " or ".join(VARIANTS))
    modes = ("", *SIZE_MODES)
    need(c.network.size_mode in modes, "network.size_mode", c.network.size_mode, "none, beside, fc or both")
    need(0.0 <= c.network.dropout < 1.0, "network.dropout", c.network.dropout, "0 to below 1")
    need(c.network.size_weight > 0.0, "network.size_weight", c.network.size_weight, "a positive number")
    need(c.network.turned in ("", "yes", "no"), "network.turned", c.network.turned, "yes or no")
    need(c.network.context in ("", "yes", "no"), "network.context", c.network.context, "yes or no")
    need(c.network.gain > 0.0, "network.gain", c.network.gain, "a positive number")
    need(1 <= c.network.learned_dim <= 64, "network.learned_dim", c.network.learned_dim, "1 to 64")
    need(c.batch.classes >= 2, "batch.classes", c.batch.classes, "at least 2")
    need(c.batch.per_class >= 2, "batch.per_class", c.batch.per_class, "at least 2")
    need(0.0 <= c.batch.hard_fraction <= 1.0, "batch.hard_fraction", c.batch.hard_fraction, "0 to 1")
    need(c.batch.places >= 0, "batch.places", c.batch.places, "0 or more")
    need(0.0 <= c.head.dropout < 1.0, "head.dropout", c.head.dropout, "0 to below 1")
    need(c.head.classes >= 2, "head.classes", c.head.classes, "at least 2")
    need(c.batch.hard_group >= 2, "batch.hard_group", c.batch.hard_group, "at least 2")
    need(c.loss.kind in ("triplet", "softmax", "power"), "loss.kind", c.loss.kind, "triplet, softmax or power")
    need(c.loss.power > 0.0, "loss.power", c.loss.power, "a positive number")
    need(c.loss.mining in ("all", "active", "hard"), "loss.mining", c.loss.mining, "all, active or hard")
    need(0.0 <= c.loss.learned_share <= 1.0, "loss.learned_share", c.loss.learned_share, "0 to 1")
    need(c.loss.margin > 0.0, "loss.margin", c.loss.margin, "a positive number")
    need(c.optim.steps >= 1, "optim.steps", c.optim.steps, "at least 1")
    need(c.optim.learning_rate > 0.0, "optim.learning_rate", c.optim.learning_rate, "a positive number")
    need(0.0 < c.augment.partial_keep <= 1.0, "augment.partial_keep", c.augment.partial_keep, "above 0, at most 1")
    need(0.0 < c.augment.dropout_keep <= 1.0, "augment.dropout_keep", c.augment.dropout_keep, "above 0, at most 1")
    for name in ("log_every", "checkpoint_every"):
        need(getattr(c.run, name) >= 1, f"run.{name}", getattr(c.run, name), "at least 1")
    need(c.validation.every >= 1, "validation.every", c.validation.every, "at least 1")


def under(base: Path, path: str) -> str:
    """A path of the configuration in `base`, made absolute; empty stays empty."""
    return str(base / path) if path else path


def _absolute(config: Config, base: Path) -> Config:
    def join(path: str) -> str:
        return under(base, path)

    def joined(paths: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(join(p) for p in paths)

    c = config
    replace = dataclasses.replace
    return replace(
        c,
        run=replace(c.run, out=join(c.run.out)),
        network=replace(c.network, init_from=join(c.network.init_from)),
        data=replace(c.data, train=joined(c.data.train)),
        validation=replace(c.validation, map=joined(c.validation.map), live=joined(c.validation.live)),
        quality=replace(c.quality, map=joined(c.quality.map), live=joined(c.quality.live)),
        export=replace(c.export, weights=join(c.export.weights)),
    )


def defaults_as_toml() -> str:
    """All settings with their defaults and meanings."""
    lines: list[str] = []
    default = Config()
    for section in dataclasses.fields(Config):
        values = getattr(default, section.name)
        lines += [f"# {(values.__doc__ or '').strip().splitlines()[0]}", f"[{section.name}]"]
        comments = _field_comments(type(values))
        for entry in dataclasses.fields(values):
            lines += [f"# {line}" for line in comments.get(entry.name, [])]
            lines.append(f"{entry.name} = {_toml(getattr(values, entry.name))}")
        lines.append("")
    return "\n".join(lines)


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _field_comments(kind: type) -> dict[str, list[str]]:
    """The strings under the fields, which the editor shows too, taken from the source."""
    import ast
    import inspect
    import textwrap

    (node,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(node, ast.ClassDef)
    comments: dict[str, list[str]] = {}
    for first, second in zip(node.body, node.body[1:], strict=False):
        if (
            isinstance(first, ast.AnnAssign)
            and isinstance(first.target, ast.Name)
            and isinstance(second, ast.Expr)
            and isinstance(second.value, ast.Constant)
        ):
            comments[first.target.id] = str(second.value.value).splitlines()
    return comments
