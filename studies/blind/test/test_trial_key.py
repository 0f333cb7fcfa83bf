"""The key of a blind trial: hashed, kept apart, refused if touched; the files of a trial tell nothing."""

from __future__ import annotations

import functools
import json
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_common.command.errors import InputError
from jammkle_common.command.main import run
from studies.blind import files
from studies.blind.__main__ import app
from studies.blind.key import (
    Key,
    Kind,
    Rung,
    TrueEffect,
    Truth,
    check_apart,
    new_salt,
    read_key,
    truth_as_dict,
    truth_of,
    write_key,
)

if TYPE_CHECKING:
    from pathlib import Path

blind = functools.partial(run, app)

LEAK = Truth(
    Kind.SINGLE,
    (TrueEffect("line_leak_achilles", {"conductance_dm3_s_bar": 0.002}),),
    size=4.0,
    location=("pneumatics",),
)


def trial_with_key(folder: Path) -> tuple[Path, Path]:
    """Return a trial of one case that has no bag worth the name, and its key."""
    trial, key = folder / "trial", folder / "key.json"
    case = trial / "cases" / "0001"
    (case / "bags" / "run_1").mkdir(parents=True)
    files.write_case(case, files.CaseNote(("bags/run_1",)))
    files.write_trial(trial, files.TrialFacts(write_key(key, Key({"0001": LEAK}, new_salt()))))
    return trial, key


def test_a_key_comes_back_as_it_was_written(tmp_path: Path) -> None:
    """What is read with the published hash is what was written, and nobody else may read the file."""
    key = Key({"0001": LEAK, "0002": Truth(Kind.NONE, rung=Rung.KNOWN)}, new_salt())
    sha256 = write_key(tmp_path / "key.json", key)
    assert read_key(tmp_path / "key.json", sha256) == key
    assert (tmp_path / "key.json").stat().st_mode & 0o077 == 0


def test_a_touched_key_is_refused(tmp_path: Path) -> None:
    """One changed number in the key is enough for it not to be that of the trial any more."""
    sha256 = write_key(tmp_path / "key.json", Key({"0001": LEAK}, new_salt()))
    text = (tmp_path / "key.json").read_text(encoding="utf-8")
    (tmp_path / "key.json").write_text(text.replace("0.002", "0.003"), encoding="utf-8")
    with pytest.raises(InputError, match="another key, or was changed"):
        read_key(tmp_path / "key.json", sha256)


def test_the_same_key_has_another_hash_each_time(tmp_path: Path) -> None:
    """With a salt in it, the hash does not tell whether a guess of the answers is right."""
    hashes = {write_key(tmp_path / f"{k}.json", Key({"0001": LEAK}, new_salt())) for k in range(3)}
    assert len(hashes) == 3


@pytest.mark.parametrize("place", ["trial/key.json", "trial/cases/key.json", "trial/../trial/key.json"])
def test_a_key_inside_the_trial_is_refused(tmp_path: Path, place: str) -> None:
    """The diagnosis must not be able to find it: not in the folder, not below it, not by a detour."""
    with pytest.raises(InputError, match="inside the trial"):
        check_apart(tmp_path / place, tmp_path / "trial")
    check_apart(tmp_path / "key.json", tmp_path / "trial")


@given(
    st.sampled_from([Kind.SINGLE, Kind.PAIR, Kind.MIDRUN]),
    st.lists(st.floats(-1e6, 1e6, allow_nan=False), min_size=2, max_size=2),
    st.none() | st.floats(0.0, 100.0),
)
def test_any_truth_survives_json(kind: Kind, values: list[float], size: float | None) -> None:
    """What is written of a truth is all of it."""
    effects = tuple(TrueEffect(f"effect_{k}", {"size": value}) for k, value in enumerate(values))
    truth = Truth(kind, effects[: 2 if kind is Kind.PAIR else 1], what="w", location=("a", "b"), size=size, machine=3)
    assert truth_of("0001", json.loads(json.dumps(truth_as_dict(truth)))) == truth


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({}, "KeyError"),
        ({"kind": "broken"}, "broken"),
        ({"kind": "single"}, "must have 1"),
        ({"kind": "none", "effects": [{"name": "a"}]}, "must have 0"),
        ({"kind": "single", "effects": [{}]}, "name"),
        ({"kind": "single", "effects": [{"name": "a", "parameters": {"b": "c"}}]}, "ValueError"),
        ([], "TypeError"),
    ],
)
def test_a_key_that_makes_no_sense_is_one_line(entry: Any, said: str) -> None:
    """What is wrong with an entry is said with the name of its case."""
    with pytest.raises(InputError, match="case 0007") as caught:
        truth_of("0007", entry)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["make", "--seed", "-1", "--cases", "3", "-o", "{folder}/new"], "--seed -1"),
        (["make", "--seed", "1", "--cases", "0", "-o", "{folder}/new"], "--cases 0"),
        (["make", "--seed", "1", "--cases", "3", "-o", "{folder}/new", "--rig", "catapult"], "catapult"),
        (["make", "--seed", "1", "--cases", "3", "-o", "{folder}/new", "--live", "-1"], "--live -1"),
        (["make", "--seed", "1", "--cases", "3", "-o", "{folder}/new", "--key", "{folder}/new/k.json"], "inside"),
        (["make", "--seed", "1", "--cases", "3", "-o", "{folder}/new", "--key", "{key}"], "nothing is overwritten"),
        (["make", "--seed", "1", "--cases", "3", "-o", "{trial}"], "holds a trial already"),
        (["make", "--seed", "1", "--cases", "3", "-o", "{key}"], "cannot be made"),
        (["run", "{folder}/nowhere"], "nowhere"),
        (["run", "{trial}", "--jobs", "0"], "--jobs 0"),
        (["run", "{trial}", "--key", "{trial}/key.json"], "inside"),
        (["score", "{trial}", "--key", "{folder}/no.json", "-o", "{folder}/page"], "cannot be read"),
        (["score", "{trial}", "--key", "{trial}/trial.json", "-o", "{folder}/page"], "inside"),
        (["score", "{trial}", "--key", "{folder}/other.json", "-o", "{folder}/page"], "another key"),
        (["score", "{trial}", "--key", "{key}", "-o", "{folder}/page"], "still to be made"),
        (["score", "{trial}", "--key", "{key}", "-o", "{key}"], "cannot be made"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    """What cannot be done ends with exit code 2 and one line that names it."""
    trial, key = trial_with_key(tmp_path)
    (tmp_path / "other.json").write_text("{}", encoding="utf-8")
    filled = [word.format(folder=tmp_path, trial=trial, key=key) for word in words]
    assert blind(filled) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("trial.json", "{}", "key_sha256"),
        ("trial.json", "[]", "no table"),
        ("trial.json", "{", "not JSON"),
        ("trial.json", '{"format": 2}', "format 2"),
        ("cases/0001/case.json", "{}", "bags"),
        ("cases/0001/case.json", '{"bags": ["nowhere"]}', "nowhere"),
        ("cases/0001/case.json", '{"bags": ["bags/run_1"], "options": 3}', "options"),
    ],
)
def test_a_broken_file_of_a_trial_is_one_line(
    tmp_path: Path, name: str, content: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A stranger's mistake in a file is told with its name, and nothing is diagnosed."""
    trial, _ = trial_with_key(tmp_path)
    (trial / name).write_text(content, encoding="utf-8")
    assert blind(["run", str(trial)]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert name in error
    assert error.count("\n") == 1
