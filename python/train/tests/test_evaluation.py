"""Metrics against loops, the quality head, the evaluation from end to end."""

from __future__ import annotations

import importlib.util
import json
import os
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from esm_train.balance import balance
from esm_train.describers import Core, PyTorch
from esm_train.errors import TrainError
from esm_train.evaluate import Evaluation, baseline_descriptors, evaluate, standardised, table
from esm_train.metrics import nearest_in_map, reliability, roc
from esm_train.plan import tiny_plan
from esm_train.quality import distance_thresholds, train_quality
from esm_train.run import random_network
from esm_train.synthetic import write_synthetic
from esm_train.validation import Validation, open_sides
from esm_train.weights import load_network


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.integers(0, 6), min_size=1, max_size=20),
    st.lists(st.integers(0, 6), min_size=1, max_size=20),
)
def test_auc_is_the_chance_of_the_right_order(positive: list[int], negative: list[int]) -> None:
    wins = np.mean([1.0 if p > n else 0.5 if p == n else 0.0 for p in positive for n in negative])
    curve = roc(np.array(positive, float), np.array(negative, float))
    assert curve.auc == pytest.approx(wins)
    assert curve.true_positive[-1] == curve.false_positive[-1] == 1.0


def test_nearest_in_map_by_loops() -> None:
    rng = np.random.default_rng(0)
    live, mapped = rng.integers(0, 3, (40, 3)).astype(np.float32), rng.integers(0, 3, (60, 3)).astype(np.float32)
    live_place, map_place = rng.integers(0, 2, 40), rng.integers(0, 2, 60)
    index, distance = nearest_in_map(live, mapped, live_place, map_place, 5)
    for i in range(40):
        order = sorted(
            (float(((live[i] - mapped[j]) ** 2).sum()), j) for j in np.flatnonzero(map_place == live_place[i])
        )
        np.testing.assert_allclose(distance[i] ** 2, [d for d, _ in order[:5]], atol=1e-5)
        assert {map_place[j] for j in index[i]} == {live_place[i]}
    far, none = nearest_in_map(live[:1], mapped[:2], np.array([7]), np.array([7, 8]), 3)
    assert far.tolist() == [[0, -1, -1]] and np.isinf(none[0, 1:]).all()


def test_pairs_keep_their_promises(sets: dict[str, str]) -> None:
    sides = open_sides((sets["map"],), (sets["live"],), "test")
    e = Evaluation(sides)
    assert len(e.judged) == 50
    assert sides.same(e.positive.live, e.positive.map).all()
    assert (sides.distance(e.random.live, e.random.map) >= 20.0).all()
    assert len(e.random.live) > 40 and len(e.hard.live) > 3
    assert (sides.distance(e.hard.live, e.hard.map) > 20.0).all()
    own, other = e.live_lengths[e.hard.live, 3:], e.map_lengths[e.hard.map, 3:]
    assert (np.abs(own - other) < 0.2 * own).all()


def test_visits_of_one_directory_are_map_and_live(tmp_path: Path) -> None:
    for visit in (0, 1):
        path = tmp_path / "both" / f"visit{visit}"
        write_synthetic(path, objects=30, observations=2, seed=4, place="synthetic:4", visit=visit)
    both = str(tmp_path / "both")
    apart = open_sides((f"{both}/visit0",), (f"{both}/visit1",), "test")
    sides = open_sides((f"{both}@0",), (f"{both}@1",), "test")
    assert len(sides.map_rows) == len(apart.map_rows) == 60 and len(sides.live) == 120
    assert (sides.live.visit[sides.live_rows] == 1).all() and (sides.map.visit[sides.map_rows] == 0).all()
    assert [sides.counterparts(i).tolist() for i in range(60)] == [apart.counterparts(i).tolist() for i in range(60)]
    validations = [Validation(s, tiny_plan(), max_live=20, max_map=30, lists=True) for s in (sides, apart)]
    torch.testing.assert_close(*(v.live_inputs.points for v in validations))
    torch.testing.assert_close(*(v.map_inputs.points for v in validations))
    with pytest.raises(TrainError, match="no segments of that visit"):
        open_sides((f"{both}@7",), (f"{both}@1",), "test")


def test_truth_by_position(sets: dict[str, str]) -> None:
    by_object = open_sides((sets["map"],), (sets["live"],), "test", "object")
    by_position = open_sides((sets["map"],), (sets["live"],), "test", "position", 3.0)
    assert by_object.counterparts(7).tolist() == by_position.counterparts(7).tolist() == [7]
    strict = open_sides((sets["map"],), (sets["live"],), "test", "position", 1e-4)
    with pytest.raises(TrainError, match="no live segment has a counterpart"):
        Evaluation(strict)


def test_counterparts_are_those_that_are_the_same(sets: dict[str, str]) -> None:
    for truth, radius in (("object", 0.7), ("position", 3.0), ("position", 45.0)):
        sides = open_sides((sets["map"],), (sets["live"],), "test", truth, radius)
        every = np.arange(50)
        for live in range(50):
            expected = np.flatnonzero(sides.same(np.full(50, live), every))
            assert sides.counterparts(live).tolist() == expected.tolist()
            assert len(expected) >= 1 if radius < 40 else len(expected) >= 3


def test_validation_of_a_part_keeps_the_counterparts(sets: dict[str, str]) -> None:
    sides = open_sides((sets["map"],), (sets["live"],), "test")
    v = Validation(sides, tiny_plan(), max_live=10, max_map=15, lists=True)
    assert len(v.sides.live_rows) == 10 and len(v.sides.map_rows) == 15
    assert all(len(v.sides.counterparts(i)) == 1 for i in range(10))


