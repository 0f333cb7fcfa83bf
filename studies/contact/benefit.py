"""What the ankle and its policy are good for: the same landings in seven ways, on robots whose feet hang toe-down.

Ways are auto; auto without the payload; the best single vacuum, chosen on landings of the tuning side; always
soft; always jammed; the same foot on a locked joint; and in hindsight the vacuum that was best for that very landing.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import joblib  # type: ignore[import-untyped]  # carries no types
import numpy as np
import typer

from jammkle_common.command.main import run as run_command
from jammkle_common.command.results import console, progress_bar, write_json
from jammkle_controller.core.landing import RATED_KG
from jammkle_controller.parameters import ControllerParameters, PolicyMode
from jammkle_driver.parameters import DriverParameters
from jammkle_sim.rigs.simulation import UnstableSimulationError
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import AnkleKind, RobotOptions
from studies.contact.loop import AnkleLoop
from studies.contact.trial import median_with_interval, wilson

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from jammkle_sim.rigs.simulation import Sample

AUTO, BLIND, FIXED, SOFT, JAMMED, RIGID, HINDSIGHT = (
    "auto",
    "auto, payload not known",
    "fixed",
    "always soft",
    "always jammed",
    "rigid",
    "hindsight",
)
WAYS = (AUTO, BLIND, FIXED, SOFT, JAMMED, RIGID, HINDSIGHT)
VACUUMS_PA = (0.0, 10e3, 20e3, 30e3, 40e3, 50e3)
"""Of which the best is chosen, for all landings or for each; 0 is soft, 40 kPa what always jammed holds."""
HELD_PA = ControllerParameters().hold_vacuum_pa
FEET = {"leg": 1, "quadruped": 4}
RATE_HZ = 500
_FILLED_S, _JAMMED_S = 3.2, 1.2
"""When it is dropped: with the reservoir full, or, where one vacuum is held without one, once that stands."""
_AFTER_S = 1.2
"""Watched from the release on."""
_SMOOTHED_S = 0.006
"""A peak of the base's acceleration is one of its mean over this time, s."""
_LEAST_AIR_S = 0.02
"""A foot that is off the ground for as long has rebounded."""
_REST_M_S = 0.02
"""Speed of the base below which it is at rest."""
_FALLEN_RAD = math.radians(45.0)


class Measured(NamedTuple):
    """What came of one landing."""

    peak_m_s2: float
    """Largest deceleration of the base."""
    rebounds: float
    """How often a foot left the ground again, in the mean over feet."""
    rest_s: float
    """From the first touch until the base rests."""
    slid_m: float
    """Mean way slid by a foot."""
    absorbed_j: float
    """Work done on the tendons of all ankles, less what they gave back: the integral of tension by extension."""
    sunk_m: float
    """From where the base was at the first touch to where it stands at last."""
    fell: float


Landings = list[Measured | None]
"""By landing; None where the simulation blew up."""


def draw(robot: str, seed: int, *, held_out: bool) -> RobotOptions:
    """Draw one landing: held out are greater heights, payloads and slopes, and rough ground."""
    chance = np.random.default_rng([seed, int(held_out), 79])
    slope_deg = float(chance.uniform(0.0, 25.0 if held_out else 12.0))
    return RobotOptions(
        behaviour="drop",
        imu="body",
        slope_deg=slope_deg,
        roughness_m=float(chance.choice([0.0, 0.0, 0.01, 0.02])) if held_out else 0.0,
        friction=math.tan(math.radians(slope_deg)) + float(chance.uniform(0.2 if held_out else 0.4, 1.0)),
        drop_height_m=float(chance.uniform(0.02, 0.2) if held_out else chance.uniform(0.03, 0.12)),
        payload_kg=FEET[robot] * float(chance.uniform(0.0, 1.0 if held_out else 0.5)),
        seed=seed,
    )


