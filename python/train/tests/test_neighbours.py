"""Neighbour lists against a full sort, ties and duplicates included."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from esm_train.neighbours import nearest, neighbour_lists, neighbour_lists_torch
from esm_train.plan import plan_for, tiny_plan
from esm_train.restated import nearest_by_sorting


@settings(max_examples=60, deadline=None)
@given(
    # A coarse grid makes ties and duplicates the rule.
    hnp.arrays(np.float32, (32, 3), elements=st.sampled_from([-1.0, -0.5, 0.0, 0.25, 0.5, 1.0])),
    st.integers(1, 32),
)
def test_nearest_is_the_full_sort(points: np.ndarray, count: int) -> None:
    found = nearest(points, points, count)
    for query in range(len(points)):
        assert found[query].tolist() == nearest_by_sorting(points, query, 32, count, 1).tolist()


def test_lists_of_both_plans_and_both_ways() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(3, 256, 3)).astype(np.float32)
    points[1, 100:] = points[1, :156]  # duplicates, as small segments have
    for variant in ("esm", "esm-swift"):
        plan = plan_for(variant)
        batched = neighbour_lists_torch(torch.from_numpy(points), plan)
        for segment in range(3):
            lists = neighbour_lists(points[segment], plan)
            for layer, (kept, source, spec) in enumerate(zip(plan.points, plan.sources, plan.layers, strict=True)):
                assert lists[layer].shape == (kept, spec.neighbours)
                assert (lists[layer] == batched[layer][segment].numpy()).all()
                for query in (0, kept - 1):
                    expected = nearest_by_sorting(points[segment], query, source, spec.neighbours, spec.dilation)
                    assert lists[layer][query].tolist() == expected.tolist()


def test_down_sampled_layers_look_among_the_points_before() -> None:
    plan = tiny_plan()
    points = np.random.default_rng(1).normal(size=(plan.input_points, 3)).astype(np.float32)
    for found, source in zip(neighbour_lists(points, plan), plan.sources, strict=True):
        assert found.max() < source
