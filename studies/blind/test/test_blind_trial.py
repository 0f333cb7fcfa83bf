"""A blind trial from one end to the other: made, diagnosed from bags alone, gone on with, scored."""

from __future__ import annotations

import functools
import json
import pickle
import runpy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from jammkle_common.command.main import run
from jammkle_gap import Problem, Recording, Signal, ankle_library
from studies.blind import __main__ as command
from studies.blind import diagnose
from studies.blind.cases import Kind, Rung, TrueEffect, Truth, read_case
from studies.blind.diagnose import Question, Remembering, Way, answers, blind_questions, open_questions, sampled
from studies.blind.make import Reality, make_case, plan_of
from studies.blind.page import FIGURES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from studies.blind.cases import CaseNote

blind = functools.partial(run, command.app)
SEED = 7
STRANGER = Path(__file__).with_name("stranger.py")


@pytest.fixture
def external(tmp_path: Path) -> tuple[Path, Path]:
    """Make the trial of a stranger, and return it and its key."""
    trial, key = tmp_path / "trial", tmp_path / "key.json"
    runpy.run_path(str(STRANGER))["main"](trial, key)
    return trial, key


def everything_in(trial: Path) -> str:
    """Return all text of a trial: file names, files, and what lies in the bags, unpacked."""
    parts = [str(file.relative_to(trial)) for file in trial.rglob("*")]
    plain = [file for file in trial.rglob("*") if file.is_file() and file.suffix != ".mcap"]
    parts += [file.read_text(encoding="utf-8") for file in plain]
    for metadata in trial.rglob("metadata.yaml"):
        with AnyReader([metadata.parent]) as reader:
            parts += [each.topic for each in reader.connections]
            parts += [bytes(data).decode("latin-1") for _, _, data in reader.messages()]
    return "\n".join(parts)


def test_nothing_in_a_trial_tells_the_answer(tmp_path: Path) -> None:
    """No file and no message holds the name of a fault, of an effect or of what is theirs alone."""
    plan = plan_of(SEED, 3, ("tensile",))
    truths = [make_case(SEED, case, tmp_path / "one" / case.name) for case in plan]
    assert {truth.kind for truth in truths} - {Kind.NONE}
    text = everything_in(tmp_path / "one")
    names = {effect.name for effect in ankle_library()} | set(Reality().faults)
    names |= {each.name for effect in ankle_library() for each in effect.parameters} | {"machine", "fault"}
    names -= {"extension_m"}  # how far the rig pulls, too
    assert [name for name in sorted(names) if name in text] == []
    assert make_case(SEED, plan[0], tmp_path / "two" / plan[0].name) == truths[0]
    made = [
        {file.relative_to(folder): file.read_bytes() for file in folder.rglob("*") if file.is_file()}
        for folder in (tmp_path / "one" / plan[0].name, tmp_path / "two" / plan[0].name)
    ]
    assert made[0] == made[1]


def test_what_is_asked_blind_and_with_the_truth_at_hand() -> None:
    """Blind: no effect is named, without references first; then the oracle, each effect left out once, the ceiling."""
    few, many = [f"{k:04d}" for k in range(12)], [f"{k:04d}" for k in range(600)]
    assert sampled(few) == set(few)
    assert len(sampled(many)) == pytest.approx(100, abs=30)
    asked = blind_questions(few)
    assert all(not each.only and not each.without for questions in asked.values() for each in questions)
    assert {questions[0].way for questions in asked.values()} == {Way.WITHOUT}
    leak = (TrueEffect("leak"),)
    truths = {
        "1": Truth(Kind.SINGLE, leak, size=2.0, rigs=("drop",)),
        "2": Truth(Kind.SINGLE, leak, size=4.0, rigs=("drop",)),
        "3": Truth(Kind.SINGLE, leak, Rung.KNOWN, size=8.0),
        "4": Truth(Kind.NONE),
        "5": Truth(Kind.PAIR, (*leak, TrueEffect("wear")), size=1.0, rigs=("drop",)),
    }
    found = open_questions(truths, with_ceiling=True)
    assert set(found) == {"1", "2", "3", "5"}
    assert found["5"] == [Question(Way.ORACLE, only=("leak", "wear"))]
    assert [name for name, each in found.items() if Question(Way.LEFT_OUT, without=("leak",)) in each] == ["2"]
    assert sorted(name for name, each in found.items() if Question(Way.CEILING) in each) == ["1", "2"]
    assert not any(Question(Way.CEILING) in each for each in open_questions(truths, with_ceiling=False).values())


Asked = list[tuple["CaseNote", "Sequence[Question]"]]