class Drop:
    """One landing in one way, ready to be let go."""

    def __init__(self, robot: str, options: RobotOptions, way: str, vacuum_pa: float = 0.0) -> None:
        """Set it up.

        Args:
            robot: Its name.
            options: The landing.
            way: One of WAYS but the last.
            vacuum_pa: Of the way fixed; 0: soft.

        """
        by_policy = way in (AUTO, BLIND)
        self.release_s = _FILLED_S if by_policy else _JAMMED_S
        reservoir_m3 = options.reservoir_volume_m3 if by_policy else 0.0
        kind = AnkleKind.RIGID if way == RIGID else AnkleKind.JAMMABLE
        options = dataclasses.replace(
            options, ankle=kind.value, release_time_s=self.release_s, reservoir_volume_m3=reservoir_m3
        )
        mode = PolicyMode.AUTO if by_policy else PolicyMode.FIXED if way == FIXED else PolicyMode.ALWAYS_JAMMED
        if way == SOFT or (way == FIXED and vacuum_pa == 0.0):
            mode = PolicyMode.ALWAYS_SOFT
        controller = ControllerParameters(
            imu_mount=options.imu,
            policy=mode.value,
            hang_pitch_deg=options.hang_pitch_deg,
            landing_vacuum_pa=vacuum_pa or HELD_PA,
            load_kg=RATED_KG + (0.0 if way == BLIND else options.payload_kg / FEET[robot]),
        )
        self.simulation = robot_simulation(robot, options)
        # faults are not of concern, and take time
        driver = DriverParameters(reservoir_volume_m3=reservoir_m3, diagnose=False)
        ankles = () if way == RIGID else self.simulation.ankles.values()
        self._loops = [AnkleLoop(view, controller, driver) for view in ankles]

    def samples(self) -> Iterator[Sample]:
        """Let it go, and give the samples from then on, at `RATE_HZ`.

        Raises:
            UnstableSimulationError: it blew up.

        """
        for sample in self.simulation.samples(self.release_s + _AFTER_S, RATE_HZ):
            for loop in self._loops:
                loop.step(sample.time_s)
            if sample.time_s >= self.release_s:
                yield sample


def measure(robot: str, options: RobotOptions, way: str, vacuum_pa: float = 0.0) -> Measured | None:
    """Land once; None where the simulation blew up. Arguments as of `Drop`."""
    rows, absorbed_j = [], 0.0
    try:
        for sample in Drop(robot, options, way, vacuum_pa).samples():
            ankles = sample.ankles.values()
            absorbed_j += sum(t.tension_n * t.extension_rate_m_s for a in ankles for t in a.tendons) / RATE_HZ
            slid_m = float(np.mean([ankle.foot.sliding_distance_m for ankle in ankles]))
            rows.append(
                (
                    sample.base_velocity_m_s[2],
                    sample.base_position_m[2],
                    slid_m,
                    sample.base_tilt_rad,
                    *(ankle.foot.stands for ankle in ankles),
                )
            )
    except UnstableSimulationError:
        return None
    return _measured(np.array(rows, dtype=float), absorbed_j, math.radians(options.slope_deg))


def deceleration_m_s2(up_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the base's deceleration in the mean over `_SMOOTHED_S`, m/s^2, of its speed upward at `RATE_HZ`, m/s."""
    window = round(_SMOOTHED_S * RATE_HZ)
    slowed: NDArray[np.float64] = (up_m_s[window:] - up_m_s[:-window]) / _SMOOTHED_S
    return slowed


def _measured(rows: Any, absorbed_j: float, slope_rad: float) -> Measured:
    up_m_s, height_m, slid_m, tilt_rad, stands = rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3], rows[:, 4:] > 0.0
    touch = int(np.argmax(stands.any(axis=1)))
    moving = np.flatnonzero(np.abs(up_m_s[touch:]) > _REST_M_S)
    return Measured(
        float(deceleration_m_s2(up_m_s).max()),
        float(np.mean([_rebounds(stands[touch:, foot]) for foot in range(stands.shape[1])])),
        float(moving[-1] / RATE_HZ) if len(moving) else 0.0,
        float(slid_m[-1]),
        absorbed_j,
        float(height_m[touch] - height_m[-1]),
        float(tilt_rad.max() - slope_rad > _FALLEN_RAD),
    )


def _rebounds(stands: Any) -> int:
    """Count the times in the air, after the first touch."""
    edges = np.flatnonzero(np.diff(stands.astype(int)))
    first = int(np.argmax(stands))
    leaves = [int(edge) for edge in edges if edge >= first]
    return sum(
        end - begin >= _LEAST_AIR_S * RATE_HZ for begin, end in pairwise([*leaves, len(stands)]) if not stands[end - 1]
    )


