"""One case of the trial: a machine is made, recorded, diagnosed from its recordings, and compared with the truth."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mujoco import minimize  # type: ignore[import-untyped]  # carries no types

from jammkle_gap import diagnose_mujoco, features_of, layout_of, measured, run_of_arrays
from studies.any_robot.machines import OUTSIDE, ROBOTS, SINGLES, Fault, able, machine_of, put_fault, record

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap import RobotDiagnosis

    Array = NDArray[np.float64]

RECORDINGS, DURATION_S, SEARCH_S = 3, 6.0, 9.0
TOLERANCE = 0.04
"""Within which constants of the machines are drawn evenly; the diagnosis takes them for normal with 2 to 2.5 %."""
_KINDS = ("single", "single", "single", "outside", "single", "pair", "single", "none", "single", "single")
"""Of ten cases: seven have one effect, one two, one none, and one what the library has not."""
_CLEAR = 5.0
"""What an effect must change beside constants and the best other one, in standard deviations, to be nameable. Chosen:
an ideal observer then errs in less than one of a hundred cases (Neyman-Pearson, two normal distributions 5 apart)."""


@dataclass(frozen=True)
class Case:
    """What is true, what was said, and what others say of the same recordings."""

    seed: int
    robot: str
    kind: str
    truth: tuple[str, ...]
    label: str
    nameable: bool
    verdict: str
    first: tuple[str, ...]
    named: tuple[tuple[str, ...], ...]
    """Members of the credible set, and of their equivalence classes; the empty one is none of the effects."""
    rms: str
    """First by RMS error alone."""
    bic: tuple[str, ...]
    """Chosen by stepwise BIC beside free constants."""
    largest: str
    """Largest move, in its bounds, of least squares of everything."""
    closed: float
    """Share of the squared error that the corrected model takes away in windows that were not fitted."""
    least: float
    """The same of least squares of everything, in those that were."""
    wall_s: float
    notes: tuple[str, ...] = field(default=())


def run_case(seed: int, jobs: int = 1) -> Case:
    """Make a machine, and diagnose it."""
    random = np.random.default_rng(seed)
    robot, kind = tuple(ROBOTS)[seed % 3], _KINDS[seed // 3 % len(_KINDS)]
    model = machine_of(robot, TOLERANCE, random)
    fault = Fault()
    pool = [each for each in (OUTSIDE if kind == "outside" else SINGLES) if able(robot, each)]
    wanted = {"none": 0, "pair": 2}.get(kind, 1)
    for what in random.choice(pool, wanted, replace=False):
        put_fault(fault, model, robot, str(what), random)
    runs, gains = [], {joint: {"kp": kp, "kd": kd} for joint, (kp, kd) in ROBOTS[robot].gains.items()}
    for number in range(RECORDINGS):
        made = record(robot, model, fault, DURATION_S, random)
        read = {key: values for key, values in made.items() if not key.startswith(("command.", "time_s"))}
        asked = {key[len("command.") :]: values for key, values in made.items() if key.startswith("command.")}
        runs.append(run_of_arrays(f"run {number}", made["time_s"], read, asked))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.xml"
        file.write_text(ROBOTS[robot].xml)
        found = diagnose_mujoco(file, runs, {"gains": gains}, folder=folder, search_s=SEARCH_S, jobs=jobs)
        others = Rivals(found)
    diagnosis = found.diagnosis
    named = [each for each in diagnosis.candidates if each.names]
    members = [each.names for each in diagnosis.candidates]
    members += [(other,) for each in named for other in each.equivalents]
    before = sum(each.nominal**2 / others.noise[each.signal] for each in found.closing)
    after = sum(each.corrected**2 / others.noise[each.signal] for each in found.closing)
    return Case(
        seed,
        robot,
        kind,
        tuple(sorted(fault.names)),
        fault.label,
        others.is_nameable(fault.sizes),
        diagnosis.verdict.value,
        tuple(sorted(named[0].names)) if named else (),
        tuple(tuple(sorted(each)) for each in members),
        others.rms(),
        others.bic(),
        *others.everything(),
        1.0 - after / before,
        diagnosis.spent.wall_s,
    )


class Rivals:
    """What others make of the same recordings, from one Jacobian of every effect and constant."""

    def __init__(self, found: RobotDiagnosis) -> None:
        """Simulate every effect once, at a tenth of its range."""
        simulator, compared = found.problem.simulator, found.recordings
        layouts = [layout_of([each], 0.05, None) for each in compared]

        def features(values: Mapping[str, float] | None) -> Array:
            parts = []
            for layout, each in zip(layouts, compared, strict=True):
                made = measured(each) if values is None else simulator(each, values)
                parts.append(features_of(layout, each, made, None) / layout.floor)
            return np.concatenate(parts)

        self._features = features
        self.noise: dict[str, float] = {}
        for layout in layouts:
            for name, row in zip(layout.signals, layout.by_signal(layout.floor), strict=True):
                self.noise[name] = float(np.square(row).mean())
        nominal = features({})
        self._left = features(None) - nominal
        self._constants = np.array(
            [features({each.name: each.null + each.sigma}) - nominal for each in found.problem.constants]
        ).T
        self._columns: dict[str, Array] = {}
        self._bounds: dict[str, tuple[float, float]] = {}
        for effect in found.library:
            for index, each in enumerate(effect.parameters):
                if effect.name in found.shared or (index and effect.name.startswith("stribeck")):
                    continue
                end = each.maximum if each.maximum != each.null else each.minimum
                share = 0.5 if effect.name.startswith("torque_limit") else 0.1
                column = features({effect.key(each): each.null + share * (end - each.null)}) - nominal
                lowest = 0.0 if each.null in {each.minimum, each.maximum} else -1.0
                self._columns[f"{effect.name}.{each.name}"] = column / share
                self._bounds[f"{effect.name}.{each.name}"] = (lowest, 1.0)
        for name, members in found.shared.items():
            first = [key for key in self._columns if key.rpartition(".")[0] in members]
            self._columns[f"{name}.shared"] = np.sum([self._columns[key] for key in first], axis=0)
            self._bounds[f"{name}.shared"] = self._bounds[first[0]]
        self._shared = set(found.shared)

    def _of(self, name: str) -> list[str]:
        return [key for key in self._columns if key.rpartition(".")[0] == name]

    def _fitted(self, keys: Sequence[str], beside: Array) -> float:
        """Return what is left, squared, by some columns within their bounds beside others that are free."""
        own = np.array([self._columns[key] for key in keys]).T.reshape(len(self._left), -1)
        table = np.hstack([own, beside])
        share = np.linalg.lstsq(table, self._left, rcond=1e-9)[0]
        for k, key in enumerate(keys):
            share[k] = np.clip(share[k], *self._bounds[key])
        rest = self._left - own @ share[: len(keys)]
        if beside.shape[1]:
            rest = rest - beside @ np.linalg.lstsq(beside, rest, rcond=1e-9)[0]
        return float(rest @ rest)

    def is_nameable(self, sizes: Mapping[str, Mapping[str, float]]) -> bool:
        """Return whether each true effect changes enough that neither constants nor any other effect does the same.

        Args:
            sizes: Of every true effect, in the library's numbers.

        """
        prior = np.vstack([self._constants, np.eye(self._constants.shape[1])])
        whole = self._features({key: value for own in sizes.values() for key, value in own.items()})
        for name in sizes:
            others = {key: value for other, own in sizes.items() if other != name for key, value in own.items()}
            signature = np.append(whole - self._features(others), np.zeros(prior.shape[1]))
            least = np.inf
            for other in {key.rpartition(".")[0] for key in self._columns} - {name}:
                if name in self._shared and other.startswith(name):
                    continue
                rival = np.array([np.append(self._columns[key], np.zeros(prior.shape[1])) for key in self._of(other)]).T
                table = np.hstack([rival, prior])
                rest = signature - table @ np.linalg.lstsq(table, signature, rcond=1e-9)[0]
                least = min(least, float(np.linalg.norm(rest)))
            if least < _CLEAR:
                return False
        return bool(sizes)

    def rms(self) -> str:
        """Return the effect that leaves the least RMS error by itself."""
        none = np.zeros((len(self._left), 0))
        names = {key.rpartition(".")[0] for key in self._columns}
        return min(sorted(names), key=lambda name: self._fitted(self._of(name), none))

    def bic(self) -> tuple[str, ...]:
        """Return what stepwise selection by BIC takes up beside free constants."""
        chosen: list[str] = []
        count = len(self._left)
        names = sorted({key.rpartition(".")[0] for key in self._columns})

        def score(some: Sequence[str]) -> float:
            keys = [key for name in some for key in self._of(name)]
            return count * float(np.log(self._fitted(keys, self._constants) / count)) + len(keys) * float(np.log(count))

        best = score(())
        while len(chosen) < _MOST_STEPS:
            scores = {name: score([*chosen, name]) for name in names if name not in chosen}
            first = min(scores, key=lambda name: scores[name])
            if scores[first] >= best:
                break
            chosen, best = [*chosen, first], scores[first]
        return tuple(chosen)

    def everything(self) -> tuple[str, float]:
        """Return the largest move of least squares with everything free, by the optimiser of mujoco.sysid.

        Effects that joints share are left out, as they are sums of others. Linear: a step of it.
        """
        keys = [key for key in self._columns if key.rpartition(".")[0] not in self._shared]
        table = np.hstack([np.array([self._columns[key] for key in keys]).T, self._constants])
        low = np.array([*(self._bounds[key][0] for key in keys), *([-5.0] * self._constants.shape[1])])
        high = np.array([1.0] * len(keys) + [5.0] * self._constants.shape[1])
        moved, _ = minimize.least_squares(
            np.zeros((len(low), 1)),
            lambda x: self._left[:, np.newaxis] - table @ x,
            bounds=[low[:, np.newaxis], high[:, np.newaxis]],
            jacobian=lambda _x, _r: -table,
            verbose=minimize.Verbosity.SILENT,
        )
        rest = self._left - table @ moved.ravel()
        best = int(np.argmax(np.abs(moved.ravel()[: len(keys)])))
        return keys[best].rpartition(".")[0], 1.0 - float(rest @ rest) / float(self._left @ self._left)


_MOST_STEPS = 6
"""Effects that stepwise selection may take up."""
