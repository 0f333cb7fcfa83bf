"""What happened in a recorded landing, from the bag alone."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_bringup.core.run_series import read_run
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA, STANDARD_GRAVITY_M_S2
from jammkle_common.names import CHANNELS, CONTACT_EVENTS, IMU, LOAD_CELL, PRESSURES, SOLENOIDS

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_bringup.core.run_series import Array, RunSeries, Series

REACHED_FRACTION = 0.95
"""A channel has reached its vacuum at this part of the command. Chosen: the driver's tolerance is of that order."""

TOUCH_DOWN_FORCE_N = 2.0
"""Push on the load cell that counts as touch-down: 40 times the noise of 0.05 N rms that the simulated
cell has (SensorParameters of jammkle_sim). Chosen."""

PEAK_DEFINITION = (
    f"largest linear_acceleration.z of the IMU minus {STANDARD_GRAVITY_M_S2} m/s^2 (net, upward) from touch-down on"
)


@dataclass(frozen=True)
class ChannelSummary:
    """One channel. Times are s after the start of the bag; None: did not happen, or is not in the bag.

    Attributes:
        channel: Its name.
        energised_s: First time its solenoid was energised.
        commanded_vacuum_pa: Largest vacuum asked for, gauge, positive.
        reached_s: First time the measured vacuum was 95 % of that, after the solenoid was energised.
        greatest_vacuum_pa: Largest vacuum measured, gauge, positive.

    """

    channel: str
    energised_s: float | None
    commanded_vacuum_pa: float | None
    reached_s: float | None
    greatest_vacuum_pa: float | None


@dataclass(frozen=True)
class RunSummary:
    """A landing in numbers. Times are s after the start of the bag; None: did not happen, or is not in the bag.

    Attributes:
        bag: Path of the bag.
        namespace: Where its ankle stood.
        duration_s: Length of the bag.
        touch_down_s: First push on the load cell beyond 2 N after it did not push.
        detected_s: Stamp of the IMU sample with which the controller detected the impact.
        detection_delay_s: Between the first sample of the impact and that one, as the controller says.
        peak_deceleration_m_s2: See PEAK_DEFINITION.
        channels: One entry per channel.
        missing: What the bag does not hold, and what could not be said for that.

    """

    bag: str
    namespace: str
    duration_s: float
    touch_down_s: float | None
    detected_s: float | None
    detection_delay_s: float | None
    peak_deceleration_m_s2: float | None
    channels: tuple[ChannelSummary, ...]
    missing: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON."""
        return {**asdict(self), "peak_deceleration_definition": PEAK_DEFINITION}


def summarise(path: Path, namespace: str | None = None) -> RunSummary:
    """Read a bag and say what happened.

    Raises:
        InputError: the bag cannot be read, or holds nothing of an ankle.

    """
    return summary_of(read_run(path, namespace), str(path))


def summary_of(run: RunSeries, bag: str) -> RunSummary:
    """Say what happened in a run that was read before."""
    missing: list[str] = []
    touch_down_s = None
    if run.load_cell_z is None:
        missing.append(f"{LOAD_CELL.name}: no touch-down")
    else:
        pushes = run.load_cell_z.values < -TOUCH_DOWN_FORCE_N
        touch_down_s = _first_time(run.load_cell_z, pushes & np.maximum.accumulate(~pushes))
    impact = next((event for event in run.events if event.name == "IMPACT"), None)
    if not run.events:
        missing.append(f"{CONTACT_EVENTS.name}: no detection")
    peak = None
    if run.imu_z is None:
        missing.append(f"{IMU.name}: no peak deceleration")
    else:
        after = run.imu_z.values[run.imu_z.time_s >= (touch_down_s if touch_down_s is not None else -np.inf)]
        peak = float(after.max()) - STANDARD_GRAVITY_M_S2 if len(after) else None
    return RunSummary(
        bag=bag,
        namespace=run.namespace,
        duration_s=run.duration_s,
        touch_down_s=touch_down_s,
        detected_s=impact.time_s if impact else None,
        detection_delay_s=impact.detection_delay_s if impact else None,
        peak_deceleration_m_s2=peak,
        channels=tuple(_channel(run, channel, missing) for channel in CHANNELS),
        missing=tuple(missing),
    )


def ambient_pressure_pa(run: RunSeries, channel: str) -> float | None:
    """Return the ambient pressure that a channel's own sensor shows: its median before it is first evacuated.

    None if the channel has no samples before that; a sensor's offset drops out of the vacuum in this way.
    """
    pressure = run.pressures.get(channel)
    if pressure is None:
        return None
    energised_s = _energised_s(run, channel)
    before = pressure.values if energised_s is None else pressure.values[pressure.time_s < energised_s]
    return float(np.median(before)) if len(before) else None


def vacuum_pa(run: RunSeries, channel: str) -> Array | None:
    """Return a channel's measured vacuum over the times of its pressure, gauge, positive, or None if not measured."""
    pressure = run.pressures.get(channel)
    if pressure is None:
        return None
    ambient = ambient_pressure_pa(run, channel)
    vacuum: Array = (STANDARD_ATMOSPHERE_PA if ambient is None else ambient) - pressure.values
    return vacuum


def _channel(run: RunSeries, channel: str, missing: list[str]) -> ChannelSummary:
    if channel not in run.solenoids:
        missing.append(f"{SOLENOIDS[channel].name}: not known when it was energised")
    commanded = run.commanded_vacuum.get(channel)
    if commanded is None:
        missing.append(f"vacuum commanded of {channel} (neither jam_state nor jam_command): no time of reaching it")
    vacuum = vacuum_pa(run, channel)
    if vacuum is None:
        missing.append(f"{PRESSURES[channel].name}: not known when it reached its vacuum")
    elif ambient_pressure_pa(run, channel) is None:
        missing.append(
            f"{PRESSURES[channel].name} before the channel was evacuated: "
            f"ambient taken as {STANDARD_ATMOSPHERE_PA:.0f} Pa"
        )
    energised_s = _energised_s(run, channel)
    wanted_pa = float(commanded.values.max()) if commanded is not None else None
    reached_s = None
    if vacuum is not None and wanted_pa:
        series = run.pressures[channel]
        reached = vacuum >= REACHED_FRACTION * wanted_pa
        if energised_s is not None:
            reached &= series.time_s >= energised_s
        reached_s = _first_time(series, reached)
    return ChannelSummary(
        channel=channel,
        energised_s=energised_s,
        commanded_vacuum_pa=wanted_pa,
        reached_s=reached_s,
        greatest_vacuum_pa=float(vacuum.max()) if vacuum is not None else None,
    )


def _energised_s(run: RunSeries, channel: str) -> float | None:
    solenoid = run.solenoids.get(channel)
    return None if solenoid is None else _first_time(solenoid, solenoid.values > 0)


def _first_time(series: Series, condition: np.ndarray[Any, np.dtype[np.bool_]]) -> float | None:
    """Return the time of the first sample that meets a condition."""
    where = np.flatnonzero(condition)
    return float(series.time_s[where[0]]) if len(where) else None
