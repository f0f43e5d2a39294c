"""The weights file (WEIGHTS.md): a trained network to safetensors and back."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file
from torch import Tensor, nn

from esm_train import __version__
from esm_train.checkpoint import atomically
from esm_train.errors import TrainError
from esm_train.model import Dense, EsmNet, QualityHead, XConv
from esm_train.plan import BN_EPS, Plan, XConvSpec

F32 = npt.NDArray[np.float32]

FORMAT = "esm-weights"
VERSION = "2"
ARCHITECTURE = "xconv-4"
NORMALISATIONS = {False: "mean,rms,floor=0.001", True: "mean,turn,rms,floor=0.001"}
"""How points become inputs, by whether they are turned."""
CONTEXTS = {False: "none", True: "rings-7x4"}
"""What is told about a segment's surroundings, by whether anything is."""


@dataclass
class Weights:
    """Tensors by the names of WEIGHTS.md, and the header's metadata."""

    tensors: dict[str, F32]
    metadata: dict[str, str] = field(default_factory=dict)


def _numpy(tensor: Tensor) -> F32:
    return np.ascontiguousarray(tensor.detach().cpu().to(torch.float32).numpy())


def _affine(bn: nn.BatchNorm1d) -> tuple[F32, F32]:
    """Scale and shift of inference, computed in f64."""
    assert bn.running_var is not None and bn.running_mean is not None
    variance, mean = bn.running_var.double().cpu(), bn.running_mean.double().cpu()
    scale = bn.weight.detach().double().cpu() / torch.sqrt(variance + bn.eps)
    return _numpy(scale), _numpy(bn.bias.detach().double().cpu() - mean * scale)


def _grid(values: F32, k: int) -> F32:
    """K*K channels with their two indices swapped."""
    return np.ascontiguousarray(values.reshape(*values.shape[:-1], k, k).swapaxes(-1, -2).reshape(values.shape))


def _dense(name: str, layer: Dense) -> dict[str, F32]:
    scale, shift = _affine(layer.bn)
    return {f"{name}.weight": _numpy(layer.weight), f"{name}.bn.scale": scale, f"{name}.bn.shift": shift}


def _xconv(name: str, layer: XConv) -> dict[str, F32]:
    k = layer.spec.neighbours
    out = {**_dense(f"{name}.lift1", layer.lift1), **_dense(f"{name}.lift2", layer.lift2)}
    # In the model: x0 [..][j*K + i], x1 [j][i][q], x2 [q][j][r], depthwise [c][k][q]; channels of x1 q*K + j.
    out[f"{name}.x0.weight"] = _grid(_numpy(layer.x0_weight), k)
    out[f"{name}.x1.weight"] = np.ascontiguousarray(_numpy(layer.x1_weight).transpose(1, 0, 2))
    out[f"{name}.x2.weight"] = np.ascontiguousarray(_numpy(layer.x2_weight).transpose(1, 0, 2))
    for part, bn, swapped in (("x0", layer.x0_bn, True), ("x1", layer.x1_bn, True), ("x2", layer.x2_bn, False)):
        scale, shift = _affine(bn)
        out[f"{name}.{part}.bn.scale"] = _grid(scale, k) if swapped else scale
        out[f"{name}.{part}.bn.shift"] = _grid(shift, k) if swapped else shift
    out[f"{name}.depthwise.weight"] = np.ascontiguousarray(_numpy(layer.depthwise_weight).transpose(1, 0, 2))
    return {**out, **_dense(f"{name}.pointwise", layer.pointwise)}


def to_weights(model: EsmNet, quality: QualityHead | None, facts: dict[str, str]) -> Weights:
    """Everything that the forward pass needs; a missing quality head gives 0.5 for every segment."""
    plan = model.plan
    tensors: dict[str, F32] = {}
    for number, layer in enumerate(model.xconv, 1):
        assert isinstance(layer, XConv)
        tensors |= _xconv(f"xconv{number}", layer)
    for name, dense in (
        ("global1", model.global1),
        ("global2", model.global2),
        ("fc1", model.fc1),
        ("fc2", model.fc2),
    ):
        tensors |= _dense(name, dense)
    if plan.context:
        tensors |= _dense("join", model.join)
    tensors["fc3.weight"] = _numpy(model.fc3_weight)
    tensors["fc3.bias"] = _numpy(model.fc3_bias)
    if plan.size_mode != "none":
        tensors["measures.mean"] = _numpy(model.measures_mean)
        tensors["measures.std"] = _numpy(model.measures_std)
    if plan.size_mode in ("fc", "both"):
        tensors["fc1.size_weight"] = _numpy(model.fc1_size_weight)
    if plan.size_mode in ("beside", "both"):
        tensors["size.weight"] = _numpy(model.size_weight())
    head = QualityHead(plan.descriptor_dim) if quality is None else quality
    tensors["quality.weight"] = _numpy(head.weight)
    tensors["quality.bias"] = _numpy(head.bias)
    for name, tensor in tensors.items():
        if not np.isfinite(tensor).all():
            raise TrainError(f"tensor {name} is not finite: these weights are not written", "train anew")
    return Weights(tensors, {**_metadata(plan), "quality_temperature": repr(float(head.temperature)), **facts})


