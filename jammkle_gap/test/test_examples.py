"""The examples of the gap page: the pendulum of forty lines, and recordings of real machines where they are present."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from jammkle_gap import Verdict

if TYPE_CHECKING:
    from types import ModuleType

HOUSE = Path(__file__).resolve().parents[2]
EXAMPLES = HOUSE / "docs" / "examples"
DATA = Path(os.environ.get("JAMMKLE_REAL_DATA", HOUSE.parent / "shared" / "data"))
present = pytest.mark.skipif(not DATA.is_dir(), reason=f"no real recordings in {DATA}")


def example(name: str) -> ModuleType:
    """Load an example as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def test_the_pendulum_names_what_it_was_given() -> None:
    """The script of the page runs as it stands, and names the friction."""
    done = subprocess.run(
        [sys.executable, EXAMPLES / "gap_pendulum.py"], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout.splitlines()[:2] == ["EFFECTS", "rubbing"]


def test_the_page_shows_the_pendulum_as_it_is() -> None:
    """The code on the page is the code that is tested."""
    assert (EXAMPLES / "gap_pendulum.py").read_text() in (HOUSE / "docs" / "gap.md").read_text()


@present
@pytest.mark.parametrize("name", ["Ultimaker_015", "Ultimaker_020"])
def test_a_gross_leak_is_named(name: str) -> None:
    """Chambers that empty within a minute leak; cooling gas does not explain it."""
    found = example("gap_leak_down").run(DATA / "leak_down", name)
    assert found.verdict is Verdict.EFFECTS
    assert [each.name for each in found.effects] == ["leak"]


@present
@pytest.mark.parametrize("name", ["Aluminium", "Formlabs", "Ultimaker_006", "Ultimaker_010"])
def test_in_a_tight_chamber_it_is_one_of_the_two(name: str) -> None:
    """A small leak and a cooling gas fit equally well: both are in the set, and neither is named alone.

    In one chamber both together are likeliest.
    """
    found = example("gap_leak_down").run(DATA / "leak_down", name)
    assert found.verdict is Verdict.AMBIGUOUS
    assert {each.names for each in found.candidates} - {("leak", "cooling")} == {("leak",), ("cooling",)}


@present
def test_in_the_chamber_that_bends_most_it_is_no_leak_alone() -> None:
    """A steady leak misses this chamber's curve by twice the reruns' scatter, cooling does not."""
    found = example("gap_leak_down").run(DATA / "leak_down", "Prusa")
    assert found.posterior["cooling",] > 10.0 * found.posterior["leak",]
    assert found.verdict is not Verdict.NO_GAP


@pytest.mark.slow
@present
def test_the_seal_rubs_more_under_pressure() -> None:
    """Friction that grows with pressure is in every candidate but none of them; reversals stay a doubt beside it."""
    found = example("gap_pressure_friction").run(DATA / "pressure_friction")
    assert "pressure_friction" in next(iter(found.posterior))
    assert sum(share for names, share in found.posterior.items() if "pressure_friction" in names) > 0.8
    (growth,) = next(each for each in found.effects if each.name == "pressure_friction").parameters
    assert growth.interval[0] > 0.1
    assert growth.interval[1] < 0.7


@pytest.mark.slow
@present
def test_the_servo_rubs_more_under_load() -> None:
    """Of the effects friction that grows with load comes first; the model has more wrong than that, and says so."""
    found = example("gap_servo_friction").run(DATA / "servo_friction")
    first = next(names for names in found.posterior if names)
    assert "load_friction" in first
    assert found.posterior["gain",] < found.posterior[first]
    assert found.verdict in {Verdict.UNKNOWN, Verdict.AMBIGUOUS}
