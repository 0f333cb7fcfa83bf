"""What simpler methods say of the same recordings: what the diagnosis must be better than, and no part of it.

All fit by ordinary least squares on residuals in noise units, every sample counting as one of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.november.compared import compare
from jammkle_gap.november.sensitivity import probe, space_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.effect import Library
    from jammkle_gap.november.recording import Recording
    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.runs import Runs, Spent
    from jammkle_gap.november.sensitivity import Probe, Space
    from jammkle_gap.november.simulator import Simulator

_FITTED = 12
"""Single effects that are fitted: those that promise most by their derivatives. Assumed: the best is among them."""
_SINGLE_STEPS, _FREE_STEPS = 2, 6
"""Runs of a fit after its probes: each corrects the derivatives (Broyden's rule). More change no ranking."""
_SHORTER = 0.4
"""What a step is cut to that makes it worse."""


@dataclass(frozen=True)
class Baselines:
    """Names ranked by each method, best first."""

    rmse: tuple[str, ...]
    """Single effects by the root mean square that they leave."""
    bic: tuple[str, ...]
    """The same by the Bayesian information criterion over all samples; ends where no effect at all is better."""
    free: tuple[str, ...]
    """All effects fitted at once, by how much each moves the signals."""
    errors: Mapping[str, float]
    """Root mean square that each single effect leaves, noise units; without a name: that of the nominal simulator."""
    spent: Spent


def baselines(
    recordings: Sequence[Recording],
    simulator: Simulator,
    library: Library,
    *,
    references: Sequence[Recording] = (),
    jobs: int | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> Baselines:
    """Rank the effects as simpler methods do.

    Args:
        recordings: What was measured.
        simulator: Runs a recording again.
        library: Effects offered.
        references: Of the same machine in good order; taken off as the diagnosis does.
        jobs: Processes.
        stop: Asked now and then; True ends it with StoppedError.

    Raises:
        BadRecordingError: the recordings cannot be used.
        StoppedError: stopped.

    """
    compared = compare(recordings, simulator, references, jobs, stop)
    runs, layout = compared.runs, compared.layout
    residual = layout.residual(compared.nominal)
    probes = [each for each in probe(library, runs, layout, residual) if each.alive]
    errors = {"": _rms(residual)}
    for each in sorted(probes, key=_promised)[:_FITTED]:
        space = space_of([each.effect])
        start = _Point(each.start, each.residual, each.jacobian)
        errors[each.effect.name] = min(errors[""], _rms(_fitted(space, start, layout, runs, _SINGLE_STEPS).residual))
    by_error = sorted((name for name in errors if name), key=lambda name: errors[name])
    size = {each.effect.name: len(each.effect.parameters) for each in probes} | {"": 0}
    criteria = {name: _bic(error, size[name], residual.size) for name, error in errors.items()}
    by_criterion = sorted(criteria, key=lambda name: criteria[name])
    return Baselines(
        rmse=tuple(by_error),
        bic=tuple(by_criterion[: by_criterion.index("")]),
        free=_all_free(probes, residual, layout, runs),
        errors=errors,
        spent=runs.spent,
    )


@dataclass(frozen=True)
class _Point:
    """Where a fit is."""

    shares: NDArray[np.float64]
    """Of the ranges."""
    residual: NDArray[np.float64]
    jacobian: NDArray[np.float64]


def _promised(probe: Probe) -> float:
    """Return the root mean square that an effect leaves if it does what its derivatives say."""
    step = _step_within(probe.start, probe.residual, probe.jacobian)
    return _rms(probe.residual + probe.jacobian @ step)


def _step_within(
    shares: NDArray[np.float64], residual: NDArray[np.float64], jacobian: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the step of least squares that stays in the ranges."""
    room = np.vstack([-shares, 1.0 - shares]) + np.array([[-1e-12], [1e-12]])
    # The same problem in as many rows as columns: there are far more samples.
    rows: NDArray[np.float64] = np.asarray(np.linalg.qr(np.column_stack([jacobian, -residual]), mode="r"))
    step: NDArray[np.float64] = lsq_linear(rows[:, :-1], rows[:, -1], bounds=(room[0], room[1])).x
    return step


def _fitted(space: Space, start: _Point, layout: Layout, runs: Runs, steps: int) -> _Point:
    """Return the bounded least-squares fit, by steps of Gauss and Newton with corrected derivatives."""
    best, jacobian, length = start, start.jacobian.copy(), 1.0
    for _ in range(steps):
        step = length * _step_within(best.shares, best.residual, jacobian)
        if not np.abs(step).max() > 1e-9:  # noqa: PLR2004 - of the ranges: nothing moves any more
            break
        shares = np.clip(best.shares + step, 0.0, 1.0)
        residual = layout.residual(runs.evaluate([space.values(shares)])[0])
        jacobian += np.outer(residual - best.residual - jacobian @ step, step) / float(step @ step)
        if _rms(residual) < _rms(best.residual):
            best, length = _Point(shares, residual, jacobian), 1.0
        else:
            length *= _SHORTER
    return best


def _all_free(probes: Sequence[Probe], residual: NDArray[np.float64], layout: Layout, runs: Runs) -> tuple[str, ...]:
    """Fit all effects at once, and rank them by how much each of them moves the signals then."""
    if not probes:
        return ()
    space = space_of([each.effect for each in probes])
    jacobian = np.column_stack([each.alone for each in probes])
    found = _fitted(space, _Point(space.null, residual, jacobian), layout, runs, _FREE_STEPS)
    moved = (found.shares - space.null) * jacobian
    ends = np.cumsum([len(each.effect.parameters) for each in probes])
    parts = np.split(moved, ends[:-1], axis=1)
    sizes = {each.effect.name: _rms(part.sum(axis=1)) for each, part in zip(probes, parts, strict=True)}
    return tuple(sorted(sizes, key=lambda name: -sizes[name]))


def _bic(error: float, parameters: int, samples: int) -> float:
    return samples * 2.0 * float(np.log(max(error, 1e-12))) + parameters * float(np.log(samples))


def _rms(residual: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(residual**2)))
