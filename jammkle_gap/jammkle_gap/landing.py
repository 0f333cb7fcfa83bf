"""The end of the demo: what the bag alone tells of the simulated ankle, and then what was really done to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.isolated import IsolatedSimulator, thinned, with_instruments_noise
from jammkle_gap.ankle.loading import load_recording
from jammkle_gap.ankle.november import for_november
from jammkle_gap.landing_effects import Outcome, outcome
from jammkle_gap.november.diagnosis import diagnose
from jammkle_gap.november.recording import BadRecordingError
from jammkle_gap.november.result import as_dict
from jammkle_gap.november.runs import StoppedError
from jammkle_gap.report import words
from jammkle_graph.command.errors import GraphError
from jammkle_graph.command.progress import progress_bar
from jammkle_graph.command.signals import Interrupted

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from rich.console import Console

    from jammkle_gap.landing_effects import Secret
    from jammkle_gap.november.diagnosis import Diagnosis

_RATE_HZ = 100.0
"""Rate that signals are thinned to: that of the pressures; the demo shall end within a minute."""

_SENTENCES = {
    Outcome.RIGHT: "The diagnosis was right.",
    Outcome.AMONG_SEVERAL: "The diagnosis named it among several that this landing cannot tell apart.",
    Outcome.MISSED: "The diagnosis did not find it.",
    Outcome.WRONG: "The diagnosis was wrong.",
}


@dataclass(frozen=True)
class Ending:
    """What was said, what was true."""

    diagnosis: Diagnosis
    outcome: Outcome
    truth: str

    def as_json(self) -> dict[str, Any]:
        """Return it for a file."""
        return {
            "diagnosis": as_dict(self.diagnosis),
            "diagnosis_truth": self.truth,
            "diagnosis_outcome": self.outcome.value,
        }


def diagnose_landing(bag: Path, namespace: str, secret: Secret, asked_to_stop: Callable[[], bool]) -> Ending:
    """Diagnose a landing's bag; the secret is looked at afterwards, to judge.

    Raises:
        GraphError: the bag cannot be diagnosed.
        Interrupted: the command was asked to stop.

    """
    library = ankle_library()
    try:
        with progress_bar("diagnosing") as show:
            recording = with_instruments_noise(for_november(load_recording(bag, namespace=namespace)))
            recording = thinned(recording, _RATE_HZ)
            diagnosis = diagnose(
                [recording],
                IsolatedSimulator(library),
                library,
                jobs=1,
                on_progress=lambda stage, share, _left_s: show(share, stage),
                stop=asked_to_stop,
            )
    except BadRecordingError as error:
        msg = f"the landing cannot be diagnosed: {error}"
        raise GraphError(msg) from error
    except StoppedError as error:
        raise Interrupted from error
    if asked_to_stop():
        raise Interrupted
    found = outcome(secret, diagnosis.verdict, [each.names for each in diagnosis.candidates])
    return Ending(diagnosis, found, secret.text(library))


def show_ending(console: Console, ending: Ending) -> None:
    """Say verdict, effects and how far the gap closes, and only then what was true."""
    diagnosis = ending.diagnosis

    def say(text: str) -> None:
        console.print(text, markup=False)

    say("")
    say("Does this ankle do what its simulator says? Diagnosed from the bag: air, tendons and IMU.")
    say(f"verdict: {diagnosis.verdict.value.replace('_', ' ')}. {words.headline(diagnosis)}")
    for check in words.checks(diagnosis):
        say(f"  - {check}")
    for effect in diagnosis.effects:
        for each in effect.parameters:
            low, high = each.interval
            unit = "" if each.unit == "1" else f" {each.unit}"
            say(f"  {effect.name}: {each.name} {each.value:.3g}{unit} (95 %: {low:.3g} to {high:.3g})")
    gap = diagnosis.gap
    if diagnosis.effects:
        say(f"gap: {gap.nominal:.2f} -> {gap.with_effect:.2f} noise units, held out; 1 is the noise")
    else:
        say(f"gap: {gap.nominal:.2f} noise units; 1 is the noise")
    say(f"in truth: {ending.truth}. {_SENTENCES[ending.outcome]}")
