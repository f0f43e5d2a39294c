"""The network in PyTorch: X-conv layers, global branch, fully connected layers, metric size, quality head.

Weights are kept in the order in which batched matrix products read them without a copy; `export.py` brings them into
the order of WEIGHTS.md. Activations are rows (segment x point) by channels throughout, so that each linear step is
one matrix product over all segments.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from esm_train.plan import BN_EPS, BN_MOMENTUM, Plan, XConvSpec

DESCRIPTOR_GAIN = 0.1
"""Factor on the first weights of the last layer: squared distances then start near the loss's margin of 0.01. At the
scale of one the pair loss outweighs the triplets, and a training begins by shrinking everything, sizes included."""


def batch_norm(channels: int) -> nn.BatchNorm1d:
    """Batch norm over the rows."""
    return nn.BatchNorm1d(channels, eps=BN_EPS, momentum=BN_MOMENTUM)


def glorot(*shape: int) -> nn.Parameter:
    """Glorot-normal weights; of a batched shape the last two indices are input and output of each product."""
    std = (2.0 / (shape[-2] + shape[-1])) ** 0.5
    return nn.Parameter(torch.randn(*shape) * std)


def widened(x: Tensor) -> Tensor:
    """Half precision as f32, anything else as it is."""
    return x.float() if x.dtype in (torch.bfloat16, torch.float16) else x


class Dense(nn.Module):
    """rows x in -> rows x out: linear without bias, ELU, batch norm."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.weight = glorot(inputs, outputs)
        self.bn = batch_norm(outputs)

    def forward(self, x: Tensor, row: Tensor | None = None) -> Tensor:
        """With `row` (segments x out) added before the activation to all points of each segment."""
        y = x @ self.weight
        if row is not None:
            y = (y.view(row.shape[0], -1, y.shape[1]) + row[:, None, :]).flatten(0, 1)
        out: Tensor = self.bn(F.elu(y))
        return out


class XConv(nn.Module):
    """One X-conv layer (Li et al., PointCNN, NeurIPS 2018), without sorting."""

    def __init__(self, spec: XConvSpec) -> None:
        super().__init__()
        k, joined = spec.neighbours, spec.joined
        self.spec = spec
        self.lift1 = Dense(3, spec.lifted)
        self.lift2 = Dense(spec.lifted, spec.lifted)
        self.x0_weight = glorot(3 * k, k * k)  # [3k + xyz][j*K + i]
        self.x0_bn = batch_norm(k * k)
        self.x1_weight = glorot(k, k, k)  # [j][i][q]
        self.x1_bn = batch_norm(k * k)  # q*K + j
        self.x2_weight = glorot(k, k, k)  # [q][j][r]
        self.x2_bn = batch_norm(k * k)  # q*K + r
        self.depthwise_weight = glorot(joined, k, spec.multiplier)  # [c][k][q]
        self.pointwise = Dense(joined * spec.multiplier, spec.channels)

    def forward(self, points: Tensor, features: Tensor | None, index: Tensor) -> Tensor:
        """Points (B, P_prev, 3), features (B*P_prev, C_prev) or None, index (B, P, K) -> (B*P, C)."""
        batch, kept, k = index.shape
        source = points.shape[1]
        first = torch.arange(batch, device=index.device) * source
        flat = (index.long() + first[:, None, None]).flatten()
        query = points[:, :kept].reshape(-1, 1, 3)
        local = points.reshape(-1, 3).index_select(0, flat).view(-1, k, 3) - query
        lifted = self.lift2(self.lift1(local.view(-1, 3)))
        if features is None:
            joined = lifted
        else:
            joined = torch.cat((lifted, features.to(lifted.dtype).index_select(0, flat)), dim=1)
        joined = joined.view(-1, k, joined.shape[1])
        transform = self.transform(local.view(-1, 3 * k))
        # (rows, c, k): the depthwise product below then reads unit strides.
        mixed = torch.bmm(joined.transpose(1, 2), transform.transpose(1, 2))
        weight = self.depthwise_weight.to(mixed.dtype)
        separate = torch.bmm(mixed.transpose(0, 1), weight).transpose(0, 1).flatten(1)
        out: Tensor = self.pointwise(separate)
        return out

    def transform(self, local: Tensor) -> Tensor:
        """The K x K matrix X2[q][r] of each row (rows, 3K)."""
        k = self.spec.neighbours
        x0: Tensor = self.x0_bn(F.elu(local @ self.x0_weight))
        x1 = torch.bmm(x0.view(-1, k, k).transpose(0, 1), self.x1_weight)  # (j, rows, q)
        x1 = self.x1_bn(F.elu(x1.permute(1, 2, 0).reshape(-1, k * k)))
        x2 = torch.bmm(x1.view(-1, k, k).transpose(0, 1), self.x2_weight)  # (q, rows, r)
        x2 = self.x2_bn(x2.transpose(0, 1).reshape(-1, k * k))
        out: Tensor = x2.view(-1, k, k)
        return out


