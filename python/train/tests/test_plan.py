"""The layer table of the reference, to the parameter."""

from __future__ import annotations

import pytest

from esm_train.model import EsmNet
from esm_train.plan import FULL_POINTS, PAPER_LAYERS, VARIANTS, plan_for


def test_layer_table() -> None:
    rows = [(s.neighbours, s.dilation, s.lifted, s.before, s.multiplier, s.channels) for s in PAPER_LAYERS]
    assert rows == [
        (8, 1, 16, 0, 4, 32),
        (12, 3, 8, 32, 2, 64),
        (16, 3, 16, 64, 2, 128),
        (16, 4, 32, 128, 2, 256),
    ]


@pytest.mark.parametrize("variant", VARIANTS)
def test_parameters(variant: str) -> None:
    plan = plan_for(variant)
    join = [] if variant == "esm-paper" else [(128 + 6 + 28) * 128 + 2 * 128]
    assert plan.layer_parameters() == [5936, 15832, 45680, 115360, 82432, 33024, *join, 2064]
    assert plan.parameters() == 300_328 + sum(join)
    model = EsmNet(plan)
    counted = {name: p.numel() for name, p in model.named_parameters() if "size" not in name}
    assert sum(counted.values()) == 300_328 + sum(join)
    norms = sum(n for name, n in counted.items() if ".bn." in name or "_bn." in name)
    assert norms == 6_592 + (256 if join else 0)
    assert plan.descriptor_dim == (16 if variant == "esm-paper" else 22)


@pytest.mark.parametrize(
    ("points", "millions"),
    [
        (FULL_POINTS, 98.40),
        ((256, 256, 120, 120), 50.2),
        ((256, 192, 128, 128), 51.7),
        ((256, 128, 64, 64), 27.6),
        ((256, 96, 64, 48), 22.4),
        ((128, 64, 64, 48), 20.6),
    ],
)
def test_multiply_adds(points: tuple[int, ...], millions: float) -> None:
    plan = plan_for("esm-paper", points=points)
    assert round(plan.multiply_adds() / 1e6, 2 if millions == 98.40 else 1) == millions


def test_too_few_points_for_the_neighbours() -> None:
    with pytest.raises(ValueError, match="needs 64 neighbours of 48"):
        plan_for("esm-swift", points=(256, 96, 48, 48))
    with pytest.raises(ValueError, match="keeps 128 points of 64"):
        plan_for("esm-swift", points=(256, 64, 128, 48))
