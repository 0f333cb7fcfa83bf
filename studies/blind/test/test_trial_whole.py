"""A blind trial from one end to the other: made, diagnosed in other processes, stopped and gone on with, scored."""

from __future__ import annotations

import functools
import json
import runpy
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from jammkle_common.command.main import main, run
from jammkle_common.command.results import commit
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.recording import load_recording
from studies.blind import run as blind_run
from studies.blind.__main__ import app
from studies.blind.aims import AIMS
from studies.blind.beside import BASELINES
from studies.blind.redacted import redacted
from studies.blind.regimes import SMALL_SEED
from studies.blind.sources import Reality

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

EXAMPLE = Path(__file__).with_name("stranger.py")

blind = functools.partial(run, app)


@pytest.fixture(autouse=True)
def _own_signals() -> Iterator[None]:
    """Give the test process its signal handlers back; the command installs its own."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def external(tmp_path: Path) -> tuple[Path, Path]:
    """Make the trial of the example in the docs, and return it and its key."""
    trial, key = tmp_path / "trial", tmp_path / "key.json"
    runpy.run_path(str(EXAMPLE))["main"](trial, key)
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
    """No file and no message holds the name of a fault, of an effect or of what is theirs alone; the key is outside."""
    trial, key = tmp_path / "trial", tmp_path / "key.json"
    words = ["--seed", str(SMALL_SEED), "--cases", "3", "--rig", "tensile", "--jobs", "1"]
    assert blind(["make", *words, "-o", str(trial), "--key", str(key)]) == 0
    kinds = {truth["kind"] for truth in json.loads(key.read_text(encoding="utf-8"))["cases"].values()}
    assert kinds - {"none"}
    text = everything_in(trial)
    names = {effect.name for effect in ankle_library()} | set(Reality().faults)
    names |= {each.name for effect in ankle_library() for each in effect.parameters} | {"machine", "salt", "fault"}
    names -= {"extension_m"}  # how far the rig pulls, too
    assert [name for name in sorted(names) if name in text] == []
    assert not list(tmp_path.glob("*.part"))


def test_the_same_seed_makes_the_same_bags(tmp_path: Path) -> None:
    """Two trials of one seed differ in the salt of their keys alone."""
    words = ["--seed", str(SMALL_SEED), "--cases", "1", "--rig", "tensile", "--jobs", "1"]
    made = []
    for name in ("one", "two"):
        assert blind(["make", *words, "-o", str(tmp_path / name)]) == 0
        case = tmp_path / name / "cases"
        made.append({file.relative_to(case): file.read_bytes() for file in case.rglob("*") if file.is_file()})
    assert made[0] == made[1]
    keys = [json.loads((tmp_path / f"{name}_key.json").read_text(encoding="utf-8")) for name in ("one", "two")]
    assert keys[0]["cases"] == keys[1]["cases"]
    assert keys[0]["salt"] != keys[1]["salt"]


def test_a_bag_of_the_graph_is_copied_without_its_secret(tmp_path: Path) -> None:
    """A simulated ankle's bag names the effects in it; the copy does not, and reads the same to the diagnosis."""
    leak = tmp_path / "leak.yaml"
    leak.write_text("line_leak_achilles: {conductance_dm3_s_bar: 0.003}", encoding="utf-8")
    rig = ["rig", "pressure", "--cycles", "1", "--jam-time-s", "1", "--vent-time-s", "0.3", "--seed", "4242"]
    assert main([*rig, "--effects", str(leak), "-o", str(tmp_path / "whole" / "bag")]) == 0
    redacted(tmp_path / "whole/bag", tmp_path / "copy/bag", "/")
    assert "line_leak" in everything_in(tmp_path / "whole")
    text = everything_in(tmp_path / "copy")
    assert not any(word in text for word in ("line_leak", "conductance", "effects", "4242"))
    whole, copy = (load_recording(tmp_path / name / "bag") for name in ("whole", "copy"))
    assert (copy.setting, copy.inputs.key) == (whole.setting, whole.inputs.key)
    for one, other in zip(whole.signals, copy.signals, strict=True):
        assert one.name == other.name
        assert np.array_equal(one.values, other.values)


