"""Each subsystem on its own, fed with what was measured at its inputs: one that fits then is not to blame.

pneumatics   commands -> pressures
tendon       measured pressure and extension -> tension
mechanics    measured tension -> joints, slide and load cell, from the measured state every 0.1 s
sensing      measured motion -> IMU, where nothing moves; measured tension -> load cell, where that is all it carries
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.ankle.instruments import ACCELERATION, FORCE, RATE, quantity_of
from jammkle_gap.ankle.measured import Measured
from jammkle_gap.ankle.readings import Truth, readings
from jammkle_gap.ankle.restarts import Drive, restarted_readings
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.ankle.truth import air_of, steps_of
from jammkle_graph.constants import STANDARD_GRAVITY_M_S2
from jammkle_graph.names import CARRIAGE_JOINT
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.tendon import relaxed_state
from jammkle_sim.rigs import replay
from jammkle_sim.rigs.assembly import laws_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.november.effect import Library
    from jammkle_gap.november.recording import Recording
    from jammkle_sim.rigs.rig import Rig

_STILL_M_S = 0.002
"""Speed of the slide below which it counts as standing still, for the IMU. Assumed: a tenth of a slip test's."""
MOTION_HORIZON_S = 0.1
"""How long the bodies are pulled by measured tensions before they are put where they were measured. Assumed: a wrong
mass or friction shows within; noise has not grown yet."""
_SETTLE_S = 0.05
"""How long after a motion it still does not. Assumed: ringing is over."""


class Subsystem(enum.Enum):
    """Parts of the ankle that can be looked at alone."""

    PNEUMATICS = "pneumatics"
    TENDON = "tendon"
    MECHANICS = "mechanics"
    SENSING = "sensing"


@dataclass(frozen=True)
class SubsystemSimulator:
    """One subsystem as a simulator; signals that it does not make, or whose inputs were not measured, are left out."""

    library: Library
    subsystem: Subsystem

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """Run the subsystem; see `gap.simulator.Simulator`.

        Raises:
            BadEffectError: a parameter that no effect of the library has.
            UnstableSimulationError: the simulation blew up.

        """
        rig = AnkleSimulator(self.library).rig(recording, values)
        if self.subsystem is Subsystem.PNEUMATICS:
            return readings(recording, rig, Truth(replay.timestep_s(rig), air_of(recording, rig), None))
        if self.subsystem is Subsystem.TENDON:
            return tensions_of(recording, rig)
        if self.subsystem is Subsystem.MECHANICS:
            return _motion(recording, rig)
        return _sensed(recording, rig)


def subsystem_simulators(library: Library) -> dict[str, SubsystemSimulator]:
    """Return every subsystem's simulator, by name."""
    return {each.value: SubsystemSimulator(library, each) for each in Subsystem}


def tensions_of(recording: Recording, rig: Rig) -> dict[str, NDArray[np.float64]]:
    """Return the tensions that the tendons' laws make of measured extensions and pressures, where both are there."""
    steps = steps_of(recording, rig)
    measured = Measured(recording, rig, steps)
    ambient_pa = laws_of(rig).pneumatics["ambient_pa"][0]
    found: dict[str, NDArray[np.float64]] = {}
    time_s = replay.timestep_s(rig) * np.arange(1, steps + 1)
    for i, tendon in enumerate(rig.tendon_names):
        law = rig.tendon_laws[i : i + 1]
        extension_m, pressure_pa = measured.extension_m(tendon), measured.channel_pa(int(law["channel"][0]))
        if extension_m is None or pressure_pa is None:
            continue
        tension_n = np.zeros(steps)
        vacuum_pa = np.maximum(ambient_pa - pressure_pa, 0.0)
        kernels.tendon_history(law, relaxed_state(law, float(extension_m[0])), extension_m, vacuum_pa, tension_n)
        name = f"{tendon}/tension"
        if any(signal.name == name for signal in recording.signals):
            wiring = rig.wiring
            true_s = recording.signal(name).time_s / (1.0 + wiring.clock_skew) - wiring.joint_delay_s
            found[name] = np.interp(true_s, time_s, tension_n)
    return found


def _motion(recording: Recording, rig: Rig) -> dict[str, NDArray[np.float64]]:
    """Pull with what was measured, from the measured state again and again: a body that is only pulled drifts off."""
    made = restarted_readings(recording, rig, MOTION_HORIZON_S, Drive.MEASURED)
    outputs = ("position", "force_x", "force_y", "force_z")
    return {name: values for name, values in made.items() if name.rpartition("/")[2] in outputs}


def _sensed(recording: Recording, rig: Rig) -> dict[str, NDArray[np.float64]]:
    """Read gravity where nothing moves, and the tendon's pull where the load cell is in line with it."""
    found: dict[str, NDArray[np.float64]] = {}
    steps = steps_of(recording, rig)
    measured = Measured(recording, rig, steps)
    carriage, tension_n = measured.joint(CARRIAGE_JOINT), measured.tensions_n()
    step_s = replay.timestep_s(rig)
    gravity_m_s2 = float(-rig.model.opt.gravity[2])
    width = records.row_width(1, 1)
    rows = np.zeros((steps, width))
    rows[:, 2] = gravity_m_s2
    in_line = tension_n is not None and tension_n.shape[1] == 1
    if in_line and tension_n is not None:
        rows[:, records.IMU_AXES + 2] = tension_n[:, 0]
    track = replay.BodyTrack((CARRIAGE_JOINT,), ("none",), rows)
    truth = Truth(step_s, np.zeros((steps + 1, records.VOLUMES)), track, rows[0, : records.IMU_AXES])
    made = readings(recording, rig, truth)
    for signal in recording.signals:
        quantity = quantity_of(signal.name)
        if quantity == FORCE and in_line:
            found[signal.name] = made[signal.name]
        if quantity in (ACCELERATION, RATE) and carriage is not None and gravity_m_s2 > 0.5 * STANDARD_GRAVITY_M_S2:
            moving = _moving(np.abs(carriage[1]) > _STILL_M_S, round(_SETTLE_S / step_s))
            at = np.clip(np.round(signal.time_s / step_s).astype(int) - 1, 0, steps - 1)
            # A sample in motion says nothing of the sensor here: it is taken as it is.
            found[signal.name] = np.where(moving[at], signal.values, made[signal.name])
    return found


def _moving(fast: NDArray[np.bool_], settle: int) -> NDArray[np.bool_]:
    """Return where something moved within `settle` steps before or after."""
    near = np.convolve(fast.astype(float), np.ones(2 * settle + 1), mode="same")
    moving: NDArray[np.bool_] = near > 0.5  # noqa: PLR2004 - any of them
    return moving
