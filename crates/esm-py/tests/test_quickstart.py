"""What the READMEs show runs as it stands."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[1]


def blocks(readme: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", readme.read_text(), re.DOTALL)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the quickstart runs; it simulates what it needs."""
    return tmp_path_factory.mktemp("quickstart")


def test_the_quickstart_is_the_example() -> None:
    [quickstart] = blocks(PROJECT / "README.md", "python")
    assert quickstart == (PROJECT / "examples" / "quickstart.py").read_text()
    assert len(quickstart.splitlines()) <= 36


def test_the_quickstart_runs(street: Path) -> None:
    command = [sys.executable, str(PROJECT / "examples" / "quickstart.py")]
    ran = subprocess.run(command, cwd=street, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    located, clouds = map(int, re.findall(r"(\d+) of (\d+) clouds located", ran.stdout)[0])
    assert 0.8 * clouds < located <= clouds
    assert (street / "wood.png").read_bytes().startswith(b"\x89PNG")


def test_the_readme_of_the_repository_runs(street: Path) -> None:
    [snippet] = blocks(PROJECT.parents[1] / "README.md", "python")
    (street / "snippet.py").write_text(snippet)
    ran = subprocess.run([sys.executable, "snippet.py"], cwd=street, capture_output=True, text=True, check=False)
    assert ran.returncode == 0 and "located" in ran.stdout, ran.stdout + ran.stderr
