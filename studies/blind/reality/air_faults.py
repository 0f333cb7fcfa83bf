"""What can be wrong with pump, valves and lines."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from typing import TYPE_CHECKING

from jammkle_common.names import CHANNELS
from studies.blind.reality.faults import Fault, FaultParameter
from studies.blind.reality.machine import conductance_dm3_s_bar, nozzle_area_m2
from studies.blind.reality.places import MANIFOLD, plus, times, with_air, with_lines, with_pump

if TYPE_CHECKING:
    from collections.abc import Mapping

    from studies.blind.reality.machine import Air, Line, Machine

EVERYWHERE = ("tensile", "pressure", "drop", "slip", "landing")
_DISCHARGE = 0.8
"""Effective over real area of a hole."""
_PATH_M2 = nozzle_area_m2(0.1)
"""Effective area of a whole line in order."""


def _hole_m2(values: Mapping[str, float]) -> float:
    return _DISCHARGE * math.pi / 4.0 * values["diameter_m"] ** 2


def _leak(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    """A hole to the atmosphere."""
    area_m2 = _hole_m2(values)
    if place == MANIFOLD:
        return with_air(machine, lambda air: plus(air, manifold_leak_area_m2=area_m2))
    return with_lines(machine, (place,), lambda line: plus(line, leak_area_m2=area_m2))


def _leak_effect(values: Mapping[str, float]) -> Mapping[str, float]:
    return {"conductance_dm3_s_bar": conductance_dm3_s_bar(_hole_m2(values))}


def _wear(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A torn diaphragm draws less; worn valves end at less vacuum."""
    return with_pump(
        machine, lambda pump: times(pump, free_flow_m3_s=values["flow"], ultimate_vacuum_pa=values["vacuum"])
    )


def _late(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Dirt in the armatures: all of them begin to move later."""
    return with_lines(machine, CHANNELS, lambda line: plus(line, dead_s=values["later_s"]))


def _kink(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    """A tube that is bent shut: the loss of a hole of what is left open, on top of what a line in order loses."""
    opened = 1.0 - values["closed"]
    loss = 0.5 / (opened * _PATH_M2) ** 2 - 0.5 / _PATH_M2**2
    return with_lines(machine, (place,), lambda line: plus(line, turbulent_per_m4=loss))


def _hose(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    """A longer hose or a big fitting: more air to draw."""
    if place == MANIFOLD:
        return with_air(machine, lambda air: plus(air, manifold_volume_m3=values["volume_m3"]))
    return with_lines(machine, (place,), lambda line: plus(line, tube_volume_m3=values["volume_m3"]))


def _water(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    """Water in the tube: a slug that only moves when pushed hard enough."""
    return with_lines(machine, (place,), lambda line: plus(line, slug_pa=values["slug_pa"]))


def _stick(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    """An armature that sticks at some of its switches."""

    def sticky(line: Line) -> Line:
        return dataclasses.replace(line, stick_share=0.6, stick_s=values["stuck_s"])

    return with_lines(machine, (place,), sticky)


def _pulsate(machine: Machine, values: Mapping[str, float]) -> Machine:
    """One head works against a stuck leaf: strokes half as often, each felt in the manifold."""
    more = values["ripple"]
    return with_pump(machine, lambda pump: times(plus(pump, ripple=more), stroke_hz=1.0 - 0.5 * more))


def _return(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Leaf valves that do not close: air comes back through the pump."""
    return with_pump(machine, lambda pump: plus(pump, return_area_m2=_hole_m2(values)))


def _slow(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    """A weak spring: the armature creeps from seat to seat, and both are open meanwhile."""
    return with_lines(machine, (place,), lambda line: plus(line, travel_s=values["longer_s"]))


def _weather(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A fan or a door: the room's pressure is another one from now on."""

    def change(air: Air) -> Air:
        return plus(air, ambient_pa=values["pressure_pa"])

    return with_air(machine, change)


def _faults() -> list[Fault]:
    hole = {"diameter_m": FaultParameter("m", 0.0, 0.0, 0.26e-3)}
    found = [
        Fault(
            f"leak_{place}", "pneumatics", EVERYWHERE, f"line_leak_{place}", hole, partial(_leak, place), _leak_effect
        )
        for place in (MANIFOLD, *CHANNELS)
    ]
    found += [
        Fault(
            "worn_pump",
            "pneumatics",
            EVERYWHERE,
            "pump_wear",
            {"flow": FaultParameter("1", 1.0, 0.25, 1.25), "vacuum": FaultParameter("1", 1.0, 0.55, 1.15)},
            _wear,
            lambda values: {"flow_scale": values.get("flow", 1.0), "vacuum_scale": values.get("vacuum", 1.0)},
        ),
        Fault(
            "late_valves",
            "pneumatics",
            EVERYWHERE,
            "valve_dead_time",
            {"later_s": FaultParameter("s", 0.0, 0.0, 0.09)},
            _late,
            lambda values: {"extra_s": values["later_s"]},
        ),
    ]
    for place in CHANNELS:
        found += [
            Fault(
                f"kink_{place}",
                "pneumatics",
                EVERYWHERE,
                f"line_restriction_{place}",
                {"closed": FaultParameter("1", 0.0, 0.0, 0.97)},
                partial(_kink, place),
                lambda values: {"conductance_scale": 1.0 - values["closed"]},
            ),
            Fault(
                f"water_{place}",
                "pneumatics",
                EVERYWHERE,
                None,
                {"slug_pa": FaultParameter("Pa", 0.0, 0.0, 8e3)},
                partial(_water, place),
            ),
            Fault(
                f"sticky_valve_{place}",
                "pneumatics",
                EVERYWHERE,
                None,
                {"stuck_s": FaultParameter("s", 0.0, 0.0, 0.3)},
                partial(_stick, place),
            ),
            Fault(
                f"slow_valve_{place}",
                "pneumatics",
                EVERYWHERE,
                None,
                {"longer_s": FaultParameter("s", 0.0, 0.0, 0.3)},
                partial(_slow, place),
            ),
        ]
    found += [
        Fault(
            f"long_hose_{place}",
            "pneumatics",
            EVERYWHERE,
            f"trapped_volume_{place}",
            {"volume_m3": FaultParameter("m3", 0.0, 0.0, 35e-6)},
            partial(_hose, place),
            lambda values: {"volume_m3": values["volume_m3"]},
        )
        for place in (MANIFOLD, *CHANNELS)
    ]
    found += [
        Fault(
            "pulsating_pump",
            "pneumatics",
            EVERYWHERE,
            None,
            {"ripple": FaultParameter("1", 0.0, 0.0, 0.85)},
            _pulsate,
        ),
        Fault(
            "pump_lets_back",
            "pneumatics",
            EVERYWHERE,
            None,
            {"diameter_m": FaultParameter("m", 0.0, 0.0, 0.3e-3)},
            _return,
        ),
        Fault(
            "room_pressure",
            "pneumatics",
            EVERYWHERE,
            None,
            {"pressure_pa": FaultParameter("Pa", 0.0, -2e3, 2e3)},
            _weather,
        ),
    ]
    return found


AIR_FAULTS: Mapping[str, Fault] = {fault.name: fault for fault in _faults()}
"""By name."""
