"""The stubs say what the module is, word by word."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import esm_py
from esm_py import _native

PROJECT = Path(__file__).parents[1]
STUB = PROJECT / "python" / "esm_py" / "_native.pyi"


def test_stubs_agree_with_the_module() -> None:
    command = [sys.executable, "-m", "mypy.stubtest", "esm_py", "--mypy-config-file", "pyproject.toml"]
    ran = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr


def test_a_wrong_stub_is_noticed(tmp_path: Path) -> None:
    """So that the test above can fail."""
    package = tmp_path / "esm_py"
    package.mkdir()
    for file in STUB.parent.glob("*.py*"):
        (package / file.name).write_text(file.read_text().replace("voxel_m: float, source", "voxels: float, source"))
    command = [sys.executable, "-m", "mypy.stubtest", "esm_py", "--mypy-config-file", str(PROJECT / "pyproject.toml")]
    environment = {"MYPYPATH": str(tmp_path), "PATH": ""}
    ran = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False, env=environment)
    assert ran.returncode != 0 and "voxels" in ran.stdout, ran.stdout


def documented(tree: ast.Module) -> dict[str, str]:
    docs = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            docs[node.name] = ast.get_docstring(node) or ""
        if isinstance(node, ast.ClassDef):
            for member in node.body:
                if isinstance(member, ast.FunctionDef) and not member.name.startswith("_"):
                    docs[f"{node.name}.{member.name}"] = ast.get_docstring(member) or ""
    return docs


def test_docstrings_are_those_of_the_stubs() -> None:
    docs = documented(ast.parse(STUB.read_text()))
    assert len(docs) > 200
    for name, doc in docs.items():
        thing: Any = _native
        for part in name.split("."):
            thing = inspect.getattr_static(thing, part)
        if isinstance(thing, staticmethod):
            thing = thing.__func__
        assert doc and inspect.getdoc(thing) == doc, name


def test_all_of_the_module_is_public() -> None:
    native = {n for n in dir(_native) if not n.startswith("_")} | {"__version__"}
    assert native <= set(esm_py.__all__) and set(_native.__all__) == native
    assert all(hasattr(esm_py, name) for name in esm_py.__all__)
    assert (STUB.parent / "py.typed").exists()
    assert esm_py.__version__.count(".") == 2
