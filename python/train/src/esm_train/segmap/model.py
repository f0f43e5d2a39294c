"""The encoder, and beside it what only its training needs: classes and decoder."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from esm_train.segmap.grid import GRID

DESCRIPTOR = 64
HIDDEN = 512
CHANNELS = (32, 64, 64)
FLAT = CHANNELS[2] * (GRID[0] // 4) * (GRID[1] // 4) * (GRID[2] // 4)
BN_EPS = 1e-3
BN_MOMENTUM = 0.01
"""TensorFlow's 0.99."""

FILLED_WEIGHT = 0.9
"""Weight of an occupied cell in the reconstruction's cross-entropy; an empty one has the rest to 1."""


class SegMapNet(nn.Module):
    """conv3 32 - pool - conv3 64 - pool - conv3 64 - dense 512 - dense 64: 8.59 M parameters, 164.1 M multiply-adds.

    The descriptor is read after the last batch norm, as in the published program. Grids are held channels last, which
    is also the order in which the last convolution is flattened.
    """

    def __init__(self, dropout: float = 0.5) -> None:
        super().__init__()
        a, b, c = CHANNELS
        self.conv1 = nn.Conv3d(1, a, 3, padding=1)
        self.conv2 = nn.Conv3d(a, b, 3, padding=1)
        self.conv3 = nn.Conv3d(b, c, 3, padding=1)
        self.dense1 = nn.Linear(FLAT + 3, HIDDEN)
        self.bn1 = nn.BatchNorm1d(HIDDEN, eps=BN_EPS, momentum=BN_MOMENTUM)
        self.dropout = nn.Dropout(dropout)
        self.dense2 = nn.Linear(HIDDEN, DESCRIPTOR)
        self.bn2 = nn.BatchNorm1d(DESCRIPTOR, eps=BN_EPS, momentum=BN_MOMENTUM)
        glorot(self)
        self.to(memory_format=torch.channels_last_3d)

    def encode(self, grid: Tensor, extents: Tensor) -> Tensor:
        """Grids (B, 32, 32, 16) and extents (B, 3) in metres -> (B, 64) before the last batch norm."""
        x = grid.float().unsqueeze(1).contiguous(memory_format=torch.channels_last_3d)
        # Pooling commutes with ReLU and leaves it an eighth of the cells.
        x = functional.max_pool3d(self.conv1(x), 2).relu()
        x = functional.max_pool3d(self.conv2(x), 2).relu()
        x = self.conv3(x).relu().permute(0, 2, 3, 4, 1).flatten(1)
        x = self.dense1(torch.cat((x.float(), extents), dim=1)).relu()
        hidden: Tensor = self.dense2(self.dropout(self.bn1(x.float()))).relu()
        return hidden

    def forward(self, grid: Tensor, extents: Tensor) -> Tensor:
        """Descriptors (B, 64)."""
        descriptor: Tensor = self.bn2(self.encode(grid, extents).float())
        return descriptor


class Teacher(nn.Module):
    """What the descriptor has to serve while it is trained: tell the classes, and give the segment back."""

    def __init__(self, classes: int, dropout: float) -> None:
        super().__init__()
        self.dropout = nn.Dropout(dropout)
        self.classes = nn.Linear(DESCRIPTOR, classes)
        self.expand = nn.Linear(DESCRIPTOR, 8192)
        kind = {"stride": 2, "padding": 1, "output_padding": 1, "bias": False}
        self.up1 = nn.ConvTranspose3d(32, 32, 3, **kind)  # type: ignore[arg-type]
        self.up2 = nn.ConvTranspose3d(32, 32, 3, **kind)  # type: ignore[arg-type]
        self.last = nn.Conv3d(32, 1, 3, padding=1, bias=False)
        glorot(self)
        self.to(memory_format=torch.channels_last_3d)

    def classify(self, descriptor: Tensor) -> Tensor:
        """Logits (B, classes) from descriptors after their batch norm."""
        logits: Tensor = self.classes(self.dropout(descriptor))
        return logits

    def reconstruct(self, hidden: Tensor) -> Tensor:
        """Logits (B, 32, 32, 16) of the cells from descriptors before their batch norm."""
        x = self.expand(hidden).relu().view(-1, 8, 8, 4, 32).permute(0, 4, 1, 2, 3)
        x = self.up2(self.up1(x).relu()).relu()
        cells: Tensor = self.last(x).squeeze(1)
        return cells


def reconstruction_loss(logits: Tensor, grid: Tensor) -> Tensor:
    """Mean cross-entropy of the cells, occupied ones weighted against the many empty ones."""
    target = grid.float()
    weight = target * FILLED_WEIGHT + (1.0 - target) * (1.0 - FILLED_WEIGHT)
    return functional.binary_cross_entropy_with_logits(logits.float(), target, weight)


def glorot(module: nn.Module) -> None:
    """Glorot-uniform weights and biases of zero, TensorFlow's defaults."""
    for layer in module.modules():
        if isinstance(layer, nn.Conv3d | nn.ConvTranspose3d | nn.Linear):
            nn.init.xavier_uniform_(layer.weight)
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)
