"""Runs that a diagnosis may propose: rigs with settings that part effects, planned by running them without a gap."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common.parameters import from_mapping
from jammkle_gap.ankle.runs import recording_of_run
from jammkle_gap.core.design import Experiment
from jammkle_sim.rigs.catalogue import rig_kind, run_rig

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_gap.core.data import Recording


@dataclass(frozen=True)
class _Plan:
    """One run that could be made."""

    rig: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def command(self) -> str:
        """How to simulate it, which also says what to do with the robot."""
        shown = {name: f"{value:g}" if isinstance(value, float) else value for name, value in self.settings.items()}
        options = (f"--{name.replace('_', '-')} {value}" for name, value in shown.items())
        return " ".join(("rig", self.rig, *options))

    def recording(self) -> Recording:
        """Return the recording as it would be with nothing wrong."""
        options = from_mapping(rig_kind(self.rig).options, dict(self.settings))
        return recording_of_run(run_rig(self.rig, options, lambda _: None, lambda: False), self.command)


_PLANS = (
    _Plan("pressure", {"jam_time_s": 4.0, "vent_time_s": 1.0, "cycles": 2}),
    _Plan("pressure", {"vacuum_pa": 20e3, "cycles": 3}),
    _Plan("tensile", {"vacuum_pa": 50e3}),
    _Plan("tensile", {"vacuum_pa": 0.0, "speed_m_s": 0.1}),
    _Plan("drop", {"foot": "unjammed"}),
    _Plan("drop", {"foot": "jammed"}),
    _Plan("slip", {"foot": "unjammed", "speed_m_s": 0.02}),
)
"""Slow and fast, soft and jammed, in the air and on the ground: what parts most pairs of effects. Assumed."""


def experiments() -> tuple[Experiment, ...]:
    """Return the runs on offer; each is planned only when a diagnosis asks for it."""
    return tuple(Experiment(each.command, each.recording) for each in _PLANS)