Asked = list[dict[str, Any]]
"""What processes were told, one after the other."""


def pretended(
    monkeypatch: pytest.MonkeyPatch, fail_after: int = 1000, refuse: tuple[str, ...] = (), code: int = 2
) -> Asked:
    """Have processes answer at once; returns what they were told.

    Args:
        monkeypatch: Of the test.
        fail_after: Answers after which the process that makes them is ended from outside.
        refuse: Ways that are refused.
        code: What the process of such a way ends with.

    """
    asked: Asked = []
    made = 0

    def call(_command: Any, folder: Path, _stop: Any, meanwhile: Callable[[], None]) -> tuple[int, str]:
        nonlocal made
        told = json.loads((folder / "questions.json").read_text(encoding="utf-8"))
        asked.append(told)
        for way in told["ways"]:
            if made == fail_after:
                return -9, "killed"
            if way["run"] in refuse:
                return code, f"jammkle: nothing can be said of {way['run']}"
            content: dict[str, Any] = {"verdict": "NO_GAP", "gap_probability": 0.1, "bags": ["where"]}
            if way["run"] == "baselines":
                content = {"baselines": {"rmse": ["pump_wear"], "bic": [], "free": ["pump_wear"], "learned": []}}
            (folder / f"{way['run']}.json").write_text(json.dumps(content), encoding="utf-8")
            made += 1
            meanwhile()
        return 0, ""

    monkeypatch.setattr(blind_run, "_call", call)
    return asked


