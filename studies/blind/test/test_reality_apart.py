"""The second simulator stands apart: nothing of the simulator that is judged by it is in it."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

from studies.blind import reality

FILES = sorted(Path(next(iter(reality.__path__))).glob("*.py"))
KNOWN = {*sys.stdlib_module_names, "numpy", "scipy", "numba"}
"""Libraries of numbers."""
FACTS = ("studies.blind.reality", "jammkle_common.names", "jammkle_common.constants")
"""What it may take from this project: itself, and facts that packages share."""


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_reality_shares_no_code_with_the_simulator(file: Path) -> None:
    """No file imports physics, rigs or diagnosis, nor MuJoCo: only itself, names, constants and numbers."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            assert {alias.name.split(".")[0] for alias in node.names} <= KNOWN
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            module = str(node.module)
            of_names = {f"{module}.{alias.name}" for alias in node.names} if module == "jammkle_common" else {module}
            assert module.split(".", maxsplit=1)[0] in KNOWN or all(name.startswith(FACTS) for name in of_names)
