"""SegMap's encoder: its input, its size, its training, its file."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file

from esm_train.augment import NONE
from esm_train.cli import main
from esm_train.config import DataConfig
from esm_train.errors import TrainError
from esm_train.segmap.config import SegMapConfig, SegMapExport, SegMapRun, SegMapTraining, SegMapValidation
from esm_train.segmap.data import ClassBatches, choose_classes, grids_of
from esm_train.segmap.grid import GRID, fitted, occupancy
from esm_train.segmap.model import SegMapNet, Teacher, reconstruction_loss
from esm_train.segmap.trainer import SegMapTrainer, describe_grids, export, load_state
from esm_train.segmap.weights import load_segmap, write_segmap_golden
from esm_train.validation import open_corpus

Make = Callable[..., SegMapConfig]


@pytest.fixture
def make(sets: dict[str, str], tmp_path: Path) -> Make:
    def config(steps: int = 4, out: str = "run", workers: int = 0) -> SegMapConfig:
        return SegMapConfig(
            run=SegMapRun(out=str(tmp_path / out), workers=workers, log_every=1),
            data=DataConfig(train=(sets["train"],)),
            training=SegMapTraining(classes=12, min_observations=2, batch=8, steps=steps, warmup_steps=0),
            validation=SegMapValidation(map=(sets["map"],), live=(sets["live"],), every=2, max_live=10, max_map=20),
            export=SegMapExport(weights=str(tmp_path / "segmap.safetensors")),
        )

    return config


def test_the_grid_spans_large_things_and_keeps_small_ones_small() -> None:
    rng = np.random.default_rng(0)
    large = rng.uniform([-6.0, -3.0, 0.0], [6.0, 3.0, 4.0], (5000, 3)).astype(np.float32)
    cells, extents = fitted(large)
    assert np.allclose(np.sort(extents), [4.0, 6.0, 12.0], atol=0.7)
    assert (np.ptp(cells, axis=0) >= np.array(GRID) - 3).all()
    small = (large * 0.05).astype(np.float32)
    cells, extents = fitted(small)
    # 0.6 m in cells of at least 0.1 m.
    assert (np.ptp(cells, axis=0) <= 7).all() and extents.max() < 0.8
    grid, _ = occupancy(small)
    assert grid.sum() == len(cells) and grid[tuple(cells[0])] == 1


def test_one_point_is_in_the_middle() -> None:
    cells, extents = fitted(np.array([[3.0, 4.0, 5.0]], np.float32))
    assert cells.tolist() == [[15, 15, 7]] and extents.tolist() == [0.0, 0.0, 0.0]


def test_parameters_are_the_published_ones() -> None:
    encoder, teacher = SegMapNet(), Teacher(10, 0.0)
    trained = sum(p.numel() for n, p in encoder.named_parameters() if not n.startswith("bn2"))
    assert trained == 8_591_424
    decoder = sum(p.numel() for n, p in teacher.named_parameters() if not n.startswith("classes"))
    assert round(decoder / 1e6, 2) == 0.59


def test_the_reconstruction_rewards_the_right_cells() -> None:
    grid = torch.zeros(1, *GRID)
    grid[0, 3, 4, 5] = 1.0
    right = reconstruction_loss(20.0 * (grid - 0.5), grid)
    missing = reconstruction_loss(torch.full_like(grid, -10.0), grid)
    assert right < 1e-4 < missing
    # One occupied cell of 16,384, at 0.9 of its cross-entropy of about 10.
    assert float(missing - right) == pytest.approx(0.9 * 10.0 / 16384, rel=0.1)


def test_classes_are_drawn_from_the_kinds_in_turn(sets: dict[str, str]) -> None:
    corpus = open_corpus((sets["train"], sets["map"], sets["live"]), "train")
    corpus.places = ["wood:1", "street:2"]
    known, classes = choose_classes(corpus, 40, 2, 0)
    kinds = corpus.place[known.rows[known.starts[classes]]]
    assert len(set(classes.tolist())) == 40 and np.bincount(kinds).tolist() == [20, 20]
    with pytest.raises(TrainError, match="objects were seen 9 times"):
        choose_classes(corpus, 5, 9, 0)


def test_each_class_comes_once_a_round_with_one_of_its_views(sets: dict[str, str]) -> None:
    corpus = open_corpus((sets["train"],), "train")
    known, classes = choose_classes(corpus, 12, 2, 0)
    batches = ClassBatches(corpus, known, classes, NONE, 6, 0)
    grids = [batches[0], batches[1], batches[2]]
    assert sorted(torch.cat((grids[0].labels, grids[1].labels)).tolist()) == list(range(12))
    for cells, label in zip(grids[2].cells, grids[2].labels, strict=True):
        views = grids_of(corpus, known.of(int(classes[label]))).cells
        assert any(torch.equal(cells, view) for view in views)


def test_it_learns_and_resumes(make: Make) -> None:
    whole = SegMapTrainer(make(steps=30, out="whole"), resume=False)
    assert whole.run()
    losses = [h["loss"] for h in whole.history if "loss" in h]
    assert np.mean(losses[-5:]) < 0.6 * np.mean(losses[:3])
    assert all(0.0 <= h["recall@25"] <= 1.0 for h in whole.history if "recall@25" in h)
    first = SegMapTrainer(make(out="parts"), resume=False)
    assert first.run()
    with pytest.raises(TrainError, match="exists already"):
        SegMapTrainer(make(out="parts"), resume=False)
    other = make(out="parts")
    with pytest.raises(TrainError, match="another \\[training\\]"):
        SegMapTrainer(dataclasses.replace(other, training=dataclasses.replace(other.training, batch=4)), resume=True)
    # Another number of steps is no other training.
    second = SegMapTrainer(make(steps=6, out="parts", workers=1), resume=True)
    assert second.step == 4 and second.run() and second.step == 6


def test_the_file_holds_the_network(make: Make, sets: dict[str, str], tmp_path: Path) -> None:
    config = make()
    trainer = SegMapTrainer(config, resume=False)
    assert trainer.run()
    report = export(config)
    file = Path(report["weights"])
    assert report["bytes"] == file.stat().st_size < 18_000_000 and len(report["validation"]) == 2
    model, metadata = load_segmap(file)
    assert metadata["architecture"] == "segmap-cnn"
    corpus = open_corpus((sets["live"],), "live")
    grids = grids_of(corpus, np.arange(12))
    want, found = describe_grids(trainer.model, grids), describe_grids(model, grids)
    # Matrices are rounded to 11 bits.
    assert np.abs(want - found).max() < 2e-2 * np.abs(want).max()
    golden = tmp_path / "golden.safetensors"
    write_segmap_golden(file, (sets["live"],), 5, golden)
    stored = load_file(golden)
    columns = stored["columns"].reshape(5, 32, 32, 1) >> np.arange(16)
    again = describe_grids(
        model,
        dataclasses.replace(
            grids, cells=torch.from_numpy(columns.astype(np.uint8) & 1), extents=torch.from_numpy(stored["extents"])
        ),
    )
    assert np.abs(again - stored["descriptor"]).max() < 1e-5
    with pytest.raises(SystemExit) as ended:
        main(
            [
                "evaluate",
                "--weights",
                str(file),
                "--map",
                sets["map"],
                "--live",
                sets["live"],
                "-o",
                str(tmp_path / "e"),
            ]
        )
    assert ended.value.code == 0 and (tmp_path / "e" / "roc.png").exists()


def test_checkpoints_of_others_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "other.pt"
    torch.save({"format": "esm-checkpoint"}, file)
    with pytest.raises(TrainError, match="no checkpoint of esm-train segmap"):
        load_state(file)
