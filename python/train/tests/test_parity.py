"""The Rust network against this one on the weights that are shipped: simulated and real segments."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest
import torch
from conftest import needed

from esm_train.golden import write_answers, write_golden
from esm_train.plan import VARIANTS
from esm_train.validation import open_corpus
from esm_train.weights import load_network

REPOSITORY = Path(__file__).parents[3]
SHARED = Path(os.environ.get("ESM_SHARED_DATA", REPOSITORY.parent / "shared" / "data"))
TOLERANCE = 1e-4


def differences(weights: Path, golden: Path, program: str) -> dict[str, float]:
    done = subprocess.run([program, str(weights), str(golden)], check=True, capture_output=True, text=True)
    report: dict[str, float] = json.loads(done.stdout)
    return report


@pytest.mark.parametrize("variant", VARIANTS)
def test_simulated_segments(variant: str, tmp_path: Path) -> None:
    program = needed("ESM_FORWARD")
    weights = REPOSITORY / "weights" / f"{variant}.safetensors"
    model, head, _ = load_network(weights)
    write_golden(model, head, weights, tmp_path / "golden.safetensors", count=300, seed=5)
    report = differences(weights, tmp_path / "golden.safetensors", program)
    assert report["segments"] == 300
    assert report["descriptor_off"] <= TOLERANCE
    assert report["quality_off"] <= TOLERANCE


def test_real_segments(tmp_path: Path) -> None:
    program, cli = needed("ESM_FORWARD"), needed("ESM_CLI")
    query = SHARED / "kitti00" / "query.mcap"
    if not query.exists():
        if os.environ.get("CI") == "true":
            pytest.fail(f"{query} must be there")
        pytest.skip(f"{query} is not there")
    cut = [cli, "segments", str(query), "--accumulate", "20", "--step", "12", "-o", str(tmp_path / "set")]
    subprocess.run(cut, check=True, capture_output=True)
    corpus = open_corpus((str(tmp_path / "set"),), "test")
    torch.set_num_threads(2)
    for variant in VARIANTS:
        weights = REPOSITORY / "weights" / f"{variant}.safetensors"
        model, head, _ = load_network(weights)
        write_answers(model, head, weights, corpus, tmp_path / f"{variant}.answers", 1000)
        report = differences(weights, tmp_path / f"{variant}.answers", program)
        assert report["segments"] == 1000
        assert report["descriptor_off"] <= TOLERANCE
        assert report["quality_off"] <= TOLERANCE
    torch.set_num_threads(1)
