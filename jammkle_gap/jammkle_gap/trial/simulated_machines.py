"""Machines that the simulator itself plays: what constants of the diagnosis are learned on, away from any trial.

A machine is drawn from the priors of the simulator's constants, every run from its scatter, and sensors from their
noise. What it cannot show is how another machine differs in its equations: that is what the reality is for.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_gap.ankle.runs import recording_of_run
from jammkle_gap.core.data import Recording
from jammkle_gap.core.simulate import InfeasibleError
from jammkle_graph.parameters import from_mapping
from jammkle_sim.rigs.catalogue import rig_kind, run_rig

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.effects import Nuisance
    from jammkle_gap.core.simulate import Problem

_TRIES = 20
"""Times that a machine or run is drawn anew where it cannot be simulated."""


@dataclass(frozen=True)
class SimulatedCase:
    """One case whose truth is known."""

    rig: str
    truth: Mapping[str, float]
    """Parameters of effects by key; empty: healthy."""
    recordings: tuple[Recording, ...]
    references: tuple[Recording, ...]


def template_of(rig: str, settings: Mapping[str, Any], name: str) -> Recording:
    """Return a recording of a rig, whose inputs and times every run of a setting has.

    Args:
        rig: A name of the catalogue.
        settings: Its options.
        name: Of the setting.

    """
    options = from_mapping(rig_kind(rig).options, dict(settings))
    recording = recording_of_run(run_rig(rig, options, lambda _: None, lambda: False), name)
    return dataclasses.replace(recording, setting=name)


def simulated_case(
    templates: Sequence[Recording],
    problem: Problem,
    truth: Mapping[str, float],
    seed: int,
    *,
    faulty: int = 2,
    references: int = 5,
) -> SimulatedCase:
    """Return a case: healthy references and faulty runs of one drawn machine in every setting.

    Args:
        templates: One recording per setting.
        problem: Simulator and priors.
        truth: What is wrong, by key; empty: nothing.
        seed: Of machine, scatter and noise.
        faulty: Runs per setting that are to be diagnosed.
        references: Healthy runs per setting.

    Raises:
        InfeasibleError: no machine that was drawn could be simulated.

    """
    random = np.random.default_rng(seed)
    for _ in range(_TRIES):
        machine = _drawn(problem.constants, random)
        try:
            runs, healthy = (
                tuple(
                    _run(each, problem, {**machine, **values}, random, f"{kind} {k + 1}.{i + 1}")
                    for k, each in enumerate(templates)
                    for i in range(count)
                )
                for kind, values, count in (("run", dict(truth), faulty), ("reference", {}, references))
            )
        except InfeasibleError:
            continue
        return SimulatedCase(templates[0].inputs.rig, dict(truth), runs, healthy)
    msg = f"none of {_TRIES} machines could be simulated with {dict(truth)}; take a smaller effect"
    raise InfeasibleError(msg)


def _drawn(nuisances: Sequence[Nuisance], random: np.random.Generator) -> dict[str, float]:
    return {
        each.name: float(np.clip(each.null + each.sigma * random.standard_normal(), each.minimum, each.maximum))
        for each in nuisances
    }


def _run(
    template: Recording, problem: Problem, values: Mapping[str, float], random: np.random.Generator, name: str
) -> Recording:
    for attempt in range(_TRIES):
        try:
            readings = problem.simulator(template, {**values, **_drawn(problem.scatter, random)})
            break
        except InfeasibleError:
            if attempt == _TRIES - 1:
                raise
    signals = tuple(
        dataclasses.replace(each, values=_noisy(readings[each.name], each.noise, each.resolution, random))
        for each in template.signals
        if each.name in readings
    )
    return Recording(name, signals, template.inputs, template.phases, template.setting)


def _noisy(
    values: NDArray[np.float64], noise: float, resolution: float, random: np.random.Generator
) -> NDArray[np.float64]:
    read: NDArray[np.float64] = values + noise * random.standard_normal(values.shape)
    return np.round(read / resolution) * resolution if resolution else read
