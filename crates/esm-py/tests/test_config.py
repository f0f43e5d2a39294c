"""Configurations: the same keys as the command line's."""

from __future__ import annotations

import pickle
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import esm_py
from conftest import Cli
from esm_py.errors import ConfigError, MissingFileError


def test_text_file_and_dictionary_are_one(tmp_path: Path) -> None:
    text = 'seed = 7\ndescriptor = "eigen"\n[accumulate]\ndistance_m = 6\n[segment.ground]\nband = 0.25\n'
    path = tmp_path / "esm.toml"
    path.write_text(text)
    settings = {
        "seed": np.int64(7),
        "descriptor": "eigen",
        "accumulate": {"distance_m": 6},
        "segment": {"ground": {"band": np.float64(0.25)}},
    }
    one, two, three = esm_py.Config.from_toml(text), esm_py.Config.read(path), esm_py.Config(settings)
    assert one == two == three and hash(one) == hash(three)
    assert (one.seed, one.descriptor) == (7, "eigen")
    assert one != esm_py.Config() and one != "config"
    assert one.to_dict()["segment"]["ground"]["band"] == 0.25
    assert esm_py.Config.from_toml(one.to_toml()) == one
    assert esm_py.Config(one.to_dict()) == one
    assert pickle.loads(pickle.dumps(one)) == one
    assert eval(repr(one), {"Config": esm_py.Config}) == one
    assert repr(esm_py.Config()) == "Config()"


def test_replace_changes_what_is_given() -> None:
    config = esm_py.Config({"segment": {"voxel": 0.3, "ground": {"band": 0.2}}})
    other = config.replace({"segment": {"ground": {"max_slope": 0.5}}})
    assert other == esm_py.Config({"segment": {"voxel": 0.3, "ground": {"band": 0.2, "max_slope": 0.5}}})
    assert config == esm_py.Config({"segment": {"voxel": 0.3, "ground": {"band": 0.2}}})


def test_defaults_are_those_of_the_command_line(cli: Cli) -> None:
    assert tomllib.loads(cli.run("config")) == esm_py.Config().to_dict()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[accumulate]\ndistance = 5.0\n", "the configuration:2: unknown field `distance`, expected"),
        ("nonsense = 1\n", "the configuration:1: unknown field `nonsense`"),
        ("seed = -1\n", "the configuration:1: invalid value"),
        ("seed =\n", "the configuration:1: "),
        ("[segment]\nvoxel = nan\n", "segment.voxel = NaN is not allowed"),
        ('descriptor = "magic"\n', "descriptor = magic is not allowed"),
    ],
)
def test_what_is_no_configuration_is_refused(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        esm_py.Config.from_toml(text)
    assert words in str(caught.value) and isinstance(caught.value, ValueError)


def test_the_field_is_told() -> None:
    with pytest.raises(ConfigError) as caught:
        esm_py.Config({"segment": {"min_points": 0}})
    error = caught.value
    assert (error.field, error.value, error.allowed) == ("segment.min_points", "0", "at least 1")
    with pytest.raises(ConfigError, match=r"unknown field `voxels`.*\nhint: `esm-cli config` prints every key"):
        esm_py.Config({"segment": {"voxels": 0.2}})


def deep() -> dict[str, Any]:
    inner: dict[str, Any] = {}
    inner["segment"] = inner
    return inner


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({1: 2}, TypeError),
        ({"seed": object()}, TypeError),
        ({"seed": None}, TypeError),
        ({"seed": 2**70}, ValueError),
        ({"seed": 1.5}, ConfigError),
        ({"seed": True}, ConfigError),
        ({"segment": 5}, ConfigError),
        ({"segment": {"voxel": [1, {"a": 2}]}}, ConfigError),
        (deep(), ValueError),
        ([("seed", 1)], TypeError),
        ("seed = 1", TypeError),
    ],
)
def test_dictionaries_of_other_things_are_refused(settings: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        esm_py.Config(settings)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="esm.toml: reading the configuration: "):
        esm_py.Config.read(tmp_path / "esm.toml")
    (tmp_path / "bin").write_bytes(b"seed = 1\n\xff\n")
    with pytest.raises(ConfigError, match="bin:2: this is not UTF-8"):
        esm_py.Config.read(tmp_path / "bin")
    (tmp_path / "big").write_bytes(b"#" * (2 << 20))
    with pytest.raises(ConfigError, match="larger than a configuration can be"):
        esm_py.Config.read(tmp_path / "big")
    with pytest.raises(OSError, match="reading the configuration"):
        esm_py.Config.read(tmp_path)
