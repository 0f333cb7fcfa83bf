"""What a lab hands over, and what is true of it: kept apart, and refused in one line where it makes no sense."""

from __future__ import annotations

import functools
import json
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_common.command.errors import InputError
from jammkle_common.command.main import run
from studies.blind.__main__ import app
from studies.blind.cases import CaseNote, Kind, Rung, TrueEffect, Truth, read_key, write_case, write_key

if TYPE_CHECKING:
    from pathlib import Path

blind = functools.partial(run, app)

LEAK = Truth(
    Kind.SINGLE,
    (TrueEffect("line_leak_achilles", {"conductance_dm3_s_bar": 0.002}),),
    size=4.0,
    location=("pneumatics",),
)


def trial_with_key(folder: Path, *truths: Truth) -> tuple[Path, Path]:
    """Return a trial of cases that have no bag worth the name, and its key."""
    trial, key = folder / "trial", folder / "key.json"
    cases = {f"{k + 1:04d}": truth for k, truth in enumerate(truths or (LEAK,))}
    for name in cases:
        (trial / "cases" / name / "bags" / "run_1").mkdir(parents=True)
        write_case(trial / "cases" / name, CaseNote(("bags/run_1",)))
    write_key(key, cases)
    return trial, key


@given(
    st.sampled_from([Kind.SINGLE, Kind.PAIR, Kind.MIDRUN]),
    st.lists(st.floats(-1e6, 1e6, allow_nan=False), min_size=2, max_size=2),
    st.none() | st.floats(0.0, 100.0),
)
def test_any_truth_survives_the_file(
    tmp_path_factory: pytest.TempPathFactory, kind: Kind, values: list[float], size: float | None
) -> None:
    """What is written of a truth is all of it."""
    effects = tuple(TrueEffect(f"effect_{k}", {"size": value}) for k, value in enumerate(values))
    truth = Truth(kind, effects[: 2 if kind is Kind.PAIR else 1], what="w", location=("a", "b"), size=size, machine=3)
    trial, key = trial_with_key(tmp_path_factory.mktemp("key"), truth, Truth(Kind.NONE, rung=Rung.KNOWN))
    assert list(read_key(key, trial).values()) == [truth, Truth(Kind.NONE, rung=Rung.KNOWN)]


@pytest.mark.parametrize("place", ["trial/key.json", "trial/cases/key.json", "trial/../trial/key.json"])
def test_a_key_inside_the_trial_is_refused(tmp_path: Path, place: str) -> None:
    """The diagnosis must not be able to find it: not in the folder, not below it, not by a detour."""
    trial, key = trial_with_key(tmp_path)
    key.rename(tmp_path / place)
    with pytest.raises(InputError, match="inside the trial"):
        read_key(tmp_path / place, trial)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({}, "KeyError"),
        ({"kind": "broken"}, "broken"),
        ({"kind": "single"}, "must have 1"),
        ({"kind": "none", "effects": [{"name": "a"}]}, "must have 0"),
        ({"kind": "single", "effects": [{}]}, "name"),
        ({"kind": "single", "effects": [{"name": "a", "parameters": {"b": "c"}}]}, "ValueError"),
        ([], "KeyError"),
    ],
)
def test_a_key_that_makes_no_sense_is_one_line(tmp_path: Path, entry: Any, said: str) -> None:
    """What is wrong with an entry is said with the name of its case."""
    trial, key = trial_with_key(tmp_path)
    key.write_text(json.dumps({"cases": {"0001": entry}}), encoding="utf-8")
    with pytest.raises(InputError, match="case 0001") as caught:
        read_key(key, trial)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--seed", "-1"], "--seed -1"),
        (["--seed", "1", "--cases", "0"], "--cases 0"),
        (["--seed", "1", "--cases", "3", "--rig", "sofa"], "known are"),
        (["--trial", "{trial}"], "belong together"),
        (["--trial", "{folder}/nowhere", "--key", "{key}"], "has no cases"),
        (["-o", "{key}"], "cannot be made"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    """What cannot be done ends with exit code 2 and one line that names it."""
    trial, key = trial_with_key(tmp_path)
    filled = [word.format(folder=tmp_path, trial=trial, key=key) for word in words]
    assert blind([*([] if "-o" in words else ["-o", str(tmp_path / "page")]), *filled]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{}", "bags"),
        ("{", "JSON"),
        ("[]", "no table"),
        ('{"bags": ["nowhere"]}', "nowhere"),
        ('{"bags": ["bags/run_1"], "references": ["bags/run_1"]}', "named before"),
        ('{"bags": ["bags/run_1"], "options": 3}', "options"),
    ],
)
def test_a_broken_case_is_one_line(tmp_path: Path, content: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A stranger's mistake in a file is reported with its name, and nothing is diagnosed."""
    trial, key = trial_with_key(tmp_path)
    (trial / "cases/0001/case.json").write_text(content, encoding="utf-8")
    assert blind(["--trial", str(trial), "--key", str(key), "-o", str(tmp_path / "page")]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "case.json" in error
    assert error.count("\n") == 1
