"""Neighbour lists, exactly as the Rust core makes them.

Squared distance (dx*dx + dy*dy) + dz*dz in f32, every operation rounded; ascending, ties by lower index. A distance
is never negative, so its bits read as an integer sort like the number; with the index in the low bits one integer
key holds distance and tie-break, and any partial sort of the keys is exact.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch

from esm_train.plan import Plan

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]

_INDEX_BITS = 16


def nearest(query: F32, source: F32, count: int) -> I64:
    """Indices (Q, count) of the `count` nearest `source` points (S, 3) of each `query` point (Q, 3)."""
    dx = query[:, None, 0] - source[None, :, 0]
    dy = query[:, None, 1] - source[None, :, 1]
    dz = query[:, None, 2] - source[None, :, 2]
    distance = np.ascontiguousarray((dx * dx + dy * dy) + dz * dz)
    keys = distance.view(np.int32).astype(np.int64) << _INDEX_BITS
    keys |= np.arange(source.shape[0], dtype=np.int64)
    if count < source.shape[0]:
        keys = np.partition(keys, count - 1, axis=1)[:, :count]
    keys = np.sort(keys, axis=1)
    return keys & ((1 << _INDEX_BITS) - 1)


def neighbour_lists(points: F32, plan: Plan) -> list[I64]:
    """For one segment (points x 3, normalised): one (P_l, K) list a layer, into the points of the layer before."""
    lists: list[I64] = []
    if set(plan.points) == {plan.input_points}:
        longest = max((layer.neighbours - 1) * layer.dilation + 1 for layer in plan.layers)
        shared = nearest(points, points, longest)
        for layer in plan.layers:
            lists.append(np.ascontiguousarray(shared[:, :: layer.dilation][:, : layer.neighbours]))
        return lists
    for kept, source, layer in zip(plan.points, plan.sources, plan.layers, strict=True):
        # The last of the K*D nearest that is used is number (K-1)*D.
        found = nearest(points[:kept], points[:source], (layer.neighbours - 1) * layer.dilation + 1)
        lists.append(np.ascontiguousarray(found[:, :: layer.dilation]))
    return lists


def neighbour_lists_torch(points: torch.Tensor, plan: Plan) -> list[torch.Tensor]:
    """The same for a batch (B, points, 3) on the tensor's own device: one (B, P_l, K) int64 list a layer."""
    lists: list[torch.Tensor] = []
    for kept, source, layer in zip(plan.points, plan.sources, plan.layers, strict=True):
        d = points[:, :kept, None, :] - points[:, None, :source, :]
        # Eager operations round one by one: no fused multiply-add.
        distance = (d[..., 0] * d[..., 0] + d[..., 1] * d[..., 1]) + d[..., 2] * d[..., 2]
        keys = distance.contiguous().view(torch.int32).to(torch.int64) << _INDEX_BITS
        keys = keys | torch.arange(source, device=points.device)
        last = (layer.neighbours - 1) * layer.dilation + 1
        found = torch.topk(keys, last, dim=2, largest=False, sorted=True).values
        lists.append((found & ((1 << _INDEX_BITS) - 1))[:, :, :: layer.dilation].contiguous())
    return lists
