"""Every constant says its unit, where it comes from and, where it was fitted, to what."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from jammkle_common import constants
from jammkle_sim import physics
from studies.paper import shear_lag
from studies.paper.refit import UNKNOWNS
from studies.paper.tables import ROWS

FOLDER = Path(physics.__file__).parent
UNIT_IN_NAME = re.compile(r"_(m|m2|m3|s|pa|n|kg|rad|deg|hz|n_m|n_m3|m_s|m_s2|n_m_s|n_s_m|rad_s|n_per_pa|j_kg|k|m3_s)$")
UNIT_IN_TEXT = re.compile(r"(, |\()(Pa|m|m\^2|m/s\^2|m/s|s|N|N/m|N/Pa|kg|Hz|1|dm\^3/\(s bar\)|g per root hertz)[.;:,)]")
WITHOUT_UNIT = re.compile(r"ratio|share|friction$|count|seed|scale|stiffening|gains|factor|fibres$")
SOURCE = re.compile(
    r"\b([Pp]aper|[Ff]itted|[Aa]ssumed|[Cc]hosen|ISO|[Rr]ules|[Dd]ata ?sheet|[Ss]tandard|[Dd]efaults)\b"
)


def documented(path: Path) -> dict[str, str]:
    """Docstring of each field of a dataclass of constants, and of each public number, of a module."""
    found: dict[str, str] = {}
    tree = ast.parse(path.read_text())
    bodies = [("", tree.body)]
    bodies += [
        (f"{node.name}.", node.body)
        for node in tree.body
        if isinstance(node, ast.ClassDef)
        and node.name.endswith(("Parameters", "Fibres", "Friction", "ShearLagOptions"))
    ]
    for prefix, body in bodies:
        for node, after in zip(body, [*body[1:], None], strict=True):
            if isinstance(node, ast.AnnAssign) and prefix and isinstance(node.target, ast.Name):
                name = node.target.id
            elif isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant) and not prefix:
                name = node.targets[0].id if isinstance(node.targets[0], ast.Name) else "_"
            else:
                continue
            is_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            if not name.startswith("_"):
                found[prefix + name] = " ".join(str(after.value.value).split()) if is_text else ""
    return found


OF_THE_GRAPH = {
    name: text for name, text in documented(Path(constants.__file__)).items() if name.startswith("STANDARD_")
}
CONSTANTS = documented(FOLDER / "constants.py") | documented(Path(shear_lag.__file__)) | OF_THE_GRAPH
FITTED = {name: text for name, text in CONSTANTS.items() if "Fitted" in text}


def test_the_constants_were_found() -> None:
    """The reader of docstrings sees what it is to judge."""
    assert {
        "STANDARD_GRAVITY_M_S2",
        "Fibres.c1_pa",
        "TendonParameters.break_extension_m",
        "Friction.stiff_stiff",
    } <= set(CONSTANTS)


@pytest.mark.parametrize("name", CONSTANTS)
def test_a_constant_has_unit_and_source(name: str) -> None:
    """Unit in the name or the text, or a quantity that has none; and paper, fitted, assumed or a standard."""
    text = CONSTANTS[name]
    has_unit = UNIT_IN_NAME.search(name.lower()) or UNIT_IN_TEXT.search(text)
    has_none = WITHOUT_UNIT.search(name.lower()) or name.startswith("Friction.")
    assert has_unit or has_none, f"{name}: {text}"
    # `Friction` is documented as a whole, and its fields quote the paper; a field of fields has sources of its own.
    assert SOURCE.search(text) or name == "TendonParameters.fibres" or "paper prints" in text, f"{name}: {text}"


@pytest.mark.parametrize("name", FITTED)
def test_a_fitted_constant_says_to_what(name: str) -> None:
    """Rows of the paper by their names, its drop test, or the reference model."""
    text = FITTED[name]
    assert re.search(r"Fitted to ", text), text
    rows = [row.identifier for row in ROWS if row.identifier in text]
    assert rows or "drop test" in text or "reference model" in text, text


def test_what_the_fit_chooses_is_what_is_called_fitted() -> None:
    """The list of unknowns and the docstrings agree, to the rows they name; the gains are the drop test's."""
    chosen = {unknown.name.partition("[")[0] for unknown in UNKNOWNS}
    assert {name.partition(".")[2] for name in FITTED} == chosen | {"relaxation_gains"}
    for unknown in UNKNOWNS:
        text = next(text for name, text in FITTED.items() if name.endswith(unknown.name.partition("[")[0]))
        for row in ROWS:
            if row.identifier in unknown.fitted_to:
                assert row.identifier in text, unknown.name


@pytest.mark.parametrize("module", ["ankle", "feet", "pneumatics", "sensors"])
def test_the_other_parts_say_where_their_numbers_come_from(module: str) -> None:
    """Ankle, feet, pneumatics and sensors: every number has a source."""
    for name, text in documented(FOLDER / f"{module}.py").items():
        if "." in name and not name.endswith(".seed"):
            assert SOURCE.search(text), f"{module}: {name}: {text}"