def test_reliability_of_a_true_and_of_an_overconfident_probability() -> None:
    rng = np.random.default_rng(0)
    p = rng.random(20_000)
    outcome = rng.random(20_000) < p
    assert reliability(p, outcome).error < 0.02
    assert reliability(np.clip(p + 0.3, 0, 1), outcome).error > 0.2


def test_quality_head_learns_and_is_calibrated() -> None:
    rng = np.random.default_rng(0)
    d = rng.normal(size=(4000, 6)).astype(np.float32) * [1, 5, 0.1, 1, 1, 1] + 2.0
    labels = rng.random(4000) < 1.0 / (1.0 + np.exp(-2.0 * (d[:, 0] - 2.0)))
    head, facts = train_quality(d.astype(np.float32), labels)
    assert facts["accuracy"] > 0.7 > facts["constant_accuracy"]
    with torch.no_grad():
        chance = head.probability(torch.from_numpy(d.astype(np.float32))).numpy().astype(np.float64)
    assert reliability(chance, labels).error < 0.05
    with pytest.raises(TrainError, match="0 of 4000"):
        train_quality(d.astype(np.float32), np.zeros(4000, bool))


def test_thresholds_are_quantiles_of_negatives(sets: dict[str, str]) -> None:
    sides = open_sides((sets["map"],), (sets["live"],), "test")
    live, mapped = (np.random.default_rng(s).normal(size=(50, 3)).astype(np.float32) for s in (0, 1))
    got = distance_thresholds(sides, live, mapped)
    assert 0.0 < float(got["max_distance_fpr_0.1"]) < float(got["max_distance_fpr_0.2"])


def test_evaluation_from_end_to_end(sets: dict[str, str], tmp_path: Path) -> None:
    sides = open_sides((sets["map"],), (sets["live"],), "test")
    torch.manual_seed(0)
    model, head = random_network(tiny_plan())
    report = evaluate([PyTorch("tiny", model, head, torch.device("cpu"))], sides, tmp_path)
    names = list(report["descriptors"])
    assert names == ["eigen", "sizes", "shape", "tiny"]
    # Fifty objects: sizes alone are far better than the chance of one half at 25 of 50.
    assert report["descriptors"]["sizes"]["recall@25"] > 0.8
    assert report["descriptors"]["sizes"]["auc_random"] > 0.8
    assert report["descriptors"]["sizes"]["auc_hard"] < report["descriptors"]["sizes"]["auc_random"]
    assert sum(report["descriptors"]["tiny"]["reliability"]["count"]) == 50
    assert json.loads((tmp_path / "report.json").read_text())["judged"] == 50
    for picture in ("roc", "recall", "reliability", "embedding-tiny"):
        assert (tmp_path / f"{picture}.png").read_bytes().startswith(b"\x89PNG")
    assert table(report).count("\n") == 7


def test_the_core_judges_as_pytorch_does(sets: dict[str, str], tmp_path: Path) -> None:
    """The same weights in both engines: descriptors differ by the random draw of 256 points only."""
    if importlib.util.find_spec("esm_py") is None:
        if os.environ.get("CI") == "true":
            pytest.fail("esm_py must be installed: uv sync --group core")
        pytest.skip("esm_py is not installed")
    sides = open_sides((sets["map"],), (sets["live"],), "test")
    weights = Path(__file__).parents[3] / "weights" / "esm-swift.safetensors"
    model, head, _ = load_network(weights)
    ours, cores = PyTorch("esm-swift", model, head, torch.device("cpu")), Core("core", weights)
    few = np.flatnonzero(sides.map.counts <= 256)[:20]
    assert len(few) > 3
    same, quality = ours(sides.map, few)
    values, probability = cores(sides.map, few)
    assert values.shape == same.shape and values.dtype == same.dtype
    spread = np.linalg.norm(same - same.mean(axis=0), axis=1).mean()
    assert np.linalg.norm(values - same, axis=1).mean() < 0.3 * spread
    np.testing.assert_allclose(probability, quality, atol=0.25)
    report = evaluate([ours, cores], sides, tmp_path)["descriptors"]
    assert abs(report["esm-swift"]["auc_random"] - report["core"]["auc_random"]) < 0.05
    with pytest.raises(TrainError, match="no-such"):
        Core("none", tmp_path / "no-such.safetensors")


def test_baselines_are_standardised_by_the_map(sets: dict[str, str]) -> None:
    sides = open_sides((sets["map"],), (sets["live"],), "test")
    mapped = baseline_descriptors(sides.map, sides.map_rows)["shape"]
    _, z = standardised(mapped, mapped)
    assert mapped.shape == (50, 13)
    np.testing.assert_allclose(z.mean(axis=0), 0.0, atol=1e-4)
    np.testing.assert_allclose(z.std(axis=0), 1.0, atol=1e-3)


def test_balance_finds_how_much_noise_should_weigh(sets: dict[str, str]) -> None:
    sides = open_sides((sets["map"],), (sets["live"],), "test")
    rng = np.random.default_rng(3)
    truth = rng.normal(size=(50, 6)).astype(np.float32)
    noise = rng.normal(size=(2, 50, 4)).astype(np.float32)
    live, mapped = (np.concatenate((noise[i], truth), axis=1) for i in (0, 1))
    factor, tried = balance(sides, live, mapped, 4)
    assert factor < 0.3, "noise is turned down"
    assert tried[f"{factor:.3f}"]["recall@1"] > tried["2.000"]["recall@1"]
    factor, _ = balance(sides, live[:, ::-1].copy(), mapped[:, ::-1].copy(), 6)
    assert factor == 2.0, "what tells is turned up"
