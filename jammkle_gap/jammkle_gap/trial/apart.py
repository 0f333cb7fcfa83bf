"""Which effects the sensors of a trial's rigs cannot tell apart, and where they can: what no diagnosis can do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_gap.ankle.parts import PartsSimulator, prepared_for_parts
from jammkle_gap.ankle.runs import recording_of_run
from jammkle_gap.november.alike import alike
from jammkle_gap.november.compared import compare
from jammkle_gap.november.sensitivity import probe
from jammkle_gap.trial.regimes import rigs, settings_of
from jammkle_graph.parameters import from_mapping
from jammkle_sim.rigs.catalogue import rig_kind, run_rig

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.effects import Library
    from jammkle_gap.november.alike import Alike


@dataclass(frozen=True)
class NotApart:
    """Two effects that at least one rig cannot tell apart."""

    first: str
    second: str
    apart: Mapping[str, float]
    """Share of what one does that the other cannot do, by rig; rigs that one of them moves nothing on are left out."""
    same_signals: tuple[str, ...]
    """Rigs on which they move the very same signals."""
    told_on: tuple[str, ...]
    """Rigs that tell them apart: the experiment to make. Empty: it takes another sensor."""


def not_apart(seed: int, used: Sequence[str], library: Library) -> list[NotApart]:
    """Compare all effects on the rigs of a trial, as the trial sets them, by the simulator in parts.

    Args:
        seed: Of the trial, which chooses the settings.
        used: Rigs that the trial recorded; others are not looked at.
        library: Effects on offer.

    Returns:
        The pairs that a rig does not tell apart; those that no rig does first.

    """
    by_rig = {rig: _on(_recordings(seed, rig), library) for rig in rigs() if rig in used}
    pairs = sorted({(each.first, each.second) for found in by_rig.values() for each in found if not each.told_apart})
    return sorted((_pair(*names, by_rig) for names in pairs), key=lambda each: (bool(each.told_on), each.first))


def as_rows(pairs: Sequence[NotApart]) -> list[dict[str, Any]]:
    """Return what JSON can hold."""
    return [
        {
            "effects": [each.first, each.second],
            "apart": dict(each.apart),
            "same_signals": list(each.same_signals),
            "told_on": list(each.told_on),
        }
        for each in pairs
    ]


def _pair(first: str, second: str, by_rig: Mapping[str, Sequence[Alike]]) -> NotApart:
    on = {rig: each for rig, found in by_rig.items() for each in found if (each.first, each.second) == (first, second)}
    return NotApart(
        first,
        second,
        {rig: each.apart for rig, each in on.items()},
        tuple(rig for rig, each in on.items() if each.same_signals),
        tuple(rig for rig, each in on.items() if each.told_apart),
    )


def _recordings(seed: int, rig: str) -> list[Recording]:
    """Run a rig without any effect, once in each setting."""
    table = rig_kind(rig).options
    plans = [from_mapping(table, dict(settings)) for settings in settings_of(seed, rig)]
    return [
        recording_of_run(run_rig(rig, plan, lambda _: None, lambda: False), f"{rig} {number}")
        for number, plan in enumerate(plans, start=1)
    ]


def _on(recordings: Sequence[Recording], library: Library) -> list[Alike]:
    named, _ = prepared_for_parts(recordings, (), library)
    compared = compare(named, PartsSimulator(library), (), 1, lambda: False)
    residual = compared.layout.residual(compared.nominal)
    return alike(probe(library, compared.runs, compared.layout, residual), compared.layout)
