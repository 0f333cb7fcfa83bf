"""What can be wrong with the tendons."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import TYPE_CHECKING

from jammkle_common.names import TENDONS
from studies.blind.reality.faults import Fault, FaultParameter
from studies.blind.reality.places import PAIRS, plus, times, with_tendons

if TYPE_CHECKING:
    from collections.abc import Mapping

    from studies.blind.reality.machine import Machine, TendonMake

_ALL = ("tensile", "pressure", "drop", "slip", "landing")
_WHOLE = 18
"""Fibres of a tendon."""


def _recured(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Another cure of the print: more or less relaxation, all of it earlier or later in time."""

    def change(make: TendonMake) -> TendonMake:
        # t^-a, slowed down by a factor s, is s^a t^-a; the glassy end moves as well.
        gain = values["gain"] * values["slower"] ** make.exponent
        soft, stiff = times(make.soft, relaxation=gain), times(make.stiff, relaxation=gain)
        return dataclasses.replace(make, soft=soft, stiff=stiff, shortest_s=make.shortest_s * values["slower"])

    return with_tendons(machine, "", change)


def _dusty(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Dust, talc or moisture between the fibres: other coefficients of friction."""
    factor = values["friction"]
    return with_tendons(machine, "", lambda make: times(make, friction_soft=factor, friction_stiff=factor))


def _warm(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Moduli of both materials, by one factor."""

    def change(make: TendonMake) -> TendonMake:
        soft, stiff = times(make.soft, modulus_pa=values["stiffer"]), times(make.stiff, modulus_pa=values["stiffer"])
        return dataclasses.replace(make, soft=soft, stiff=stiff)

    return with_tendons(machine, "", change)


def _glove(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A membrane that pulls along."""
    return with_tendons(machine, "", lambda make: plus(make, membrane_n_m=values["membrane_n_m"]))


def _shorter(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    """Clamped at another length than drawn."""
    return with_tendons(machine, place, lambda make: plus(make, shorter_m=values["shorter_m"]))


def _tired(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Each slice of a fibre loses stress as it is stretched on and on (Mullins)."""

    def change(make: TendonMake) -> TendonMake:
        return dataclasses.replace(make, damage=values["damage"], damage_stretch=values["stretch"])

    return with_tendons(machine, "", change)


def _torn_fibres(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    """Fibres that carry nothing and rub nothing."""
    left = 1.0 - values["fibres"] / _WHOLE
    return with_tendons(machine, place, lambda make: times(make, left=left))


def _torn_end(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    """An end fitting that has come off in part."""
    return with_tendons(machine, place, lambda make: times(make, end_share=1.0 - values["off"]))


def _warming(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A lamp or a motor close by: the tendons warm up during the run."""
    return with_tendons(machine, "", lambda make: plus(make, warming_k_s=values["warming_k_s"]))


def _sticky_fibres(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Tacky fibres: they hold more at rest than sliding, and the faster the less."""
    more = values["striction"]
    return with_tendons(machine, "", lambda make: times(plus(make, striction=more), stribeck_m_s=1.0 + 4.0 * more))


def _tight_membrane(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A thick membrane: it takes up more of the vacuum before it presses the fibres."""
    return with_tendons(machine, "", lambda make: plus(make, contact_onset_pa=values["onset_pa"]))


def _faults() -> list[Fault]:
    found = [
        Fault(
            "recured",
            "tendon",
            _ALL,
            "viscoelasticity",
            {"gain": FaultParameter("1", 1.0, 0.1, 2.5), "slower": FaultParameter("1", 1.0, 0.25, 4.0)},
            _recured,
        ),
        Fault(
            "dusty_fibres",
            "tendon",
            _ALL,
            "jamming_friction",
            {"friction": FaultParameter("1", 1.0, 0.1, 2.5)},
            _dusty,
            lambda values: {"scale": values["friction"]},
        ),
        Fault(
            "stiffer_print",
            "tendon",
            _ALL,
            "tendon_stiffness",
            {"stiffer": FaultParameter("1", 1.0, 0.45, 2.2)},
            _warm,
            lambda values: {"scale": values["stiffer"]},
        ),
        Fault(
            "membrane_pulls",
            "tendon",
            _ALL,
            "membrane_stiffness",
            {"membrane_n_m": FaultParameter("N/m", 0.0, 0.0, 380.0)},
            _glove,
            lambda values: {"stiffness_n_m": values["membrane_n_m"]},
        ),
        Fault(
            "tired_fibres",
            "tendon",
            _ALL,
            "softening",
            {"damage": FaultParameter("1", 0.0, 0.0, 0.55), "stretch": FaultParameter("1", 1.0, 0.2, 5.0)},
            _tired,
        ),
        Fault(
            "warming_tendons", "tendon", _ALL, None, {"warming_k_s": FaultParameter("K/s", 0.0, -0.5, 0.5)}, _warming
        ),
        Fault("tacky_fibres", "tendon", _ALL, None, {"striction": FaultParameter("1", 0.0, 0.0, 2.0)}, _sticky_fibres),
        Fault(
            "thick_membrane", "tendon", _ALL, None, {"onset_pa": FaultParameter("Pa", 0.0, -5e3, 2e4)}, _tight_membrane
        ),
    ]
    found += [
        Fault(
            f"clamped_short_{place}",
            "tendon",
            _ALL,
            f"pretension_{place}",
            {"shorter_m": FaultParameter("m", 0.0, -0.0045, 0.0045)},
            partial(_shorter, place),
            lambda values: {"extension_m": values["shorter_m"]},
        )
        for place in PAIRS
    ]
    for place in TENDONS:
        found += [
            Fault(
                f"torn_fibres_{place}",
                "tendon",
                _ALL,
                f"fibre_loss_{place}",
                {"fibres": FaultParameter("1", 0.0, 0.0, 16.0)},
                partial(_torn_fibres, place),
                lambda values: {"lost": values["fibres"] / _WHOLE},
            ),
            Fault(
                f"torn_end_{place}",
                "tendon",
                _ALL,
                f"tendon_failure_{place}",
                {"off": FaultParameter("1", 0.0, 0.0, 1.0)},
                partial(_torn_end, place),
                lambda values: {"remaining": 1.0 - values["off"]},
            ),
        ]
    return found


TENDON_FAULTS: Mapping[str, Fault] = {fault.name: fault for fault in _faults()}
"""By name."""
