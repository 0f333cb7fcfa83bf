"""Where the constants of a landing come from: the fit of `LandingModel`, and a sweep of how feet hang."""

from __future__ import annotations

import itertools
import math
import sys
from typing import NamedTuple

import numpy as np
import typer
from scipy.optimize import minimize  # type: ignore[import-untyped]  # carries no types

from jammkle_common.command.main import run as run_command
from jammkle_common.command.results import console, progress_bar
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import CHANNELS
from jammkle_controller.core.landing import RATED_KG, LandingModel, travel_m
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import RobotOptions

_RELEASE_S, _WATCHED_S, _RATE_HZ = 0.9, 0.5, 1000
_PEAK_SAMPLES = 5
"""A peak is one of the mean over so many samples."""
_STRIKES_M_S = 0.1
"""Speed of the base from which on a heel that touches has struck."""
_TOUCH_M = 0.0051
"""Height of a heel's centre at which it touches: its radius, and a little."""
_PITCHES_RAD = (0.0, 0.2, 0.35, 0.44, 0.52, 0.6, 0.7, 0.78)
"""Up to what a robot can be built with, 45 degrees."""


class Tried(NamedTuple):
    """One landing of the leg with a vacuum that stands."""

    pitch_rad: float
    slope_deg: float
    payload_kg: float
    vacuum_pa: float
    speed_m_s: float
    peak_m_s2: float
    heel_m_s: float
    """Speed of the base as the heel touched; 0: it did not."""
    turned_rad: float


def land(pitch_rad: float, payload_kg: float, slope_deg: float, height_m: float, vacuum_pa: float) -> Tried:
    """Drop the leg once."""
    slope_rad = math.radians(slope_deg)
    options = RobotOptions(
        behaviour="drop",
        drop_height_m=height_m,
        release_time_s=_RELEASE_S,
        payload_kg=payload_kg,
        slope_deg=slope_deg,
        friction=0.8 + math.tan(slope_rad),
        hang_pitch_deg=math.degrees(pitch_rad),
        reservoir_volume_m3=0.0,
    )
    simulation = robot_simulation("leg", options)
    simulation.ankle.hold_vacuum(dict.fromkeys(CHANNELS, vacuum_pa))
    simulation.advance(round(_RELEASE_S / simulation.timestep_s))
    up_m_s, pitches_rad, speed_m_s, heel_m_s = [], [], 0.0, 0.0
    heel = simulation.data.geom("ankle/heel_left")
    for sample in simulation.samples(_WATCHED_S, _RATE_HZ):
        up_m_s.append(sample.base_velocity_m_s[2])
        pitches_rad.append(sample.ankles["ankle"].positions["ankle_pitch"])
        if sample.ankles["ankle"].foot.normal_force_n > 0.0:
            speed_m_s = speed_m_s or -up_m_s[-1]
        x_m, _, z_m = heel.xpos
        touches = (z_m - x_m * math.tan(slope_rad)) * math.cos(slope_rad) <= _TOUCH_M
        if speed_m_s and touches and not heel_m_s:
            heel_m_s = -up_m_s[-1]
    rises = np.array(up_m_s[_PEAK_SAMPLES:]) - np.array(up_m_s[:-_PEAK_SAMPLES])
    peak_m_s2 = float(rises.max()) * _RATE_HZ / _PEAK_SAMPLES
    turned_rad = pitches_rad[0] - min(pitches_rad)
    return Tried(pitch_rad, slope_deg, payload_kg, vacuum_pa, speed_m_s, peak_m_s2, heel_m_s, turned_rad)


app = typer.Typer(add_completion=False, context_settings={"help_option_names": ["-h", "--help"]})


