"""Where a training starts: the weights of another one, out of a checkpoint or out of a weights file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from esm_train.checkpoint import load_checkpoint
from esm_train.corpus import I64, Corpus
from esm_train.errors import TrainError
from esm_train.inputs import inference_inputs
from esm_train.model import EsmNet
from esm_train.weights import load_network

FIXED = ("measures_mean", "measures_std")
"""What every training measures on its own data."""

ROWS = 512
"""Segments on which the batch norms of a weights file are measured."""


def start_from(model: EsmNet, file: Path, corpus: Corpus, rows: I64) -> tuple[list[str], list[str]]:
    """Loads the weights of equal name and shape; the sizes' mean and deviation stay. Returns (taken, left).

    `rows` of the corpus serve a weights file (`.safetensors`), whose batch norms have to be taken apart again.
    """
    other = trainable(file, corpus, rows) if file.suffix == ".safetensors" else load_checkpoint(file)["model"]
    own = model.state_dict()
    taken = [n for n, t in own.items() if n not in FIXED and n in other and other[n].shape == t.shape]
    model.load_state_dict({n: other[n] for n in taken}, strict=False)
    left = [n for n in own if n not in taken and n not in FIXED]
    if not any(n.startswith("xconv") for n in taken):
        raise TrainError(f"{file}: none of its X-conv weights fit this network")
    return taken, left


@torch.no_grad()
def trainable(file: Path, corpus: Corpus, rows: I64) -> dict[str, Any]:
    """The state of a weights file's network that can be trained on.

    The file holds each batch norm as one affine map. In training the norm divides by what it sees in the batch, so what
    it sees is measured and multiplied into its scale: the same function as before, now of normalised values.
    """
    model, _, _ = load_network(file)
    norms = [m for m in model.modules() if isinstance(m, nn.BatchNorm1d)]
    seen: dict[int, tuple[Tensor, Tensor]] = {}

    def measure(norm: nn.BatchNorm1d, arguments: tuple[Tensor, ...], _out: Tensor) -> None:
        x = arguments[0]
        flat = x.transpose(0, 1).reshape(x.shape[1], -1).double()
        seen[id(norm)] = (flat.mean(dim=1), flat.var(dim=1, unbiased=False))

    handles = [n.register_forward_hook(measure) for n in norms]
    inputs = inference_inputs(corpus, rows, model.plan)
    model(inputs.points, inputs.neighbours, inputs.measures)
    for handle in handles:
        handle.remove()
    for norm in norms:
        if id(norm) not in seen or norm.running_mean is None or norm.running_var is None:
            raise TrainError(f"{file}: a batch norm is never used")
        mean, variance = seen[id(norm)]
        norm.bias.add_((norm.weight.double() * mean).to(norm.bias.dtype))
        norm.weight.mul_((variance + norm.eps).sqrt().to(norm.weight.dtype))
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
    return model.state_dict()
