"""The demo's diagnosis: an effect hidden in a simulated ankle, a diagnosis of its landing, and then the truth."""

from __future__ import annotations

import dataclasses
import enum
import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.command.errors import GraphError, InputError, Interrupted
from jammkle_common.command.results import progress_bar
from jammkle_gap.ankle.corrected import corrected_text
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.problem import ankle_problem
from jammkle_gap.ankle.recording import load_recording, recording_of_run
from jammkle_gap.ankle.sensors import headline_set, selected
from jammkle_gap.backend import backend
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.result import Verdict, as_dict
from jammkle_gap.diagnosing import PAGE_NAME, diagnosis_of, write_page
from jammkle_gap.report import words
from jammkle_gap.report.words import parameter_lines, probability, times
from jammkle_sim.rigs.catalogue import run_rig, scattered
from jammkle_sim.rigs.landing import LandingRunOptions
from jammkle_sim.rigs.run import RigCancelledError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from rich.console import Console

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.effects import Library
    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.core.simulate import Problem


@dataclass(frozen=True)
class DemoEffect:
    """One effect of the library with the sizes that it may have."""

    name: str
    parameter: str
    smallest: float
    largest: float
    """In the parameter's unit; within them, a landing still jams every channel."""


EFFECTS: tuple[DemoEffect, ...] = (
    DemoEffect("tendon_stiffness", "scale", 1.2, 1.6),
    DemoEffect("jamming_friction", "scale", 0.3, 0.7),
    DemoEffect("fibre_loss_achilles_left", "lost", 0.2, 0.5),
    DemoEffect("fibre_loss_achilles_right", "lost", 0.2, 0.5),
    DemoEffect("imu_offset", "z_m_s2", 0.15, 0.5),
    DemoEffect("line_leak_achilles", "conductance_dm3_s_bar", 0.001, 0.003),
    DemoEffect("pump_wear", "flow_scale", 0.6, 0.85),
    DemoEffect("valve_dead_time", "extra_s", 0.006, 0.02),
)
"""Of air, tendons and IMU. At rest an IMU that sits crooked reads as one with an offset along the floor, and so only
that upwards is among these. Where its foot sticks and slips, a landing tells nothing of mass and friction: such effects
are not among these."""


class Outcome(enum.Enum):
    """How the diagnosis did."""

    RIGHT = "right"
    AMONG_SEVERAL = "among several"
    MISSED = "missed"
    WRONG = "wrong"


REFERENCES = 5
"""Landings of the healthy ankle that the recorded one is compared with."""
_SEED = 1
_RIG = "landing"
_SETTING = "landing on a slope"
"""Of the recorded landing and of the references. The controller's switching is its answer to the machine, and what the
graph does when it stops is nobody's: each run is simulated at its own commands."""

_SENTENCES = {
    Outcome.RIGHT: "The diagnosis was right.",
    Outcome.AMONG_SEVERAL: "The diagnosis named it among several between which this landing does not decide.",
    Outcome.MISSED: "The diagnosis did not find it.",
    Outcome.WRONG: "The diagnosis was wrong.",
}


@dataclass(frozen=True)
class Ending:
    """What was said, what was true."""

    diagnosis: Diagnosis
    outcome: Outcome
    truth: str
    recordings: Sequence[Recording] = field(repr=False)
    references: Sequence[Recording] = field(repr=False)
    problem: Problem = field(repr=False)

    def write_page(self, folder: Path) -> Path:
        """Write the page of the gap and the corrected simulator into a folder that exists; return the page's file."""
        write_page(self.diagnosis, self.recordings, self.references, self.problem, folder)
        return folder / PAGE_NAME

    def as_json(self) -> dict[str, Any]:
        """Return it for a file."""
        return {
            "diagnosis": as_dict(self.diagnosis),
            "diagnosis_truth": self.truth,
            "diagnosis_outcome": self.outcome.value,
        }

    def show(self, console: Console) -> None:
        """Say verdict, effects and how far the gap closes, and only then what was true."""
        diagnosis = self.diagnosis

        def say(text: str) -> None:
            console.print(text, markup=False)

        say("")
        say(
            f"Does this ankle do what its simulator says? Diagnosed from the bag, beside {REFERENCES} landings of a "
            "healthy ankle, simulated without the graph."
        )
        say(f"verdict: {words.VERDICTS[diagnosis.verdict]}. {words.headline(diagnosis)}")
        for check in words.checks(diagnosis, {effect.name: effect.sentence for effect in ankle_library()}):
            say(f"  - {check}")
        for line in parameter_lines(diagnosis.effects):
            say(f"  {line['effect']}: {line['parameter']} {line['value']} (90 %: {line['interval']})")
        gap = diagnosis.gap
        after = f" -> {times(gap.corrected)}" if diagnosis.effects else ""
        say(f"gap: {times(gap.nominal)}{after} times healthy scatter; p-value {probability(diagnosis.p_value)}")
        say(f"in truth: {self.truth}. {_SENTENCES[self.outcome]}")