def _metadata(plan: Plan) -> dict[str, str]:
    def listed(values: tuple[object, ...]) -> str:
        return ",".join(str(v) for v in values)

    return {
        "format": FORMAT,
        "format_version": VERSION,
        "architecture": ARCHITECTURE,
        "variant": plan.variant,
        "input_points": str(plan.input_points),
        "point_plan": listed(plan.points),
        "neighbours": ",".join(f"{s.neighbours}x{s.dilation}" for s in plan.layers),
        "channels": listed(tuple(s.channels for s in plan.layers)),
        "lift": listed(tuple(s.lifted for s in plan.layers)),
        "multipliers": listed(tuple(s.multiplier for s in plan.layers)),
        "learned_dim": str(plan.learned_dim),
        "size_mode": plan.size_mode,
        "size_features": listed(plan.size_features),
        "context": CONTEXTS[plan.context],
        "descriptor_dim": str(plan.descriptor_dim),
        "normalisation": NORMALISATIONS[plan.turned],
        "parameters": str(plan.parameters()),
        "multiply_adds": str(plan.multiply_adds()),
        "created_by": f"esm_train {__version__}",
    }


def write_weights(weights: Weights, file: Path) -> None:
    """Writes the file under a temporary name and renames it."""
    atomically(file, lambda part: save_file(weights.tensors, part, metadata=weights.metadata))


