"""What lies between the commands and what obeys them, and between the sensors and the topics: delays, clock, gains."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_sim.physics import records


@dataclass(frozen=True)
class Wiring:
    """Nothing that changes anything, unless said otherwise."""

    command_delay_s: float = 0.0
    """From a command to when pump and valves get it, s, 0 or more."""
    pressure_delay_s: float = 0.0
    """From a pressure to its reading, s, 0 or more."""
    imu_delay_s: float = 0.0
    """From a motion to the IMU's reading of it, s, 0 or more; its own filter not counted."""
    joint_delay_s: float = 0.0
    """From a motion to the reading of joints and tendons, s, 0 or more."""
    load_cell_delay_s: float = 0.0
    """From a force to its reading, s, 0 or more."""
    clock_skew: float = 0.0
    """How much faster the clock that stamps the readings runs than that of the commands, 1."""
    pressure_offset_pa: tuple[float, ...] = (0.0,) * records.VOLUMES
    """What each pressure reads too much, Pa: manifold, then channels."""
    load_cell_gain: float = 1.0
    """Reading of the load cell over the true force, 1."""