class EsmNet(nn.Module):
    """Points, neighbour lists and sizes in, descriptors out."""

    measures_mean: Tensor
    measures_std: Tensor

    def __init__(self, plan: Plan, dropout: float = 0.5) -> None:
        super().__init__()
        self.plan = plan
        self.xconv = nn.ModuleList(XConv(spec) for spec in plan.layers)
        self.global1 = Dense(3, plan.global_channels)
        self.global2 = Dense(plan.global_channels, plan.global_channels)
        self.fc1 = Dense(plan.fc_input, plan.hidden[0])
        self.fc2 = Dense(*plan.hidden)
        self.fc3_weight = nn.Parameter(glorot(plan.hidden[1], plan.learned_dim).detach() * DESCRIPTOR_GAIN)
        self.fc3_bias = nn.Parameter(torch.zeros(plan.learned_dim))
        if plan.context:
            self.join = Dense(plan.join_input, plan.hidden[1])
        self.dropout = nn.Dropout(dropout)
        self.register_buffer("measures_mean", torch.zeros(plan.measures))
        self.register_buffer("measures_std", torch.ones(plan.measures))
        if plan.size_mode in ("fc", "both"):
            # Zero: training starts from the network without sizes, whose weights may have been loaded.
            self.fc1_size_weight = nn.Parameter(torch.zeros(plan.sizes, plan.hidden[0]))
        if plan.size_mode in ("beside", "both"):
            self.size_log_weight = nn.Parameter(torch.zeros(plan.sizes))

    def forward(self, points: Tensor, neighbours: list[Tensor], measures: Tensor | None = None) -> Tensor:
        """Points (B, 256, 3), a (B, P, K) list a layer, raw measures (B, plan.measures) -> (B, descriptor_dim)."""
        z = self.standardised(measures)
        return self.descriptor(self.pooled(points, self.features(points, neighbours), z), z)

    def descriptor(self, pooled: Tensor, z: Tensor) -> Tensor:
        """The last layers: shape (B, hidden) and standardised measures -> (B, descriptor_dim)."""
        joined = self.join(torch.cat((pooled, z), dim=1)) if self.plan.context else pooled
        learned = joined @ self.fc3_weight + self.fc3_bias
        if self.plan.size_mode in ("beside", "both"):
            return torch.cat((widened(learned), self.sizes(z) * self.size_weight()), dim=1)
        return widened(learned)

    def sizes(self, z: Tensor) -> Tensor:
        """The sizes among the standardised measures."""
        return z[:, : self.plan.sizes]

    def features(self, points: Tensor, neighbours: list[Tensor]) -> Tensor:
        """Output of the last X-conv, (B * P_4, C)."""
        features: Tensor | None = None
        for layer, index, source in zip(self.xconv, neighbours, self.plan.sources, strict=True):
            features = layer(points[:, :source], features, index)
        assert features is not None
        return features

    def pooled(self, points: Tensor, features: Tensor, z: Tensor) -> Tensor:
        """Fully connected layers per point, then their mean over the points: (B, hidden)."""
        batch = points.shape[0]
        query = points[:, : self.plan.points[-1]].reshape(-1, 3)
        absolute = self.global2(self.global1(query))
        row = self.sizes(z) @ self.fc1_size_weight if self.plan.size_mode in ("fc", "both") else None
        hidden = self.fc1(torch.cat((absolute, features.to(absolute.dtype)), dim=1), row)
        hidden = self.dropout(self.fc2(hidden))
        mean: Tensor = widened(hidden).view(batch, -1, hidden.shape[1]).mean(dim=1)
        return mean

    def standardised(self, measures: Tensor | None) -> Tensor:
        """Zero mean, unit deviation over the training set; unknown (NaN) becomes 0."""
        if self.plan.size_mode == "none":
            return self.measures_mean.new_zeros(0)
        if measures is None:
            raise ValueError(f"size mode {self.plan.size_mode!r} needs the sizes of the segments")
        return torch.nan_to_num((measures - self.measures_mean) / self.measures_std, nan=0.0)

    def size_weight(self) -> Tensor:
        """Positive weights of the standardised sizes in the descriptor."""
        return torch.exp(self.size_log_weight)


class QualityHead(nn.Module):
    """One fully connected layer of size two on the frozen descriptor."""

    def __init__(self, descriptor_dim: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(descriptor_dim, 2))
        self.bias = nn.Parameter(torch.zeros(2))
        self.temperature = 1.0

    def forward(self, descriptor: Tensor) -> Tensor:
        """Logits (B, 2), before the temperature."""
        return descriptor @ self.weight + self.bias

    def probability(self, descriptor: Tensor) -> Tensor:
        """The chance (B,) that the nearest in the map is the same object."""
        return torch.softmax(self(descriptor) / self.temperature, dim=1)[:, 1]


SIZE_RATE = 10.0
"""Learning rate of the logs of the size weights against that of the others: Adam's steps are absolute, and a weight may
have to change by a factor where the others change by hundredths."""


def parameter_groups(model: EsmNet, weight_decay: float) -> list[dict[str, object]]:
    """Adam's groups: everything decays but the logs of the size weights, whose zero means weight one."""
    free = [p for name, p in model.named_parameters() if name.endswith("size_log_weight")]
    rest = [p for name, p in model.named_parameters() if not name.endswith("size_log_weight")]
    groups: list[dict[str, object]] = [{"params": rest, "weight_decay": weight_decay, "rate": 1.0}]
    if free:
        groups.append({"params": free, "weight_decay": 0.0, "rate": SIZE_RATE})
    return groups