def read_weights(file: Path) -> Weights:
    """Reads and checks a weights file."""
    try:
        with safe_open(file, framework="numpy") as handle:
            metadata = dict(handle.metadata() or {})
            tensors = {name: handle.get_tensor(name) for name in handle.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as error:
        raise TrainError(f"{file}: {error}", "is it a .safetensors file of esm-train export?") from None
    if metadata.get("format") != FORMAT or metadata.get("format_version") != VERSION:
        raise TrainError(
            f"{file}: format {metadata.get('format')!r} version {metadata.get('format_version')!r}, "
            f"this program reads {FORMAT!r} {VERSION!r}"
        )
    if metadata.get("architecture") != ARCHITECTURE:
        raise TrainError(
            f"{file}: architecture {metadata.get('architecture')!r}, this program knows {ARCHITECTURE!r}",
            "it belongs to another version of the network, or is a peer's",
        )
    for name, tensor in tensors.items():
        if tensor.dtype != np.float32 or not np.isfinite(tensor).all():
            raise TrainError(f"{file}: tensor {name}: not finite f32")
    if "measures.std" in tensors and not (tensors["measures.std"] > 0).all():
        raise TrainError(f"{file}: tensor measures.std: not all above 0")
    _temperature(metadata, file)
    return Weights(tensors, metadata)


def _temperature(metadata: dict[str, str], file: Path) -> float:
    text = metadata.get("quality_temperature", "1")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (0.0 < value < math.inf):
        raise TrainError(f"{file}: quality_temperature {text!r}: not a number above 0")
    return value


def architecture_of(file: Path) -> str:
    """The line `architecture` of a weights file; empty where there is none."""
    try:
        with safe_open(file, framework="numpy") as handle:
            return str((handle.metadata() or {}).get("architecture", ""))
    except (OSError, SafetensorError) as error:
        raise TrainError(f"{file}: {error}", "is it a .safetensors file of esm-train?") from None


def plan_of(weights: Weights, file: Path) -> Plan:
    """The plan that a header describes; the widths of the last layers are the tensors'."""
    metadata, tensors = weights.metadata, weights.tensors

    def numbers(key: str) -> tuple[int, ...]:
        return tuple(int(v) for v in metadata[key].split(","))

    try:
        pairs = [tuple(int(v) for v in p.split("x")) for p in metadata["neighbours"].split(",")]
        channels = numbers("channels")
        layers = tuple(
            XConvSpec(k, d, lifted, before, c, m)
            for (k, d), lifted, before, c, m in zip(
                pairs, numbers("lift"), (0, *channels[:-1]), channels, numbers("multipliers"), strict=True
            )
        )
        features = metadata["size_features"]
        return Plan(
            variant=metadata["variant"],
            points=numbers("point_plan"),
            layers=layers,
            global_channels=tensors["global1.weight"].shape[1],
            hidden=(tensors["fc1.weight"].shape[1], tensors["fc2.weight"].shape[1]),
            learned_dim=int(metadata["learned_dim"]),
            size_mode=metadata["size_mode"],
            size_features=tuple(features.split(",")) if features else (),
            input_points=int(metadata["input_points"]),
            turned={text: turned for turned, text in NORMALISATIONS.items()}[metadata["normalisation"]],
            context={text: context for context, text in CONTEXTS.items()}[metadata["context"]],
        )
    except (KeyError, ValueError, IndexError) as error:
        raise TrainError(f"{file}: header: {error}") from None


def load_network(file: Path) -> tuple[EsmNet, QualityHead, dict[str, str]]:
    """A network for inference from a weights file; batch norms hold the stored affine maps."""
    weights = read_weights(file)
    plan = plan_of(weights, file)
    model = EsmNet(plan)
    t = weights.tensors
    head = QualityHead(plan.descriptor_dim)
    expected = to_weights(model, head, {}).tensors
    wrong = sorted(
        {n for n in expected if n not in t or t[n].shape != expected[n].shape} | {n for n in t if n not in expected}
    )
    if wrong:
        raise TrainError(f"{file}: tensors missing, unknown or of another shape: {', '.join(wrong[:8])}")
    with torch.no_grad():
        for number, layer in enumerate(model.xconv, 1):
            assert isinstance(layer, XConv)
            _load_xconv(f"xconv{number}", layer, t)
        for name in ("global1", "global2", "fc1", "fc2"):
            _load_dense(name, getattr(model, name), t)
        if plan.context:
            _load_dense("join", model.join, t)
        model.fc3_weight.copy_(torch.from_numpy(t["fc3.weight"]))
        model.fc3_bias.copy_(torch.from_numpy(t["fc3.bias"]))
        if plan.size_mode != "none":
            model.measures_mean.copy_(torch.from_numpy(t["measures.mean"]))
            model.measures_std.copy_(torch.from_numpy(t["measures.std"]))
        if plan.size_mode in ("fc", "both"):
            model.fc1_size_weight.copy_(torch.from_numpy(t["fc1.size_weight"]))
        if plan.size_mode in ("beside", "both"):
            model.size_log_weight.copy_(torch.from_numpy(np.log(t["size.weight"])))
        head.weight.copy_(torch.from_numpy(t["quality.weight"]))
        head.bias.copy_(torch.from_numpy(t["quality.bias"]))
    head.temperature = _temperature(weights.metadata, file)
    return model.eval(), head.eval(), weights.metadata


def _load_bn(bn: nn.BatchNorm1d, scale: F32, shift: F32) -> None:
    assert bn.running_var is not None and bn.running_mean is not None
    bn.running_mean.zero_()
    bn.running_var.fill_(1.0 - BN_EPS)
    bn.weight.copy_(torch.from_numpy(scale))
    bn.bias.copy_(torch.from_numpy(shift))


def _load_dense(name: str, layer: Dense, t: dict[str, F32]) -> None:
    layer.weight.copy_(torch.from_numpy(t[f"{name}.weight"]))
    _load_bn(layer.bn, t[f"{name}.bn.scale"], t[f"{name}.bn.shift"])


def _load_xconv(name: str, layer: XConv, t: dict[str, F32]) -> None:
    k = layer.spec.neighbours
    _load_dense(f"{name}.lift1", layer.lift1, t)
    _load_dense(f"{name}.lift2", layer.lift2, t)
    _load_dense(f"{name}.pointwise", layer.pointwise, t)
    layer.x0_weight.copy_(torch.from_numpy(_grid(t[f"{name}.x0.weight"], k)))
    layer.x1_weight.copy_(torch.from_numpy(t[f"{name}.x1.weight"].transpose(1, 0, 2).copy()))
    layer.x2_weight.copy_(torch.from_numpy(t[f"{name}.x2.weight"].transpose(1, 0, 2).copy()))
    layer.depthwise_weight.copy_(torch.from_numpy(t[f"{name}.depthwise.weight"].transpose(1, 0, 2).copy()))
    for part, bn, swapped in (("x0", layer.x0_bn, True), ("x1", layer.x1_bn, True), ("x2", layer.x2_bn, False)):
        scale, shift = t[f"{name}.{part}.bn.scale"], t[f"{name}.{part}.bn.shift"]
        _load_bn(bn, _grid(scale, k) if swapped else scale, _grid(shift, k) if swapped else shift)