def test_a_stopped_trial_goes_on_where_it_was(
    external: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was answered is kept and not asked again, also of a case that was under way; a third call does nothing."""
    trial, _ = external
    pretended(monkeypatch, fail_after=7)
    assert blind(["run", str(trial), "--jobs", "1"]) == 1
    assert "case 0002 was ended from outside" in capsys.readouterr().err
    kept = {file: file.stat().st_mtime_ns for file in trial.glob("answers/*/*.json")}
    assert len(kept) == 7
    second = pretended(monkeypatch)
    assert blind(["run", str(trial), "--jobs", "1"]) == 0
    assert [len(told["ways"]) for told in second] == [5, 6]
    assert all(file.stat().st_mtime_ns == time_ns for file, time_ns in kept.items())
    third = pretended(monkeypatch)
    assert blind(["run", str(trial), "--jobs", "1"]) == 0
    assert third == []


@pytest.mark.parametrize("code", [1, 2])
def test_a_refusal_is_one_of_its_way_alone(
    external: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    """The way that a process gives up at is kept as refused with what it said; the others are still answered."""
    trial, _ = external
    pretended(monkeypatch, refuse=("rig_5",), code=code)
    assert blind(["run", str(trial), "--jobs", "1"]) == 0
    answers = {file.relative_to(trial): json.loads(file.read_text("utf-8")) for file in trial.glob("answers/*/*.json")}
    assert len(answers) == 18
    for file, answer in answers.items():
        said = answer.get("refused", "")
        assert said == ("jammkle: nothing can be said of rig_5" if "rig_5" in str(file) else "")


def test_a_diagnosis_is_told_of_its_bags_alone(external: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Before the key is opened a process is told the bags of one case, and no effect.

    What must not look at references is answered before the others, and alone is told of none.
    """
    trial, key = external
    asked = pretended(monkeypatch)
    assert blind(["run", str(trial), "--jobs", "1"]) == 0
    assert len(asked) == 3
    for told in asked:
        assert set(told) == {"format", "bags", "references", "rig", "settings", "ways"}
        assert str(key) not in json.dumps(told)
        assert len({bag.split("/cases/")[1][:4] for bag in (*told["bags"], *told["references"])}) == 1
        assert not any(way["only"] or way["without"] for way in told["ways"])
        assert told["ways"][0]["run"] == "rig_0"
        assert told["references"]
    for file in trial.glob("answers/rig_0/*.json"):
        file.unlink()
    again = pretended(monkeypatch)
    assert blind(["run", str(trial), "--jobs", "1"]) == 0
    assert [told["references"] for told in again] == [[], [], []]


@pytest.mark.slow
def test_a_bag_that_is_its_own_reference_is_still_diagnosed_without(
    external: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A process answers the ways that it can, writes each beside its questions, and says why it gives up."""
    trial, _ = external
    asked = pretended(monkeypatch)
    assert blind(["run", str(trial), "--jobs", "1"]) == 0
    told = {**asked[1], "references": asked[1]["bags"]}
    questions = trial.parent / "asked" / "questions.json"
    questions.parent.mkdir()
    questions.write_text(json.dumps(told), encoding="utf-8")
    assert blind(["answer", str(questions), "--jobs", "1"]) == 2
    assert "is given as a reference too" in capsys.readouterr().err
    made = {file.name for file in questions.parent.iterdir()}
    assert made == {"questions.json", "rig_0.json"}
    assert json.loads((questions.parent / "rig_0.json").read_text(encoding="utf-8"))["finished"]


def test_answers_are_fixed_before_the_key_is_opened(
    external: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """An answer that is changed after the key was opened makes the score refuse the trial."""
    trial, key = external
    pretended(monkeypatch)
    assert blind(["run", str(trial), "--key", str(key), "--jobs", "1"]) == 0
    words = ["score", str(trial), "--key", str(key), "-o", str(tmp_path / "page")]
    assert blind(words) == 0
    answer = trial / "answers/rig_5/0002.json"
    answer.write_text(answer.read_text(encoding="utf-8").replace("NO_GAP", "UNKNOWN"), encoding="utf-8")
    capsys.readouterr()
    assert blind(words) == 2
    assert "not blind any more" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.timeout(600)  # three cases, each a process of its own
def test_a_small_trial_of_a_stranger(external: tuple[Path, Path], tmp_path: Path) -> None:
    """Three cases of a reality that this project does not know are diagnosed blind and scored; the hash is on the page.

    An untouched machine raises no alarm, and a sensor that reads too much is named, by simpler methods as well.
    """
    trial, key = external
    assert blind(["run", str(trial), "--key", str(key)]) == 0
    page, file = tmp_path / "page", tmp_path / "score.json"
    assert blind(["score", str(trial), "--key", str(key), "-o", str(page), "--json", str(file)]) == 0
    found = json.loads(file.read_text(encoding="utf-8"))
    headline = found["ways"]["rig's sensors, five references"]
    outcomes = {case["case"]: case["outcome"] for case in headline["cases"]}
    assert outcomes["0001"] == "right"
    assert outcomes["0002"] in {"right", "in the set"}
    assert outcomes["0003"] != "wrong name"
    assert headline["figures"]["false_alarms"]["value"] == 0.0
    assert len(found["ways"]) == 5
    assert set(found["baselines"]) == set(BASELINES.values())
    ranked = json.loads((trial / "answers/baselines/0002.json").read_text(encoding="utf-8"))["baselines"]
    assert {ranked[name][0] for name in ("rmse", "bic", "learned")} == {"pressure_sensor_offset_achilles"}
    text = (page / "blind.html").read_text(encoding="utf-8")
    assert found["trial"]["key_sha256"] in text
    assert found["trial"]["answers_sha256"] in text
    assert found["trial"]["diagnosed_by"] == [commit()]
    assert "diagnosed by" in text
    assert all(aim.text in text for aim in AIMS)
    assert "http://" not in text.replace("http://www.w3.org", "")
