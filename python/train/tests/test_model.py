"""The network against its plain restatement, and what must not change its answer."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from esm_train.inputs import Inputs
from esm_train.losses import squared_distances
from esm_train.model import EsmNet
from esm_train.neighbours import neighbour_lists
from esm_train.plan import Plan, plan_for, tiny_plan
from esm_train.restated import forward, quality
from esm_train.run import random_network
from esm_train.weights import to_weights


def inputs_of(points: np.ndarray, plan: Plan) -> Inputs:
    each = [neighbour_lists(p, plan) for p in points]
    lists = [torch.from_numpy(np.stack(layer)) for layer in zip(*each, strict=True)]
    measures = np.random.default_rng(5).normal(size=(len(points), plan.measures)).astype(np.float32)
    return Inputs(torch.from_numpy(points), lists, torch.from_numpy(measures))


def random_points(segments: int, plan: Plan, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(segments, plan.input_points, 3)).astype(np.float32)
    points[0, -20:] = points[0, :20]
    return points


@pytest.mark.parametrize(
    ("variant", "mode", "context"),
    [
        ("esm-paper", "none", False),
        ("esm-swift", "beside", False),
        ("esm-swift", "beside", True),
        ("esm-swift", "fc", False),
        ("esm-swift", "both", True),
    ],
)
def test_agrees_with_the_restatement(variant: str, mode: str, context: bool) -> None:
    torch.manual_seed(3)
    plan = plan_for(variant, size_mode=mode, context=context)
    model, head = random_network(plan)
    weights = to_weights(model, head, {})
    points = random_points(1, plan)
    inputs = inputs_of(points, plan)
    inputs.measures[0, plan.sizes - 1 : plan.sizes] = torch.nan  # an unknown size
    with torch.no_grad():
        got = model(inputs.points, inputs.neighbours, inputs.measures)
        chance = head.probability(got)
    want = forward(points[0], inputs.measures[0].numpy(), plan, weights.tensors)
    assert got.shape == (1, plan.descriptor_dim)
    assert want.descriptor.std() > 0.05
    np.testing.assert_allclose(got[0].numpy(), want.descriptor, atol=2e-5)
    assert float(chance[0]) == pytest.approx(quality(want.descriptor, weights.tensors, head.temperature), abs=1e-5)


def test_the_order_of_points_does_not_matter() -> None:
    torch.manual_seed(0)
    plan = plan_for("esm-paper")
    model, _ = random_network(plan)
    points = np.random.default_rng(2).normal(size=(1, 256, 3)).astype(np.float32)
    shuffled = points[:, np.random.default_rng(3).permutation(256)]
    with torch.no_grad():
        a, b = (model(i.points, i.neighbours, i.measures) for i in (inputs_of(p, plan) for p in (points, shuffled)))
    assert a.std() > 0.05
    torch.testing.assert_close(a, b, atol=2e-5, rtol=0.0)


def test_turning_the_points_does() -> None:
    """X-conv is not invariant to rotation, which is why training turns its segments."""
    torch.manual_seed(0)
    plan = tiny_plan()
    model, _ = random_network(plan)
    points = random_points(1, plan)
    turned = points[:, :, [1, 0, 2]] * np.array([-1.0, 1.0, 1.0], np.float32)
    with torch.no_grad():
        a, b = (model(i.points, i.neighbours, i.measures) for i in (inputs_of(p, plan) for p in (points, turned)))
    assert (a - b).abs().max() > 1e-3


def test_rows_depend_on_their_own_segment_only() -> None:
    torch.manual_seed(1)
    plan = tiny_plan("both")
    model, _ = random_network(plan)
    inputs = inputs_of(random_points(5, plan), plan)
    with torch.no_grad():
        together = model(inputs.points, inputs.neighbours, inputs.measures)
        for row in range(5):
            one = inputs.part(row, row + 1)
            alone = model(one.points, one.neighbours, one.measures)
            torch.testing.assert_close(together[row : row + 1], alone, atol=1e-6, rtol=1e-5)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_cuda_agrees() -> None:
    torch.manual_seed(3)
    plan = plan_for("esm-swift")
    model, _ = random_network(plan)
    inputs = inputs_of(random_points(4, plan), plan)
    with torch.no_grad():
        here = model(inputs.points, inputs.neighbours, inputs.measures)
        there = Inputs(inputs.points, [], inputs.measures).to(torch.device("cuda"), plan)
        assert all(torch.equal(a, b.cpu()) for a, b in zip(inputs.neighbours, there.neighbours, strict=True))
        got = model.cuda()(there.points, there.neighbours, there.measures).cpu()
    torch.testing.assert_close(here, got, atol=1e-3, rtol=1e-3)


def test_gradients() -> None:
    """Every parameter has one, and along a random direction it is the difference quotient."""
    torch.manual_seed(2)
    plan = tiny_plan("both", context=True)
    model = EsmNet(plan, dropout=0.0).double().train()
    with torch.no_grad():
        model.fc1_size_weight.normal_(0.0, 0.1)
    inputs = inputs_of(random_points(6, plan), plan)
    points, measures = inputs.points.double(), inputs.measures.double()

    def loss() -> torch.Tensor:
        z = model.standardised(measures)
        pooled = model.pooled(points, model.features(points, inputs.neighbours), z)
        return torch.exp(-squared_distances(model.descriptor(pooled, z))).mean()

    loss().backward()  # type: ignore[no-untyped-call]
    parameters = list(model.named_parameters())
    # A bias common to all descriptors cancels in their distances.
    silent = [n for n, p in parameters if p.grad is None or not bool((p.grad != 0).any())]
    assert [n for n in silent if n != "fc3_bias"] == []
    direction = [torch.randn_like(p) * 1e-2 for _, p in parameters]
    slope = sum(
        float((d * p.grad).sum()) for d, (_, p) in zip(direction, parameters, strict=True) if p.grad is not None
    )
    h = 1e-5
    values = []
    with torch.no_grad():
        for sign in (1.0, -2.0):
            for d, (_, p) in zip(direction, parameters, strict=True):
                p.add_(d, alpha=sign * h)
            values.append(float(loss()))
    # ELU and pooling are smooth but for kinks of measure zero.
    assert (values[0] - values[1]) / (2 * h) == pytest.approx(slope, rel=1e-4)


def test_sizes_alone_tell_segments_apart_only_where_they_are_used() -> None:
    torch.manual_seed(4)
    for mode, differs in (("none", False), ("beside", True), ("fc", True)):
        plan = tiny_plan(mode)
        model, _ = random_network(plan)
        inputs = inputs_of(np.repeat(random_points(1, plan), 2, axis=0), plan)
        with torch.no_grad():
            d = model(inputs.points, inputs.neighbours, inputs.measures)
        assert bool((d[0] - d[1]).abs().max() > 1e-4) == differs
