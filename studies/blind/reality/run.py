"""Run the real machine: a plan, a specimen, what is wrong with it, and the day."""

from __future__ import annotations

from typing import TYPE_CHECKING

from studies.blind.reality.drop import drop
from studies.blind.reality.faults import with_faults
from studies.blind.reality.guided import cycle, press, shake, tilt
from studies.blind.reality.landing import landing
from studies.blind.reality.pressure import pressure
from studies.blind.reality.sensors import BadPlanError
from studies.blind.reality.slip import slip
from studies.blind.reality.specimen import today
from studies.blind.reality.tensile import tensile

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from studies.blind.reality.faults import FaultSetting
    from studies.blind.reality.machine import Machine
    from studies.blind.reality.sensors import Plan, RealRun

RIGS: Mapping[str, Callable[[Plan, Machine, int], RealRun]] = {
    "tensile": tensile,
    "pressure": pressure,
    "drop": drop,
    "slip": slip,
    "landing": landing,
    "cycle": cycle,
    "press": press,
    "shake": shake,
    "tilt": tilt,
}
"""What carries out a plan, by the name of the rig: plan, machine with its faults on the day of the run, seed."""


def run(plan: Plan, machine: Machine, faults: Sequence[FaultSetting], seed: int) -> RealRun:
    """Run a plan once.

    Args:
        plan: The rig and its settings.
        machine: The specimen, in order.
        faults: What is wrong with it.
        seed: Of the day and of all noise; the same seed gives the same bits. Faults take nothing from its numbers.

    Raises:
        BadPlanError: there is no such rig or setting.
        BadFaultError: there is no such fault, or its size is out of range.

    """
    if plan.rig not in RIGS:
        msg = f"rig '{plan.rig}' does not exist here; known are: {', '.join(RIGS)}"
        raise BadPlanError(msg)
    return RIGS[plan.rig](plan, with_faults(today(machine, seed), faults), seed)