def benefit(
    seed: int, runs: int, jobs: int, on_progress: Callable[[float, str], None], robots: Sequence[str] = tuple(FEET)
) -> list[dict[str, Any]]:
    """Measure every robot and way on the same `runs` held-out landings; a quarter as many choose the fixed vacuum.

    Returns:
        A row per robot and way: how many landings, and medians with intervals by name, or None where there are none;
        `ratio` is the peak over hindsight's of the same landing.

    """
    rows = []
    for number, robot in enumerate(robots):

        def landed(landings: list[RobotOptions], way: str, vacuum_pa: float = 0.0, robot: str = robot) -> Landings:
            work = (joblib.delayed(measure)(robot, each, way, vacuum_pa) for each in landings)
            return list(joblib.Parallel(n_jobs=jobs)(work))

        on_progress(number / len(robots), f"{robot}: tuning")
        tuning = [draw(robot, 1000 * seed + index, held_out=False) for index in range(max(runs // 4, 1))]
        tried = [[each.peak_m_s2 if each else np.nan for each in landed(tuning, FIXED, pa)] for pa in VACUUMS_PA]
        best_pa = VACUUMS_PA[int(np.argmin(np.nanmean(np.log(tried), axis=1)))]
        on_progress((number + 0.3) / len(robots), f"{robot}: held out, fixed at {best_pa * 1e-3:.0f} kPa")
        landings = [draw(robot, 1000 * seed + index, held_out=True) for index in range(runs)]
        at = {vacuum_pa: landed(landings, FIXED, vacuum_pa) for vacuum_pa in VACUUMS_PA}
        by_way = {way: landed(landings, way) for way in WAYS if way not in {FIXED, HINDSIGHT}}
        by_way[FIXED] = at[best_pa]
        by_way[HINDSIGHT] = [
            min((each for each in tries if each is not None), key=lambda each: each.peak_m_s2, default=None)
            for tries in zip(*at.values(), strict=True)
        ]
        rows += [
            {"robot": robot, "way": f"{way}, {best_pa * 1e-3:.0f} kPa" if way == FIXED else way, **figures}
            for way, figures in _figures(by_way).items()
        ]
    return rows


def _figures(by_way: dict[str, Landings]) -> dict[str, dict[str, Any]]:
    """Return the figures of each way on the landings that no way blew up on."""
    whole = [tries for tries in zip(*(by_way[way] for way in WAYS), strict=True) if all(tries)]
    best_m_s2 = [each.peak_m_s2 for *_, each in whole]
    found = {}
    for way, landed in zip(WAYS, zip(*whole, strict=True) if whole else ((),) * len(WAYS), strict=True):
        columns = {name: [getattr(each, name) for each in landed] for name in Measured._fields}
        peaks, fell = columns.pop("peak_m_s2"), columns.pop("fell")
        columns = {"peak_m_s2": peaks, "ratio": [p / best for p, best in zip(peaks, best_m_s2, strict=True)], **columns}
        figures = {name: median_with_interval(column) for name, column in columns.items()}
        figures["falls"] = wilson(round(sum(fell)), len(fell))
        found[way] = {"runs": len(landed)} | {
            name: None if any(map(math.isnan, figure)) else figure for name, figure in figures.items()
        }
    return found


app = typer.Typer(add_completion=False, context_settings={"help_option_names": ["-h", "--help"]})


@app.command()
def main(
    output: Annotated[Path, typer.Option("-o", "--output", help="File of the figures.")] = Path("runs/benefit.json"),
    runs: Annotated[int, typer.Option(help="Held-out landings of each robot.")] = 200,
    seed: Annotated[int, typer.Option(help="Everything is drawn from it.")] = 7,
    jobs: Annotated[int, typer.Option(help="Processes.")] = 1,
    robot: Annotated[list[str] | None, typer.Option(help="Which; none: all.")] = None,
) -> int:
    """Measure what the ankle is good for, and write the figures."""
    with progress_bar("benefit") as update:
        rows = benefit(seed, runs, jobs, update, robot or tuple(FEET))
    output.parent.mkdir(parents=True, exist_ok=True)
    write_json(output, {"rows": rows})
    screen = console()
    for row in rows:
        words, figures = list(row.values())[:3], list(row.values())[3:]
        cells = ("-" if each is None else "{:.3g} ({:.3g} to {:.3g})".format(*each) for each in figures)
        screen.print(" | ".join([*map(str, words), *cells]))
    return 0


if __name__ == "__main__":
    sys.exit(run_command(app))