@dataclass(frozen=True)
class HiddenEffect:
    """What the demo puts into its simulated ankle without saying so, and has diagnosed."""

    values: Mapping[str, float]
    """By `effect.parameter`; empty: nothing."""

    @classmethod
    def drawn(cls, effect: str | None, seed: int | None = None) -> HiddenEffect:
        """Hide an effect of a drawn size.

        Args:
            effect: Its name; None draws one.
            seed: Of the draw; None: another one each time.

        Raises:
            InputError: no effect of the demo has this name.

        """
        draws = random.SystemRandom() if seed is None else random.Random(seed)  # noqa: S311 - no secret of that kind
        known = {each.name: each for each in EFFECTS}
        if effect is not None and effect not in known:
            msg = f"--effect '{effect}' is none that a landing can show; choose one of: {', '.join(known)}"
            raise InputError(msg)
        chosen = draws.choice(EFFECTS) if effect is None else known[effect]
        return cls({f"{chosen.name}.{chosen.parameter}": draws.uniform(chosen.smallest, chosen.largest)})

    @classmethod
    def nothing(cls) -> HiddenEffect:
        """Hide nothing: the ankle is as its simulator has it."""
        return cls({})

    @property
    def name(self) -> str:
        """Name of the effect; empty without one."""
        return next(iter(self.values), "").partition(".")[0]

    @property
    def effects_file(self) -> str:
        """Content of the file that the sim node loads; empty: nothing is hidden."""
        return corrected_text(ankle_library(), self.values) if self.values else ""

    def text(self, library: Library) -> str:
        """Say what it was, with value and unit."""
        if not self.values:
            return "nothing: the simulated ankle was as its simulator has it"
        key, value = next(iter(self.values.items()))
        parameter = next(each for each in library.effect(self.name).parameters if key.endswith(f".{each.name}"))
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        return f"{self.name}, {parameter.name} {value:.3g}{unit} (null at {parameter.null:g})"

    def outcome(self, diagnosis: Diagnosis) -> Outcome:
        """Judge a diagnosis; an equivalence class that the truth is in is named with it."""
        if diagnosis.verdict is Verdict.NO_GAP:
            return Outcome.MISSED if self.values else Outcome.RIGHT
        if diagnosis.verdict is Verdict.UNKNOWN:
            return Outcome.MISSED if self.values else Outcome.WRONG
        if not self.values:
            return Outcome.WRONG
        named = [(each.names, *((other,) for other in each.equivalents)) for each in diagnosis.candidates]
        if diagnosis.verdict is Verdict.EFFECTS:
            if named[0] == ((self.name,),):
                return Outcome.RIGHT
            return Outcome.AMONG_SEVERAL if len(named[0][0]) == 1 and (self.name,) in named[0] else Outcome.WRONG
        return Outcome.AMONG_SEVERAL if any((self.name,) in each for each in named) else Outcome.WRONG

    def diagnosed(self, bag: Path, namespace: str, asked_to_stop: Callable[[], bool]) -> Ending:
        """Diagnose a landing's bag; the truth is looked at afterwards, to judge.

        Raises:
            GraphError: the bag cannot be diagnosed.
            Interrupted: the command was asked to stop.

        """
        try:
            recording = load_recording(bag, namespace=namespace)
        except BadRecordingError as error:
            msg = f"the landing cannot be diagnosed: {error}"
            raise GraphError(msg) from error
        sensors = headline_set(recording)
        recorded, *references = (
            dataclasses.replace(selected(each, sensors), setting=_SETTING)
            for each in (until_vented(recording), *healthy_landings(asked_to_stop))
        )
        with backend(None, None) as jobs:
            problem = ankle_problem()
            diagnosis = diagnosis_of([recorded], references, problem, jobs, asked_to_stop)
        if asked_to_stop():
            raise Interrupted
        return Ending(diagnosis, self.outcome(diagnosis), self.text(problem.library), [recorded], references, problem)


def until_vented(recording: Recording) -> Recording:
    """Return a landing up to where its first channel is vented again: the demo's end, which references do not have."""
    vented_s = [
        float(line.time_s[i])
        for line in recording.inputs.commands.solenoids.values()
        for i in np.flatnonzero(np.diff(line.values) < 0.0) + 1
    ]
    end_s = min(vented_s, default=np.inf)
    signals = []
    for each in recording.signals:
        kept = each.time_s < end_s
        if kept.any():
            signals.append(dataclasses.replace(each, time_s=each.time_s[kept], values=each.values[kept]))
    return dataclasses.replace(recording, signals=tuple(signals))


def healthy_landings(asked_to_stop: Callable[[], bool]) -> list[Recording]:
    """Return references: landings of the healthy ankle that scatter as the rig does, the same whenever asked for.

    They are run without the graph, as a lab would record them on the same rig before: their times of commands and
    their height, slope and friction are their own.

    Raises:
        Interrupted: asked to stop.

    """
    found = []
    with progress_bar("landing a healthy ankle") as show:
        for repeat in range(REFERENCES):
            show(repeat / REFERENCES, f"{repeat + 1} of {REFERENCES}")
            options = scattered(_RIG, LandingRunOptions(seed=_SEED), repeat)
            try:
                run = run_rig(_RIG, options, lambda _: None, asked_to_stop)
            except RigCancelledError as error:
                raise Interrupted from error
            found.append(recording_of_run(run, f"healthy landing {repeat + 1}"))
    return found
