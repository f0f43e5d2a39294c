"""SegMap's weights file (WEIGHTS.md, The peers): safetensors, matrices in f16, all else in f32."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file
from torch import nn

from esm_train import __version__
from esm_train.checkpoint import atomically
from esm_train.errors import TrainError
from esm_train.segmap.data import grids_of
from esm_train.segmap.model import BN_EPS, SegMapNet
from esm_train.validation import open_corpus

ARCHITECTURE = "segmap-cnn"
HEADER = {
    "format": "esm-weights",
    "format_version": "2",
    "architecture": ARCHITECTURE,
    "variant": "segmap",
    "grid": "32,32,16",
    "channels": "32,64,64",
    "descriptor_dim": "64",
    "normalisation": "mean,turn,fit=3.2x3.2x1.6,centre=mean",
    "parameters": "8591552",
    "multiply_adds": "164136448",
    "created_by": f"esm_train {__version__}",
}


def _affine(bn: nn.BatchNorm1d) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    assert bn.running_mean is not None and bn.running_var is not None
    mean, var = bn.running_mean.double().numpy(), bn.running_var.double().numpy()
    scale = bn.weight.detach().double().numpy() / np.sqrt(var + BN_EPS)
    return scale, bn.bias.detach().double().numpy() - mean * scale


def segmap_tensors(model: SegMapNet) -> dict[str, npt.NDArray[np.generic]]:
    """The tensors of the file; the batch norm between the dense layers is folded into the second."""
    tensors: dict[str, npt.NDArray[np.generic]] = {}
    for name in ("conv1", "conv2", "conv3"):
        layer = getattr(model, name)
        tensors[f"{name}.weight"] = layer.weight.detach().permute(2, 3, 4, 1, 0).numpy()
        tensors[f"{name}.bias"] = layer.bias.detach().numpy()
    tensors["dense1.weight"] = model.dense1.weight.detach().T.numpy()
    tensors["dense1.bias"] = model.dense1.bias.detach().numpy()
    scale, shift = _affine(model.bn1)
    matrix = model.dense2.weight.detach().double().numpy().T
    tensors["dense2.weight"] = scale[:, None] * matrix
    tensors["dense2.bias"] = model.dense2.bias.detach().double().numpy() + shift @ matrix
    tensors["bn2.scale"], tensors["bn2.shift"] = _affine(model.bn2)
    kind = {name: np.float16 if name.endswith(".weight") else np.float32 for name in tensors}
    rounded = {name: np.ascontiguousarray(t.astype(kind[name])) for name, t in tensors.items()}
    for name, tensor in rounded.items():
        if not np.isfinite(tensor).all():
            raise TrainError(f"tensor {name} is not finite: these weights are not written", "train anew")
    return rounded


def write_segmap(model: SegMapNet, file: Path, facts: dict[str, str]) -> None:
    """Writes the file under a temporary name and renames it."""
    tensors = segmap_tensors(model)
    atomically(file, lambda part: save_file(tensors, part, metadata={**HEADER, **facts}))


def load_segmap(file: Path) -> tuple[SegMapNet, dict[str, str]]:
    """The network of a file, for inference."""
    try:
        with safe_open(file, framework="numpy") as handle:
            metadata = dict(handle.metadata() or {})
            stored = {name: handle.get_tensor(name) for name in handle.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as error:
        raise TrainError(f"{file}: {error}", "is it a .safetensors file of esm-train segmap?") from None
    if metadata.get("architecture") != ARCHITECTURE:
        raise TrainError(f"{file}: architecture {metadata.get('architecture')!r}, expected {ARCHITECTURE!r}")
    model = SegMapNet(0.0).eval()
    expected = segmap_tensors(model)
    wrong = sorted(
        {n for n, t in expected.items() if n not in stored or stored[n].shape != t.shape} | (stored.keys() - expected)
    )
    if wrong:
        raise TrainError(f"{file}: tensors missing, unknown or of another shape: {', '.join(wrong)}")
    t = {name: torch.from_numpy(value.astype(np.float32)) for name, value in stored.items()}
    with torch.no_grad():
        for name in ("conv1", "conv2", "conv3"):
            getattr(model, name).weight.copy_(t[f"{name}.weight"].permute(4, 3, 0, 1, 2))
            getattr(model, name).bias.copy_(t[f"{name}.bias"])
        for name in ("dense1", "dense2"):
            getattr(model, name).weight.copy_(t[f"{name}.weight"].T)
            getattr(model, name).bias.copy_(t[f"{name}.bias"])
        for bn, scale, shift in (
            (model.bn1, torch.ones(512), torch.zeros(512)),
            (model.bn2, t["bn2.scale"], t["bn2.shift"]),
        ):
            assert bn.running_mean is not None and bn.running_var is not None
            bn.running_mean.zero_()
            bn.running_var.fill_(1.0 - BN_EPS)
            bn.weight.copy_(scale)
            bn.bias.copy_(shift)
    return model, metadata


@torch.no_grad()
def write_segmap_golden(weights: Path, sets: tuple[str, ...], count: int, file: Path) -> int:
    """Segments of labelled sets, evenly spread, their grids and what PyTorch makes of them; returns the file's size."""
    model, _ = load_segmap(weights)
    corpus = open_corpus(sets, "golden")
    rows = np.unique(np.linspace(0, len(corpus) - 1, count).astype(np.int64))
    grids = grids_of(corpus, rows)
    points, offsets = corpus.gather(rows)
    bits = (grids.cells.numpy().astype(np.int32) << np.arange(16, dtype=np.int32)).sum(axis=3)
    tensors = {
        "points": points,
        "offsets": offsets.astype(np.int32),
        "columns": bits.astype(np.int32),
        "extents": grids.extents.numpy(),
        "descriptor": model(grids.cells, grids.extents).numpy(),
    }
    digest = hashlib.blake2b(weights.read_bytes(), digest_size=32).hexdigest()
    metadata = {"format": "esm-golden", "format_version": "1", "variant": "segmap", "weights_blake2b": digest}
    plain = {name: np.ascontiguousarray(value) for name, value in tensors.items()}
    atomically(file, lambda part: save_file(plain, part, metadata=metadata))
    return file.stat().st_size
