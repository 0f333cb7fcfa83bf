"""What the ankle and its policy are good for: landings, pushes and walks, the same in every way of `ways`.

python -m studies.contact.benefit --runs 200 --robot leg -o runs/benefit.json
"""

from __future__ import annotations

import dataclasses
import enum
import itertools
import math
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import joblib  # type: ignore[import-untyped]  # carries no types
import numpy as np
import typer
from scipy import stats  # type: ignore[import-untyped]  # carries no types

from jammkle_common.command.errors import InputError
from jammkle_common.command.main import run as run_command
from jammkle_common.command.results import console, progress_bar, write_json
from jammkle_sim.rigs.simulation import UnstableSimulationError
from jammkle_sim.robots.options import ROBOTS, RobotOptions
from studies.contact.stances import FALLEN_RAD, Walked, push, push_of_half_m_s, slid_m, tilt_rad, walk
from studies.contact.trial import median_with_interval, wilson
from studies.contact.ways import (
    AUTO,
    BLIND,
    FEET,
    FILLED_S,
    FIXED,
    HINDSIGHT,
    JAMMED,
    JAMMED_S,
    KNOWING,
    RATE_HZ,
    RIGID,
    SOFT,
    Tried,
    by_policy,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from jammkle_sim.rigs.simulation import Sample

VACUUMS_PA = (0.0, 10e3, 20e3, 30e3, 40e3, 50e3)
"""Of which the best is chosen, for all landings or for each; 0 is soft, 40 kPa what always jammed holds."""
PUSHED_ROBOTS = ("quadruped", "mini_cheetah")
"""A leg on its boom cannot be pushed from the side."""
_AFTER_S = 1.2
"""Watched from the release on."""
_SMOOTHED_S = 0.006
"""A peak of the base's acceleration is one of its mean over this time, s."""
_LEAST_AIR_S = 0.02
"""A foot that is off the ground for as long has rebounded."""
_REST_M_S = 0.02
"""Speed of the base below which it is at rest."""


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
    tilt_rad: float
    """Largest tilt of the base from how it hung."""
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
        """Set it up; arguments as of `Tried`."""
        self.release_s = FILLED_S if by_policy(way) else JAMMED_S
        options = dataclasses.replace(options, release_time_s=self.release_s)
        self._tried = Tried(robot, options, way, vacuum_pa)
        self.simulation = self._tried.simulation

    def samples(self) -> Iterator[Sample]:
        """Let it go, and give the samples from then on, at `RATE_HZ`.

        Raises:
            UnstableSimulationError: it blew up.

        """
        return (each for each in self._tried.samples(self.release_s + _AFTER_S) if each.time_s >= self.release_s)


def measure(robot: str, options: RobotOptions, way: str, vacuum_pa: float = 0.0) -> Measured | None:
    """Land once; None where the simulation blew up. Arguments as of `Drop`."""
    rows, absorbed_j = [], 0.0
    hung = None
    try:
        for sample in Drop(robot, options, way, vacuum_pa).samples():
            hung = hung or sample
            ankles = sample.ankles.values()
            absorbed_j += sum(t.tension_n * t.extension_rate_m_s for a in ankles for t in a.tendons) / RATE_HZ
            rows.append(
                (
                    sample.base_velocity_m_s[2],
                    sample.base_position_m[2],
                    slid_m(sample),
                    tilt_rad(sample, hung),
                    *(ankle.foot.stands for ankle in ankles),
                )
            )
    except UnstableSimulationError:
        return None
    return _measured(np.array(rows, dtype=float), absorbed_j)


def deceleration_m_s2(up_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the base's deceleration in the mean over `_SMOOTHED_S`, m/s^2, of its speed upward at `RATE_HZ`, m/s."""
    window = round(_SMOOTHED_S * RATE_HZ)
    slowed: NDArray[np.float64] = (up_m_s[window:] - up_m_s[:-window]) / _SMOOTHED_S
    return slowed


def _measured(rows: Any, absorbed_j: float) -> Measured:
    (up_m_s, height_m, way_m, tilts_rad), stands = rows[:, :4].T, rows[:, 4:] > 0.0
    touch = int(np.argmax(stands.any(axis=1)))
    moving = np.flatnonzero(np.abs(up_m_s[touch:]) > _REST_M_S)
    return Measured(
        float(deceleration_m_s2(up_m_s).max()),
        float(np.mean([_rebounds(stands[touch:, foot]) for foot in range(stands.shape[1])])),
        float(moving[-1] / RATE_HZ) if len(moving) else 0.0,
        float(way_m[-1]),
        absorbed_j,
        float(height_m[touch] - height_m[-1]),
        float(tilts_rad.max()),
        float(tilts_rad.max() > FALLEN_RAD),
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
    seed: int, runs: int, jobs: int, on_progress: Callable[[float, str], None], robots: Sequence[str] = ROBOTS
) -> list[dict[str, Any]]:
    """Measure every robot and way on the same `runs` held-out landings; a quarter as many choose the fixed vacuum.

    Returns:
        A row per robot and way: how many landings, and by name median and interval, or None where there are none.
        `ratio` is the peak over hindsight's of the same landing, `over_auto` the geometric mean of the peak over that
        of auto in the same landing.

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
        at = {_fixed(vacuum_pa): landed(landings, FIXED, vacuum_pa) for vacuum_pa in VACUUMS_PA}
        by_way = {way: landed(landings, way) for way in (AUTO, BLIND, KNOWING)}
        by_way |= {_fixed(best_pa) + ", the best of the tuning side": at[_fixed(best_pa)]}
        by_way |= {way: landed(landings, way) for way in (SOFT, JAMMED, RIGID)}
        by_way[HINDSIGHT] = [
            min((each for each in tries if each is not None), key=lambda each: each.peak_m_s2, default=None)
            for tries in zip(*at.values(), strict=True)
        ]
        by_way |= {way: landed for way, landed in at.items() if way not in (_fixed(0.0), _fixed(best_pa))}
        rows += [{"robot": robot, "way": way, **figures} for way, figures in _figures(by_way).items()]
    return rows


def _fixed(vacuum_pa: float) -> str:
    return f"{FIXED}, {vacuum_pa * 1e-3:.0f} kPa"


def _figures(by_way: dict[str, Landings]) -> dict[str, dict[str, Any]]:
    """Return the figures of each way on the landings that no way blew up on."""
    whole = [tries for tries in zip(*by_way.values(), strict=True) if all(tries)]
    found = {}
    landings = dict(zip(by_way, zip(*whole, strict=True) if whole else ((),) * len(by_way), strict=True))
    best_m_s2, auto_m_s2 = (np.array([each.peak_m_s2 for each in landings[way]]) for way in (HINDSIGHT, AUTO))
    for way, landed in landings.items():
        columns = {name: [getattr(each, name) for each in landed] for name in Measured._fields}
        peaks, fell = np.array(columns.pop("peak_m_s2")), columns.pop("fell")
        columns = {"peak_m_s2": peaks.tolist(), "ratio": (peaks / best_m_s2).tolist(), **columns}
        figures = {name: median_with_interval(column) for name, column in columns.items()}
        figures["over_auto"] = _geometric_mean(peaks / auto_m_s2)
        figures["falls"] = wilson(round(sum(fell)), len(fell))
        found[way] = {"runs": len(landed)} | _known(figures)
    return found


def _geometric_mean(ratios: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return it with the 95 % interval of the mean of the logarithms (Student's t); NaN of fewer than two."""
    if len(ratios) < 2:  # noqa: PLR2004 - of one there is no spread
        return (math.nan, math.nan, math.nan)
    logs = np.log(ratios)
    half = float(stats.t.ppf(0.975, len(logs) - 1) * stats.sem(logs))
    mean = float(np.mean(logs))
    return (math.exp(mean), math.exp(mean - half), math.exp(mean + half))


def _known(figures: dict[str, tuple[float, float, float]]) -> dict[str, tuple[float, float, float] | None]:
    return {name: None if any(map(math.isnan, figure)) else figure for name, figure in figures.items()}


def pushes(seed: int, runs: int, jobs: int, robots: Sequence[str] = PUSHED_ROBOTS) -> list[dict[str, Any]]:
    """Push robots that stand: a row per robot and way with the push that half of the stances withstand."""
    rows = []
    for robot, way in itertools.product(robots, (AUTO, SOFT, JAMMED, RIGID)):
        work = (joblib.delayed(push)(robot, 1000 * seed + index, way) for index in range(runs))
        pushed = [each for each in joblib.Parallel(n_jobs=jobs)(work) if each is not None]
        figures = {name: median_with_interval([getattr(p, name) for p in pushed if not p.fell]) for name in _STOOD}
        half = {"push_m_s": push_of_half_m_s(pushed)}
        fell = {"falls": wilson(sum(each.fell for each in pushed), len(pushed))}
        rows.append({"robot": robot, "way": way, "runs": len(pushed)} | half | _known(figures) | fell)
    return rows


_STOOD = ("tilt_rad", "slid_m")
"""What is reported of those that stand after a push."""


def walks(seed: int, runs: int, jobs: int, fixed_pa: float) -> list[dict[str, Any]]:
    """Let the quadruped walk on rough ground: a row per way."""
    rows = []
    for way in (AUTO, FIXED, SOFT, JAMMED, RIGID):
        work = (joblib.delayed(walk)("quadruped", 1000 * seed + index, way, fixed_pa) for index in range(runs))
        walked = [each for each in joblib.Parallel(n_jobs=jobs)(work) if each is not None]
        figures = {name: median_with_interval([getattr(each, name) for each in walked]) for name in Walked._fields}
        fell = {"falls": wilson(sum(each.fell for each in walked), len(walked))}
        named = _fixed(fixed_pa) if way == FIXED else way
        rows.append({"robot": "quadruped", "way": named, "runs": len(walked)} | _known(figures) | fell)
    return rows


app = typer.Typer(add_completion=False, context_settings={"help_option_names": ["-h", "--help"]})


class What(str, enum.Enum):
    """What is measured."""

    LANDINGS = "landings"
    PUSHES = "pushes"
    WALKS = "walks"


@app.command()
def main(
    what: Annotated[What, typer.Argument(help="What is measured.")] = What.LANDINGS,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File of the figures.")] = None,
    runs: Annotated[int, typer.Option(help="Landings, pushes or walks of each robot in each way.")] = 200,
    seed: Annotated[int, typer.Option(help="Everything is drawn from it.")] = 9,
    jobs: Annotated[int, typer.Option(help="Processes.")] = 1,
    robot: Annotated[list[str] | None, typer.Option(help=f"Which of {', '.join(FEET)}; none: all that can.")] = None,
    fixed_kpa: Annotated[float, typer.Option(help="Of walks: the vacuum of the way fixed.")] = 40.0,
) -> int:
    """Measure what the ankle is good for, and write the figures."""
    able = {What.LANDINGS: tuple(FEET), What.PUSHES: PUSHED_ROBOTS, What.WALKS: ("quadruped",)}[what]
    unable = [each for each in robot or () if each not in able]
    if unable:
        msg = f"--robot {unable[0]}: {what.value} are of {', '.join(able)}"
        raise InputError(msg)
    if what is What.LANDINGS:
        with progress_bar("benefit") as update:
            rows = benefit(seed, runs, jobs, update, robot or able)
    elif what is What.PUSHES:
        rows = pushes(seed, runs, jobs, robot or able)
    else:
        rows = walks(seed, runs, jobs, 1e3 * fixed_kpa)
    output = output or Path(f"runs/benefit/{what.value}.json")
    output.parent.mkdir(parents=True, exist_ok=True)
    write_json(output, {"rows": rows})
    screen = console()
    for row in rows:
        words, figures = list(row.values())[:3], list(row.items())[3:]
        cells = (
            f"{name} " + ("-" if each is None else "{:.3g} ({:.3g} to {:.3g})".format(*each)) for name, each in figures
        )
        screen.print(" | ".join([*map(str, words), *cells]))
    return 0


if __name__ == "__main__":
    sys.exit(run_command(app))
