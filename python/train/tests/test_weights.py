"""The weights file and the golden activations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from esm_train.errors import TrainError
from esm_train.golden import golden_inputs, write_golden
from esm_train.model import EsmNet, QualityHead
from esm_train.plan import Plan, plan_for, tiny_plan
from esm_train.restated import forward, quality
from esm_train.run import random_network
from esm_train.weights import load_network, read_weights, to_weights, write_weights


def written(plan: Plan, file: Path) -> tuple[EsmNet, QualityHead]:
    torch.manual_seed(0)
    model, head = random_network(plan)
    write_weights(to_weights(model, head, {"training_data": "none"}), file)
    return model, head


@pytest.mark.parametrize(
    ("mode", "context"), [("none", False), ("beside", False), ("beside", True), ("fc", False), ("both", True)]
)
def test_round_trip(tmp_path: Path, mode: str, context: bool) -> None:
    model, head = written(tiny_plan(mode, context), tmp_path / "w.safetensors")
    again, head_again, metadata = load_network(tmp_path / "w.safetensors")
    assert again.plan == model.plan and metadata["training_data"] == "none"
    inputs = golden_inputs(model, 6, 0)
    with torch.no_grad():
        a = model(inputs.points, inputs.neighbours, inputs.measures)
        b = again(inputs.points, inputs.neighbours, inputs.measures)
        torch.testing.assert_close(a, b, atol=1e-5, rtol=1e-5)
        torch.testing.assert_close(head.probability(a), head_again.probability(b), atol=1e-5, rtol=0.0)
    assert list(tmp_path.iterdir()) == [tmp_path / "w.safetensors"]


def test_header_and_shapes_of_the_document(tmp_path: Path) -> None:
    written(plan_for("esm-swift", size_mode="both"), tmp_path / "w.safetensors")
    with safe_open(tmp_path / "w.safetensors", framework="numpy") as handle:
        m = handle.metadata()
        shapes = {name: tuple(handle.get_slice(name).get_shape()) for name in handle.keys()}  # noqa: SIM118
    assert (m["format"], m["format_version"], m["architecture"]) == ("esm-weights", "2", "xconv-4")
    assert m["neighbours"] == "8x1,12x3,16x3,16x4" and m["point_plan"] == "256,96,64,48"
    assert m["descriptor_dim"] == "22" and m["context"] == "rings-7x4"
    joined = 162 * 128 + 256
    assert m["parameters"] == str(300_328 + joined)
    assert shapes["xconv1.lift1.weight"] == (3, 16) and shapes["xconv4.x0.weight"] == (48, 256)
    assert shapes["xconv2.depthwise.weight"] == (12, 40, 2) and shapes["xconv2.pointwise.weight"] == (80, 64)
    assert shapes["xconv1.depthwise.weight"] == (8, 16, 4) and shapes["fc1.weight"] == (320, 256)
    assert shapes["fc1.size_weight"] == (6, 256) and shapes["fc3.weight"] == (128, 16)
    assert shapes["quality.weight"] == (22, 2) and shapes["size.weight"] == (6,)
    assert shapes["measures.mean"] == (34,) and shapes["join.weight"] == (162, 128)
    other = ("measures.", "size.", "quality.", "fc1.size")
    counted = sum(int(np.prod(s)) for n, s in shapes.items() if not n.startswith(other))
    assert counted == 300_328 + joined


def test_damaged_weights_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "w.safetensors"
    written(tiny_plan(), file)
    good = read_weights(file)
    tensors, metadata = dict(good.tensors), dict(good.metadata)

    def refused(tensors: dict[str, np.ndarray], metadata: dict[str, str], message: str) -> None:
        save_file(tensors, file, metadata=metadata)
        with pytest.raises(TrainError, match=message):
            load_network(file)

    refused({**tensors, "fc3.bias": np.full(8, np.nan, np.float32)}, metadata, "fc3.bias: not finite")
    refused({**tensors, "fc3.bias": np.zeros(9, np.float32)}, metadata, "another shape: fc3.bias")
    refused({n: t for n, t in tensors.items() if n != "fc3.bias"}, metadata, "missing.*fc3.bias")
    refused({**tensors, "more": np.zeros(1, np.float32)}, metadata, "unknown.*more")
    refused(tensors, {**metadata, "format_version": "1"}, "version '1'")
    refused(tensors, {**metadata, "point_plan": "8,4"}, "header")
    refused(tensors, {**metadata, "architecture": "xconv-5"}, "architecture 'xconv-5'")
    for temperature in ("-1", "0", "nan", "warm"):
        refused(tensors, {**metadata, "quality_temperature": temperature}, "quality_temperature")
    refused(
        {**tensors, "measures.std": np.zeros_like(tensors["measures.std"])}, metadata, r"measures\.std: not all above 0"
    )
    file.write_bytes(b"\x00" * 100)
    with pytest.raises(TrainError, match=r"w\.safetensors"):
        load_network(file)


def test_others_may_read_what_is_written(tmp_path: Path) -> None:
    plain, file = tmp_path / "plain", tmp_path / "w.safetensors"
    plain.touch()
    written(tiny_plan(), file)
    assert file.stat().st_mode == plain.stat().st_mode


def test_weights_with_nan_are_not_written() -> None:
    model, head = random_network(tiny_plan())
    with torch.no_grad():
        model.fc3_bias[0] = torch.nan
    with pytest.raises(TrainError, match=r"fc3\.bias is not finite"):
        to_weights(model, head, {})


def test_golden_activations_are_small_and_right(tmp_path: Path) -> None:
    plan = plan_for("esm-swift")
    model, head = written(plan, tmp_path / "w.safetensors")
    size = write_golden(model, head, tmp_path / "w.safetensors", tmp_path / "g.safetensors", count=24, seed=0)
    assert size < 1_000_000
    g = load_file(tmp_path / "g.safetensors")
    tensors = read_weights(tmp_path / "w.safetensors").tensors
    row = 3  # of fewer than 256 points
    want = forward(g["points"][row], g["measures"][row], plan, tensors)
    assert len(np.unique(g["points"][row], axis=0)) < 256
    for number in range(4):
        assert (g[f"xconv{number + 1}.neighbours"][row] == want.neighbours[number][:8]).all()
        np.testing.assert_allclose(g[f"xconv{number + 1}.out"][row], want.xconv[number][:8], atol=2e-4)
        np.testing.assert_allclose(g[f"xconv{number + 1}.mean"][row], want.xconv[number].mean(axis=0), atol=2e-4)
    np.testing.assert_allclose(g["global.out"][row], want.absolute[:8], atol=1e-5)
    np.testing.assert_allclose(g["fc1.out"][row], want.fc1[:8], atol=1e-4)
    np.testing.assert_allclose(g["fc2.mean"][row], want.pooled, atol=1e-5)
    np.testing.assert_allclose(g["descriptor"][row], want.descriptor, atol=2e-5)
    assert g["quality"][row] == pytest.approx(quality(want.descriptor, tensors, head.temperature), abs=1e-5)
