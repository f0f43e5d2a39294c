"""The configuration and the commands."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from esm_train.cli import main
from esm_train.config import Config, defaults_as_toml, load_config
from esm_train.errors import TrainError


def test_defaults_read_back(tmp_path: Path) -> None:
    text = defaults_as_toml()
    assert "# Uniform rotation about the up axis." in text
    file = tmp_path / "c.toml"
    file.write_text(text)
    read = load_config(file)
    assert read.optim == Config().optim and read.augment == Config().augment and read.loss == Config().loss
    assert read.run.out == str(tmp_path / "runs/esm-swift")
    assert set(tomllib.loads(text)) == set(Config.__dataclass_fields__)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[optim]\nstep = 3", r"unknown key optim.step(.|\n)*steps"),
        ("[optimiser]\nsteps = 3", "unknown key optimiser"),
        ("[optim]\nsteps = 'many'", "optim.steps = 'many': expected int"),
        ("[optim]\nsteps = true", "optim.steps = True: expected int"),
        ("[network]\nvariant = 'esm-huge'", "network.variant = 'esm-huge': expected esm-paper or esm"),
        ("[data]\ntrain = 'x'", "data.train = 'x': expected a list"),
        ("run = 3", "run is no table"),
        ("[run", "c.toml"),
    ],
)
def test_wrong_configurations(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "c.toml"
    file.write_text(text)
    with pytest.raises(TrainError, match=message):
        load_config(file)


def test_overrides(tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text("[optim]\nsteps = 5\n")
    config = load_config(file, ["optim.steps=9", "network.variant=esm-paper", "network.points=[256, 96, 64, 48]"])
    assert config.optim.steps == 9
    assert config.plan().points == (256, 96, 64, 48) and config.plan().size_mode == "none"
    with pytest.raises(TrainError, match=r"\[network\]: layer 4 needs 64"):
        load_config(file, ["network.points=[256, 96, 48, 48]"]).plan()


@pytest.mark.parametrize("variant", ["esm-swift", "esm", "esm-paper"])
def test_shipped_configurations(variant: str) -> None:
    config = load_config(Path(__file__).parent.parent / "configs" / f"{variant}.toml")
    assert config.plan().variant == variant
    assert config.run.out.endswith(f"runs/{variant}")


def code_of(arguments: list[str]) -> int:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    return int(end.value.code or 0)


def test_from_nothing_to_judged_weights(
    sets: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "c.toml"
    file.write_text(
        f"""
        [run]
        out = "run"
        workers = 0
        threads = 1
        [data]
        train = ["{sets["train"]}"]
        [batch]
        classes = 4
        [optim]
        steps = 3
        [validation]
        map = ["{sets["map"]}"]
        live = ["{sets["live"]}"]
        """
    )
    assert code_of(["run", "--config", str(file), "--set", "optim.steps=2"]) == 0
    out = capsys.readouterr().out
    assert "| esm-swift |" in out and "| eigen |" in out
    weights = tmp_path / "run" / "weights.safetensors"
    assert code_of(["golden", "--weights", str(weights), "-o", str(tmp_path / "g.safetensors")]) == 0
    assert code_of(["init", "--variant", "esm-paper", "-o", str(tmp_path / "i.safetensors")]) == 0
    assert (tmp_path / "i.safetensors").stat().st_size > 1_200_000


def test_errors_are_one_message_and_code_two(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert code_of(["check", str(tmp_path / "none")]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith("error: ") and "meta.json is missing" in shown and "\nhint: " in shown
    assert code_of(["train", "--config", str(tmp_path / "none.toml")]) == 2
    assert code_of(["init", "--variant", "esm-huge", "-o", str(tmp_path / "x")]) == 2


def test_check_and_synthetic(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert code_of(["synthetic", "--objects", "8", "-o", str(tmp_path / "set")]) == 0
    assert code_of(["check", str(tmp_path / "set")]) == 0
    assert "16 segments" in capsys.readouterr().out