@app.command()
def fit() -> int:
    """Land 720 times, and fit the constants of the landing model by logistic regression."""
    grid = [
        *itertools.product((0.52,), (0.0, 0.7, 1.5, 3.0), (0.0, 12.0), (0.02, 0.04, 0.07, 0.1, 0.14, 0.2)),
        *itertools.product((0.35, 0.44, 0.62), (0.0, 1.5), (0.0, 12.0), (0.02, 0.04, 0.07, 0.1, 0.14, 0.2)),
    ]
    tried = []
    with progress_bar("landings") as update:
        for index, (landing, vacuum_kpa) in enumerate(itertools.product(grid, range(0, 60, 10))):
            update(index / (6 * len(grid)), "")
            tried.append(land(*landing, 1e3 * vacuum_kpa))
    mass_kg = np.array([RATED_KG + each.payload_kg for each in tried])
    way_m = np.array([travel_m(each.pitch_rad) + travel_m(math.radians(each.slope_deg)) for each in tried])
    above_pa = np.maximum(np.array([each.vacuum_pa for each in tried]) - LandingModel().onset_pa, 0.0)
    kinetic_j = mass_kg * np.array([each.speed_m_s for each in tried]) ** 2 / 2.0
    strikes = np.array([each.heel_m_s > _STRIKES_M_S for each in tried])

    def lacking_j(logs: np.ndarray) -> np.ndarray:
        stiffness, friction, saturation_pa, sinking_m, _ = np.exp(logs)
        jammed_n = friction * saturation_pa * (1.0 - np.exp(-above_pa / saturation_pa))
        energy_j = kinetic_j + mass_kg * STANDARD_GRAVITY_M_S2 * sinking_m
        return np.asarray(energy_j - stiffness * way_m**2 - jammed_n * way_m)

    def loss(logs: np.ndarray) -> float:
        share = lacking_j(logs) / np.exp(logs[-1])
        return float(np.mean(np.logaddexp(0.0, np.where(strikes, -share, share))))

    start = np.log([5000.0, 0.002, 1e5, 0.05, 0.2])
    found = minimize(loss, start, method="Nelder-Mead", options={"maxiter": 6000, "maxfev": 6000}).x
    names = ("stiffness_n_m", "friction_n_per_pa", "saturation_pa", "sinking_m", "scale_j")
    screen = console()
    for name, value in zip(names, np.exp(found), strict=True):
        screen.print(f"{name} {value:.4g}")
    screen.print(f"classified right {np.mean((lacking_j(found) > 0.0) == strikes):.3f}, strikes {strikes.mean():.3f}")
    return 0


@app.command()
def sweep() -> int:
    """Say what the pitch at which feet hang makes of landings, of standing and of a trot."""
    screen = console()
    screen.print(
        "pitch, rad | peak at 30, 60, 100 mm, 40 kPa, m/s^2 | way of the ankle, rad | highest fall without a "
        "strike, soft and 40 kPa, mm | stands jammed, soft, mm | trot, m/s, slides a step, mm"
    )
    for pitch_rad in _PITCHES_RAD:
        jammed = [land(pitch_rad, 0.0, 0.0, height_m, 40e3) for height_m in (0.03, 0.06, 0.1)]
        peaks = ", ".join(f"{each.peak_m_s2:.0f}" for each in jammed)
        highest = ", ".join(f"{_highest_mm(pitch_rad, vacuum_pa)}" for vacuum_pa in (0.0, 40e3))
        stands = ", ".join(f"{_standing_mm(pitch_rad, vacuum_pa):.0f}" for vacuum_pa in (40e3, 0.0))
        speed_m_s, slid_mm = _trot(pitch_rad)
        turned = max(each.turned_rad for each in jammed)
        screen.print(
            f"{pitch_rad:.2f} | {peaks} | {turned:.2f} | {highest} | {stands} | {speed_m_s:.2f}, {slid_mm:.0f}"
        )
    return 0


def _highest_mm(pitch_rad: float, vacuum_pa: float) -> int:
    heights_mm = range(20, 160, 20)
    strikes = (land(pitch_rad, 0.0, 0.0, 1e-3 * mm, vacuum_pa).heel_m_s > _STRIKES_M_S for mm in heights_mm)
    return next((mm - 20 for mm, struck in zip(heights_mm, strikes, strict=True) if struck), heights_mm[-1])


def _standing_mm(pitch_rad: float, vacuum_pa: float) -> float:
    simulation = robot_simulation(
        "quadruped", RobotOptions(hang_pitch_deg=math.degrees(pitch_rad), reservoir_volume_m3=0.0)
    )
    for ankle in simulation.ankles.values():
        ankle.hold_vacuum(dict.fromkeys(CHANNELS, vacuum_pa))
    *_, last = simulation.samples(2.0, 50)
    return 1e3 * last.base_position_m[2]


def _trot(pitch_rad: float) -> tuple[float, float]:
    """Return the speed, m/s, and how far a foot slides in a step, mm, jammed."""
    options = RobotOptions(behaviour="walk", hang_pitch_deg=math.degrees(pitch_rad), reservoir_volume_m3=0.0)
    simulation = robot_simulation("quadruped", options)
    for ankle in simulation.ankles.values():
        ankle.hold_vacuum(dict.fromkeys(CHANNELS, 40e3))
    *_, begin = simulation.samples(1.5, 50)
    *_, end = simulation.samples(2.5, 50)
    slid_m = [
        end.ankles[name].foot.sliding_distance_m - begin.ankles[name].foot.sliding_distance_m for name in end.ankles
    ]
    return (end.base_position_m[0] - begin.base_position_m[0]) / 2.5, 1e3 * float(np.mean(slid_m)) / 5.0


if __name__ == "__main__":
    sys.exit(run_command(app))
