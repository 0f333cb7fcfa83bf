"""What can be wrong with bodies, joints, floor, slide and the mount of the IMU."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from studies.blind.reality.faults import Fault, FaultParameter
from studies.blind.reality.places import plus, times

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from studies.blind.reality.leg import Leg
    from studies.blind.reality.machine import Machine

    Change = Callable[[Machine, Mapping[str, float]], Machine]

_MOVED = ("drop", "slip", "landing")
_TURNED = ("pressure", *_MOVED)
_FALLEN = ("drop", "landing")


def _added(**fields: str) -> Change:
    """Return the change that adds sizes of a fault, by name, to fields of the leg."""

    def change(machine: Machine, values: Mapping[str, float]) -> Machine:
        more = {name: values[size] for name, size in fields.items()}
        return _with_leg(machine, lambda leg: plus(leg, **more))

    return change


def _with_leg(machine: Machine, change: Callable[[Leg], Any]) -> Machine:
    return dataclasses.replace(machine, leg=change(machine.leg))


def _gritty(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Grit or dried grease in the ball joint."""
    more = {"joint_dry_n_m": values["dry_n_m"], "joint_viscous_n_m_s": values["viscous_n_m_s"]}
    return dataclasses.replace(machine, ankle=plus(machine.ankle, **more))


def _wet(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Dust, water or rubber between sole and floor."""
    return _with_leg(machine, lambda leg: times(leg, grip=values["grip"]))


def _rail(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A rail that rubs all the way, and holds more at rest."""
    return _with_leg(machine, lambda leg: dataclasses.replace(leg, rail_n=values["rub_n"], rail_width_m=0.0))


def _tight_rail(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A dent in the rail, somewhere on the way down."""
    return _with_leg(
        machine,
        lambda leg: dataclasses.replace(leg, rail_n=values["rub_n"], rail_tight_m=values["at_m"], rail_width_m=0.008),
    )


def _cable(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A cable too short, which pulls the more the lower the carriage."""
    pull_n = values["pull_n"]
    return _with_leg(machine, lambda leg: dataclasses.replace(leg, cable_n=pull_n, cable_n_m=8.0 * pull_n))


def _soft_sole(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A sole that was printed from another batch or has worn."""
    return _with_leg(machine, lambda leg: times(leg, sole_n_m15=values["stiffer"]))


def _size(unit: str, null: float, minimum: float, maximum: float) -> FaultParameter:
    return FaultParameter(unit, null, minimum, maximum)


def _faults() -> list[Fault]:
    return [
        Fault(
            "payload",
            "mechanics",
            _FALLEN,
            "payload",
            {"more_kg": _size("kg", 0.0, -0.7, 2.7)},
            _added(payload_kg="more_kg"),
            lambda values: {"mass_kg": values["more_kg"]},
        ),
        Fault(
            "gritty_joint",
            "mechanics",
            _TURNED,
            "ankle_joint_friction",
            {"dry_n_m": _size("N m", 0.0, 0.0, 0.45), "viscous_n_m_s": _size("N m s", 0.0, 0.0, 0.09)},
            _gritty,
            lambda values: {"coulomb_n_m": values["dry_n_m"], "viscous_n_m_s": values["viscous_n_m_s"]},
        ),
        Fault(
            "floor_grip",
            "mechanics",
            _MOVED,
            "floor_friction",
            {"grip": _size("1", 1.0, 0.25, 1.9)},
            _wet,
            lambda values: {"scale": values["grip"]},
        ),
        Fault(
            "mat_on_floor",
            "mechanics",
            _MOVED,
            "floor_compliance",
            {"give_m_n": _size("m/N", 0.0, 0.0, 5e-4)},
            _added(mat_m_n="give_m_n"),
        ),
        Fault(
            "worn_pins",
            "mechanics",
            _MOVED,
            "backlash",
            {"play_m": _size("m", 0.0, 0.0, 0.0045)},
            _added(pin_play_m="play_m"),
            lambda values: {"play_m": values["play_m"]},
        ),
        Fault(
            "loose_foot_plate",
            "mechanics",
            _MOVED,
            None,
            {"gap_m": _size("m", 0.0, 0.0, 0.004)},
            _added(plate_gap_m="gap_m"),
        ),
        Fault("rail_rubs", "mechanics", _FALLEN, None, {"rub_n": _size("N", 0.0, 0.0, 8.0)}, _rail),
        Fault(
            "dented_rail",
            "mechanics",
            _FALLEN,
            None,
            {"rub_n": _size("N", 0.0, 0.0, 30.0), "at_m": _size("m", 0.0, 0.0, 0.2)},
            _tight_rail,
        ),
        Fault("cable_pulls", "mechanics", _FALLEN, None, {"pull_n": _size("N", 0.0, 0.0, 8.0)}, _cable),
        Fault(
            "soft_imu_mount",
            "sensing",
            _FALLEN,
            None,
            {"softness_s2": _size("s2", 0.0, 0.0, 2e-5)},
            _added(mount_s2="softness_s2"),
        ),
        Fault(
            "bent_toe",
            "mechanics",
            _MOVED,
            None,
            {"bent_rad": _size("rad", 0.0, -0.15, 0.15)},
            _added(bent_rad="bent_rad"),
        ),
        Fault(
            "twisted_foot",
            "mechanics",
            _MOVED,
            None,
            {"twisted_rad": _size("rad", 0.0, -0.15, 0.15)},
            _added(twisted_rad="twisted_rad"),
        ),
        Fault(
            "cramped_ankle",
            "mechanics",
            ("slip", "landing"),
            None,
            {"cramped_rad": _size("rad", 0.0, 0.0, 1.0)},
            _added(cramped_rad="cramped_rad"),
        ),
        Fault(
            "crooked_floor",
            "mechanics",
            _MOVED,
            None,
            {"steeper_rad": _size("rad", 0.0, -0.1, 0.1)},
            _added(floor_rad="steeper_rad"),
        ),
        Fault("other_sole", "mechanics", _MOVED, None, {"stiffer": _size("1", 1.0, 0.3, 5.0)}, _soft_sole),
    ]


BODY_FAULTS: Mapping[str, Fault] = {fault.name: fault for fault in _faults()}
"""By name."""