def pretended(monkeypatch: pytest.MonkeyPatch, fail_at: int = 1000) -> Asked:
    """Have cases answered at once; returns what was asked. The case of a number ends everything."""
    asked: Asked = []

    def answers(note: CaseNote, questions: Sequence[Question]) -> dict[str, dict[str, Any]]:
        asked.append((note, questions))
        if len(asked) == fail_at:
            raise KeyboardInterrupt
        said = {"verdict": "NO_GAP", "gap_probability": 0.1, "gap": {}, "runtime": {}}
        return {each.way.value: {"rms": ["pump_wear"]} if each.way is Way.RMS else said for each in questions}

    monkeypatch.setattr(command, "answers", answers)
    return asked


def test_a_stopped_trial_goes_on_where_it_was(
    external: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What was answered is kept and not asked again; the truth is read only when all that is blind is answered."""
    words = ["--trial", str(external[0]), "--key", str(external[1]), "-o", str(tmp_path / "page"), "--jobs", "1"]
    hidden = external[1].rename(tmp_path / "elsewhere.json")
    asked = pretended(monkeypatch, fail_at=3)
    assert blind(words) == 130
    assert [len(questions) for _, questions in asked] == [6, 6, 6]
    assert blind(words) == 2  # the rest is answered without the key, which is missed only then
    assert len(asked) == 4
    hidden.rename(external[1])
    assert blind(words) == 0
    assert [[each.way for each in questions] for _, questions in asked[4:]] == [[Way.ORACLE]]
    assert blind(words) == 0
    assert len(asked) == 5
    for note, questions in asked[:4]:
        assert len({bag.split("/cases/")[1][:4] for bag in (*note.bags, *note.references)}) == 1
        assert not any(each.only or each.without for each in questions)


def test_a_refusal_is_one_of_its_way_alone(external: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """The way that a diagnosis gives up at is kept as refused with what it said; the others are still answered."""

    def of_no_reference(runs: Any, references: Any, *_: Any) -> Any:
        if not references:
            raise diagnose.BadRecordingError("nothing can be said")  # noqa: EM101, TRY003 - a test's
        return {"verdict": "NO_GAP", "runs": len(runs)}, None

    monkeypatch.setattr(diagnose, "_diagnosed", of_no_reference)
    found = answers(read_case(external[0] / "cases/0001"), [Question(Way.WITHOUT), Question(Way.WITH)])
    assert found["rig_0"]["refused"] == "nothing can be said"
    assert found["rig_5"]["verdict"] == "NO_GAP"


@pytest.mark.slow
@pytest.mark.timeout(600)  # three cases, each in six ways
def test_a_small_trial_of_a_stranger(external: tuple[Path, Path], tmp_path: Path) -> None:
    """Three cases of a simulator that this project does not know are diagnosed blind and scored.

    An untouched machine raises no alarm, and a sensor that reads too much is named, by the least error as well.
    """
    page, file = tmp_path / "page", tmp_path / "score.json"
    words = ["--trial", str(external[0]), "--key", str(external[1])]
    assert blind([*words, "-o", str(page), "--json", str(file)]) == 0
    found = json.loads(file.read_text(encoding="utf-8"))
    headline = found["ways"]["rig's sensors, five references"]
    outcomes = {case["case"]: case["outcome"] for case in headline["cases"]}
    assert outcomes["0001"] == "right"
    assert outcomes["0002"] in {"right", "in the set"}
    assert outcomes["0003"] != "wrong name"
    assert headline["figures"]["false_alarms"]["value"] == 0.0
    assert len(found["ways"]) == 6
    assert found["ways"]["least RMS error"]["cases"][1]["named"] == "pressure_sensor_offset_achilles"
    text = (page / "blind.html").read_text(encoding="utf-8")
    assert all(row.text in text for row in FIGURES if row.name in headline["figures"])
    assert "http://" not in text


class Counted:
    """A spring that bends as the square of its stiffness. Counts its runs."""

    def __init__(self) -> None:
        self.asked: list[dict[str, float]] = []

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        self.asked.append(dict(values))
        return {signal.name: signal.values / values.get("spring.stiffness", 1.0) ** 2 for signal in recording.signals}


def test_what_was_simulated_is_remembered() -> None:
    """A run is made once, whatever part of its signals is looked at, and stays what it was after a journey."""
    times_s = 0.01 * np.arange(200)
    way, load = (Signal(name, "m", times_s, np.sin(times_s)) for name in ("way", "load"))
    whole, part = (Recording("one", signals, setting="alone") for signals in ((way, load), (way,)))
    simulator = Counted()
    remembering = Remembering(Problem(simulator, ankle_library()))
    remembering.know([whole])
    first, second = (remembering(each, {"spring.stiffness": 1.1}) for each in (whole, part))
    assert len(simulator.asked) == 1
    assert first["way"] == pytest.approx(second["way"])
    assert pickle.loads(pickle.dumps(remembering))(part, {})["way"] == pytest.approx(way.values)  # noqa: S301 - own
