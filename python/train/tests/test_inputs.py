"""Sizes, sampling, normalisation, augmentation, batches."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from esm_train.augment import NONE, Augmentation, augment
from esm_train.config import BatchConfig
from esm_train.corpus import BatchSampler, Corpus, identities
from esm_train.errors import TrainError
from esm_train.inputs import TrainingBatches, inference_inputs
from esm_train.plan import tiny_plan
from esm_train.sampling import normalise, rng_of_points, sample
from esm_train.segments import SegmentSet, SegmentWriter
from esm_train.sizes import eigen_features, lengths, metric_sizes


def box(yaw: float) -> np.ndarray:
    """4 x 2 x 1.5 m, as the test of the core's `shape` has it."""
    i, j, k = np.meshgrid(np.arange(21), np.arange(11), np.arange(11), indexing="ij")
    x, y, z = 4.0 * (i / 20 - 0.5), 2.0 * (j / 10 - 0.5), 1.5 * k / 10
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack((c * x - s * y, s * x + c * y, z), axis=-1).reshape(-1, 3).astype(np.float32)


def test_sizes_are_metric_and_do_not_turn() -> None:
    both = np.concatenate((box(0.0), box(1.1)))
    offsets = np.array([0, len(both) // 2, len(both)])
    rows = lengths(both, offsets)
    np.testing.assert_allclose(rows[0, 3:], [1.5, 4.0, 2.0], atol=1e-5)
    np.testing.assert_allclose(rows[0], rows[1], atol=1e-4)
    covariance = np.cov(box(0.4).T.astype(np.float64), bias=True)
    np.testing.assert_allclose(rows[0, :3], np.sqrt(np.linalg.eigvalsh(covariance)[::-1]), atol=1e-5)
    sizes = metric_sizes(both, offsets, np.array([np.nan, 1.0], np.float32), ("height", "above_ground"))
    np.testing.assert_allclose(sizes, [[np.log(1.6), np.nan], [np.log(1.6), np.log(2.0)]], atol=1e-5)


def test_eigen_features_of_a_line_a_plate_and_a_ball() -> None:
    rng = np.random.default_rng(0)
    parts = [rng.normal(size=(4000, 3)) * s for s in ([1, 1e-3, 1e-3], [1, 1, 1e-3], [1, 1, 1])]
    f = eigen_features(np.concatenate(parts).astype(np.float32), np.array([0, 4000, 8000, 12000]))
    assert f[0, 0] > 0.99 and f[1, 1] > 0.9 and f[2, 2] > 0.9
    assert f[2, 5] == pytest.approx(np.log(3), abs=0.01)


@settings(max_examples=30, deadline=None)
@given(n=st.integers(1, 600), seed=st.integers(0, 100))
def test_sampling(n: int, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(n, 3)).astype(np.float32)
    got = sample(points, 256, rng_of_points(points))
    assert got.shape == (256, 3)
    index = {tuple(p): i for i, p in enumerate(points.tolist())}
    rows = [index[tuple(p)] for p in got.tolist()]
    assert len(set(rows)) == min(n, 256)
    # Without repetition at first: any leading part is a uniform sample.
    assert len(set(rows[: min(n, 256)])) == min(n, 256)
    assert (got == sample(points, 256, rng_of_points(points))).all()


def test_normalisation() -> None:
    x = normalise((np.random.default_rng(0).normal(size=(256, 3)) * [1, 2, 3] + 50.0).astype(np.float32))
    np.testing.assert_allclose(x.mean(axis=0), 0.0, atol=1e-6)
    assert float((x.astype(np.float64) ** 2).mean()) == pytest.approx(1.0, abs=1e-6)
    assert x.std(axis=0)[2] > 2 * x.std(axis=0)[0]
    for turned in (False, True):
        same = normalise(np.full((256, 3), 7.0, np.float32), turned)
        assert (same == 0.0).all()


@settings(max_examples=30, deadline=None)
@given(angle=st.floats(-7.0, 7.0))
def test_headings_do_not_matter_to_what_is_turned(angle: float) -> None:
    rng = np.random.default_rng(1)
    thing = np.stack((4.0 * rng.random(256) * rng.random(256), rng.random(256), 2.0 * rng.random(256)), axis=1)
    c, s = np.cos(angle), np.sin(angle)
    other = thing @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    first, second = (normalise(p.astype(np.float32), turned=True) for p in (thing, other))
    np.testing.assert_allclose(first, second, atol=1e-4)
    assert first.std(axis=0)[0] > first.std(axis=0)[1]
    assert not np.allclose(normalise(thing.astype(np.float32)), first, atol=1e-2)


@settings(max_examples=60, deadline=None)
@given(n=st.integers(25, 400), seed=st.integers(0, 10_000))
def test_augmentation_keeps_enough_of_the_object(n: int, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-3.0, 3.0, (n, 3)).astype(np.float32)
    how = Augmentation(partial_probability=1.0, density_probability=0.5)
    got = augment(points, how, np.random.default_rng(seed))
    assert got.dtype == np.float32 and 25 <= len(got) <= n and np.isfinite(got).all()
    assert np.linalg.norm(got, axis=1).max() < np.linalg.norm(points, axis=1).max() + 0.3
    assert (got == augment(points, how, np.random.default_rng(seed))).all()


def test_augmentation_by_yaw_alone_turns_about_the_up_axis() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    got = augment(points, dataclasses.replace(NONE, yaw=True), np.random.default_rng(1))
    np.testing.assert_allclose(got[:, 2], points[:, 2], atol=1e-6)
    np.testing.assert_allclose(np.hypot(got[:, 0], got[:, 1]), np.hypot(points[:, 0], points[:, 1]), atol=1e-5)
    assert np.abs(got - points).max() > 0.1
    assert (augment(points, NONE, np.random.default_rng(1)) == points).all()


def test_partial_views_hide_parts() -> None:
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (1000, 3)).astype(np.float32)
    how = dataclasses.replace(NONE, partial_probability=1.0, partial_keep=0.5)
    left = [len(augment(points, how, np.random.default_rng(s))) for s in range(100)]
    assert min(left) < 600 and max(left) > 900 and min(left) >= 490


def test_batches_hold_pairs_of_different_observations(sets: dict[str, str]) -> None:
    corpus = Corpus([SegmentSet(Path(sets["train"]))])
    sampler = BatchSampler(corpus, BatchConfig(classes=16), 3)
    rows = sampler.rows(0).reshape(16, 2)
    assert (corpus.object[rows[:, 0]] == corpus.object[rows[:, 1]]).all()
    assert (corpus.observation[rows[:, 0]] != corpus.observation[rows[:, 1]]).all()
    assert len(np.unique(corpus.object[rows[:, 0]])) == 16
    assert (sampler.rows(0).reshape(16, 2) == rows).all()
    assert not (sampler.rows(1) == sampler.rows(0)).all()
    assert not (sampler.rows(0, rank=1) == sampler.rows(0)).all()
    with pytest.raises(TrainError, match="60 objects were seen in two observations"):
        BatchSampler(corpus, BatchConfig(classes=61), 3)


def test_pairs_alike_in_fullness_where_there_are_such(sets: dict[str, str]) -> None:
    corpus = Corpus([SegmentSet(Path(sets["train"]))])
    # Three views of each object: two full ones and a thin one.
    corpus.counts = np.where(corpus.observation % 3 == 2, 50, 400 + corpus.observation % 3)
    assert {len(np.unique(corpus.counts[corpus.object == o])) for o in np.unique(corpus.object)} == {3}

    def like(share: float) -> float:
        sampler = BatchSampler(corpus, BatchConfig(classes=40, alike_fullness=share, across_visits=0.0), 0)
        pairs = np.concatenate([corpus.counts[sampler.rows(step)].reshape(40, 2) for step in range(4)])
        return float((np.abs(np.log(pairs[:, 0] / pairs[:, 1])) < np.log(2.0)).mean())

    # Of two at random a third are the full ones; with a full one first, its like comes second.
    assert 0.2 < like(0.0) < 0.5
    assert 0.55 < like(1.0) < 0.8


def test_unknown_objects_and_single_views_are_no_identities(sets: dict[str, str]) -> None:
    corpus = Corpus([SegmentSet(Path(sets["train"]))])
    corpus.object = corpus.object.copy()
    corpus.object[:3] = -1  # the first object
    corpus.object[3] = 1_000  # a view of the second goes elsewhere
    corpus.object[6:8] = [2_000, 3_000]  # two of the third's three views
    groups = identities(corpus)
    assert len(groups) == 58
    assert sorted(groups.of(0).tolist()) == [4, 5]
    assert not set(groups.rows.tolist()) & {0, 1, 2, 3, 6, 7, 8}


def test_the_same_object_in_two_sets_is_one(sets: dict[str, str]) -> None:
    corpus = Corpus([SegmentSet(Path(sets["map"])), SegmentSet(Path(sets["live"]))])
    assert len(identities(corpus)) == 50
    assert len(identities(Corpus([SegmentSet(Path(sets["map"]))]))) == 0


def test_hard_groups_are_alike_in_class_and_size(sets: dict[str, str]) -> None:
    corpus = Corpus([SegmentSet(Path(sets["train"]))])
    even = BatchSampler(corpus, BatchConfig(classes=8), 0)
    hard = BatchSampler(corpus, BatchConfig(classes=8, hard_fraction=1.0, hard_group=4, hard_tolerance=0.6), 0)

    def alike(sampler: BatchSampler) -> int:
        count = 0
        for step in range(20):
            first = sampler.rows(step)[::2]
            log = np.log(corpus.lengths(first)[:, 3:])
            near = np.abs(log[:, None] - log[None]).max(axis=2) < np.log(1.7)
            count += int((near & (corpus.label[first][:, None] == corpus.label[first][None])).sum()) - len(first)
        return count

    assert alike(hard) > 2 * alike(even)


def test_a_batch_is_a_function_of_its_step(sets: dict[str, str]) -> None:
    corpus = Corpus([SegmentSet(Path(sets["train"]))])
    batches = TrainingBatches(
        BatchSampler(corpus, BatchConfig(classes=4), 0), tiny_plan(), Augmentation(), rank=0, lists=True
    )
    a, b, c = batches[5], batches[5], batches[6]
    assert torch.equal(a.points, b.points) and torch.equal(a.measures, b.measures)
    assert all(torch.equal(x, y) for x, y in zip(a.neighbours, b.neighbours, strict=True))
    assert not torch.equal(a.points, c.points)
    assert a.points.shape == (8, 32, 3) and a.measures.shape == (8, 6)


def test_inference_does_not_depend_on_the_company(sets: dict[str, str]) -> None:
    corpus = Corpus([SegmentSet(Path(sets["map"]))])
    together = inference_inputs(corpus, np.array([3, 1, 2]), tiny_plan())
    alone = inference_inputs(corpus, np.array([1]), tiny_plan())
    assert torch.equal(together.points[1], alone.points[0])
    torch.testing.assert_close(together.measures[1], alone.measures[0], atol=1e-6, rtol=0.0)


def own_memory() -> int:
    """Bytes of this process's own pages; mapped files do not count."""
    text = Path("/proc/self/status").read_text()
    return 1024 * next(int(line.split()[1]) for line in text.splitlines() if line.startswith("RssAnon"))


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads Linux's /proc")
def test_sampling_does_not_hold_the_points_in_memory(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cloud = rng.normal(size=(250, 3)).astype(np.float32)
    writer = SegmentWriter(tmp_path / "large", places=["a"], classes=[], voxel_m=0.2, source="")
    for i in range(20_000):
        writer.add(cloud, centroid_map=np.array([float(i), 0.0, 0.0]), object_id=i // 2, observation=i % 2)
    writer.close()
    size = (tmp_path / "large" / "points.npy").stat().st_size
    assert size == 128 + 20_000 * 250 * 12
    before = own_memory()
    corpus = Corpus([SegmentSet(tmp_path / "large")])
    sampler = BatchSampler(corpus, BatchConfig(classes=64), 0)
    batches = TrainingBatches(sampler, tiny_plan(), NONE, rank=0, lists=True)
    seen: set[int] = set()
    for step in range(40):
        seen.update(sampler.rows(step).tolist())
        assert len(batches[step]) == 128
    assert len(seen) > 4000
    assert own_memory() - before < size // 3
