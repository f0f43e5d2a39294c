"""The peers' forests: pairs, features, and the trees as they are written."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from sklearn.ensemble import RandomForestClassifier

from esm_train.errors import TrainError
from esm_train.forest.features import KINDS, describe, pair_features
from esm_train.forest.grow import Side, described, forest_tensors, make_pairs
from esm_train.metrics import FAR_M
from esm_train.validation import open_corpus

PROGRAM = """#!{python}
import sys, struct
import numpy as np
data = sys.stdin.buffer.read()
(n,) = struct.unpack("<I", data[:4])
counts = np.frombuffer(data, "<u4", n, 4)
points = np.frombuffer(data, "<f4", offset=4 + 4 * n).reshape(-1, 3)
parts = np.split(points, np.cumsum(counts)[:-1])
dim = {{"eigen": 7, "esf": 640, "gestalt": 66}}[sys.argv[1]]
rows = np.stack([np.resize(np.ptp(p, axis=0), dim) for p in parts]).astype("<f4")
sys.stdout.buffer.write(struct.pack("<I", dim) + rows.tobytes())
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """Stands in for the Rust program: extents, over and over."""
    file = tmp_path / "describe"
    file.write_text(PROGRAM.format(python=sys.executable))
    file.chmod(0o755)
    return file


def test_features_of_a_pair() -> None:
    live = np.concatenate((np.arange(1.0, 8.0), np.full(640, 1 / 640)))[None].astype(np.float32)
    mapped = np.concatenate((np.arange(1.0, 8.0) * 2.0, np.zeros(640)))[None].astype(np.float32)
    row = pair_features(live, mapped, 7)[0]
    assert row.shape == (45,)
    assert row[:7].tolist() == live[0, :7].tolist()
    assert np.allclose(row[7:14], 0.5) and np.allclose(row[14:21], 1.0)
    assert row[21:28].tolist() == live[0, :7].tolist() and row[28:35].tolist() == mapped[0, :7].tolist()
    assert (row[35:] == 0.0).all()
    assert np.allclose(pair_features(live, live, 7)[0, 35:], 0.1)
    assert pair_features(live[:, :66], mapped[:, :66], 66).shape == (1, 330)


def test_a_missing_or_failing_program_is_told(sets: dict[str, str], program: Path, tmp_path: Path) -> None:
    corpus = open_corpus((sets["map"],), "map")
    with pytest.raises(TrainError, match="cargo build"):
        describe(tmp_path / "none", "eigen", corpus, np.arange(3))
    with pytest.raises(TrainError, match="KeyError"):
        describe(program, "magic", corpus, np.arange(3))
    rows = describe(program, "eigen", corpus, np.arange(3))
    assert rows.shape == (3, 7) and np.allclose(rows[1, :3], np.ptp(corpus.segment(1), axis=0))


def test_pairs_are_what_they_are_said_to_be(sets: dict[str, str], program: Path) -> None:
    corpus = open_corpus((sets["train"],), "train")
    side = described(program, KINDS["segmatch"], corpus, 150, 0)
    assert isinstance(side, Side) and 150 <= len(side.rows) <= 153 and side.values.shape[1] == 647
    pairs = make_pairs(side, 7, 400, 0)
    a, b = side.rows[pairs.first], side.rows[pairs.second]
    same = corpus.object[a] == corpus.object[b]
    assert (same == pairs.same).all() and pairs.same.sum() == 200 and 150 <= (~pairs.same).sum() <= 200
    assert (corpus.observation[a] != corpus.observation[b])[pairs.same].all()
    apart = np.linalg.norm(corpus.centroid_map[a] - corpus.centroid_map[b], axis=1)
    assert (apart[~pairs.same] >= FAR_M).all()


def test_the_written_trees_answer_as_the_forest_does() -> None:
    rng = np.random.default_rng(3)
    x = rng.normal(size=(2000, 6)).astype(np.float32)
    y = (x[:, 0] * x[:, 1] + 0.3 * rng.normal(size=2000)) > 0.0
    forest = RandomForestClassifier(n_estimators=7, min_samples_leaf=5, random_state=0).fit(x, y)
    t = forest_tensors(forest)
    asked = rng.normal(size=(300, 6)).astype(np.float32)
    # Rows that lie on splits.
    inner = np.flatnonzero(t["feature"] >= 0)[:50]
    for row, node in zip(asked, inner, strict=False):
        row[int(t["feature"][node])] = t["split"][node]

    def walk(row: np.ndarray, node: int) -> float:
        while t["feature"][node] >= 0:
            left = row[int(t["feature"][node])] <= t["split"][node]
            follow = int(t["left"][node] if left else t["right"][node])
            assert follow > node
            node = follow
        return float(t["split"][node])

    found = [np.mean([walk(row, int(root)) for root in t["roots"]]) for row in asked]
    assert np.allclose(found, forest.predict_proba(asked)[:, 1], atol=1e-6)
