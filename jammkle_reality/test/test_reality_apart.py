"""The reality stands apart: nothing of the simulator that is judged by it is in it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import jammkle_reality

FILES = sorted(Path(next(iter(jammkle_reality.__path__))).glob("*.py"))
OWN = "jammkle_reality"
ELSE = ("jammkle_common", "numpy", "scipy", "numba")
"""Facts that packages share, and libraries of numbers."""


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_reality_shares_no_code_with_the_simulator(file: Path) -> None:
    """No file imports physics, rigs, gap, fit or core, nor MuJoCo: only itself, shared facts and numbers."""
    found = []
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            found.append(str(node.module))
    others = {name.split(".")[0] for name in found if name.startswith(("jammkle_", "mujoco", *ELSE))}
    assert others <= {OWN, *ELSE}
