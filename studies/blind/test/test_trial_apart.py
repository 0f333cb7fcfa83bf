"""Equivalence classes of a trial's answers, and what would split them."""

from __future__ import annotations

from studies.blind.answers import NO_GAP, Answer, Said
from studies.blind.apart import as_rows, not_apart
from studies.blind.key import Kind, Truth
from studies.blind.scoring import Case

LEAKS = frozenset({"leak_a", "leak_b"})


def case(rig: str, *classes: frozenset[str], silent: frozenset[str] = frozenset()) -> Case:
    """Return a healthy case on a rig with some classes declared."""
    answer = Answer(Said.NO_GAP, probabilities={NO_GAP: 1.0}, classes=classes, silent=silent)
    return Case("1", Truth(Kind.NONE, rigs=(rig,)), answer)


def test_a_rig_that_tells_is_named() -> None:
    """Declared in one of two pulls, never in the air: the pressure rig is what to record next."""
    (pair,) = not_apart([case("tensile", LEAKS), case("tensile"), case("pressure")], [])
    assert (pair.first, pair.second) == ("leak_a", "leak_b")
    assert pair.declared == {"tensile": (1, 2)}
    assert pair.way_out == "rig pressure"


def test_a_rig_on_which_both_are_silent_does_not_tell() -> None:
    """What moves nothing there cannot be told apart there, either; then it takes a sensor."""
    (pair,) = not_apart([case("tensile", LEAKS), case("drop", silent=LEAKS)], [])
    assert pair.told_on == ()
    assert "no rig of the trial has" in pair.way_out


def test_a_sensor_that_splits_a_class_is_named() -> None:
    """Where the class is gone with instrumented tendons, they are the way out."""
    (pair,) = not_apart([case("tensile", LEAKS)], [case("tensile")])
    assert pair.way_out == "instrumented tendons on rig tensile"
    assert as_rows([pair])[0]["split_by"] == pair.way_out
