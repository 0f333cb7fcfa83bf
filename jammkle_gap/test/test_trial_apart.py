"""What the sensors of a trial's rigs cannot tell apart, and which rig can."""

from __future__ import annotations

from functools import lru_cache

from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.core.effects import Library
from jammkle_gap.trial.apart import NotApart, as_rows, not_apart
from jammkle_gap.trial.page import _pair_line

OFFERED = ("fibre_loss_peroneal_left", "tendon_failure_peroneal_left", "line_leak_manifold", "line_leak_peroneal_left")


@lru_cache(maxsize=1)
def found() -> dict[tuple[str, str], NotApart]:
    library = Library(tuple(effect for effect in ankle_library() if effect.name in OFFERED))
    return {(each.first, each.second): each for each in not_apart(7, ["tensile", "pressure"], library)}


def test_a_rig_that_tells_is_named() -> None:
    """Fibres and a whole tendon fall alike on the tensile rig; in air, that jams all of them, they do not."""
    pair = found()["fibre_loss_peroneal_left", "tendon_failure_peroneal_left"]
    assert pair.apart["tensile"] < 0.1 < pair.apart["pressure"]
    assert pair.told_on == ("pressure",)


def test_effects_that_have_nothing_in_common_are_not_listed() -> None:
    """A leak and a torn tendon are told apart everywhere."""
    assert not any("leak" in first and "leak" not in second for first, second in found())


def test_every_pair_can_be_shown_and_kept() -> None:
    """On the page and in JSON."""
    pairs = list(found().values())
    assert [row["effects"] for row in as_rows(pairs)] == [[each.first, each.second] for each in pairs]
    nowhere = NotApart("one", "other", {"drop": 0.01}, ("drop",), ())
    assert "another sensor" in _pair_line(nowhere)["told_on"]
