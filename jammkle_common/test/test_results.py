"""Where results go."""

from __future__ import annotations

import io
import json
import os
import sys
from pathlib import Path

import pytest

from jammkle_common.command import main as command
from jammkle_common.command import options, results
from jammkle_common.command.errors import GraphError, InputError


def test_a_pipe_cuts_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    """Where no terminal says how wide it is, a long line stays in one piece."""
    results.console().print("word " * 60)
    assert len(capsys.readouterr().out.splitlines()) == 1


@pytest.mark.parametrize("fails", [False, True])
def test_json_on_stdout_stands_alone(*, fails: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`--json -` writes no file `-`: stdout can be parsed, what is for people goes to stderr, and all is as before."""
    monkeypatch.chdir(tmp_path)
    out, err = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)

    def verb(arguments: list[str] | None, *, standalone_mode: bool) -> int:
        del arguments, standalone_mode
        path = options._keep_stdout(Path("-"))
        results.check_writable(path)
        results.console().print("for people")
        results.write_json(path, {"answer": 42})
        if fails:
            msg = "it broke"
            raise command.GraphError(msg)
        return 0

    monkeypatch.setattr(command, "app", verb)
    assert command.main([]) == int(fails)
    assert json.loads(out.getvalue()) == {"answer": 42}
    assert "for people" in err.getvalue()
    assert sys.stdout is out
    assert not list(tmp_path.iterdir())


def test_notes_of_another_process_are_kept_for_it(capsys: pytest.CaptureFixture[str]) -> None:
    """Inside the block nothing is said; after it a note is said once."""
    with results.notes_kept() as kept:
        results.note("a bag lacks a topic")
        results.note("a bag lacks a topic")
    assert (kept, capsys.readouterr().err) == (["a bag lacks a topic"] * 2, "")
    for line in kept:
        results.note(line)
    assert capsys.readouterr().err == "jammkle: note: a bag lacks a topic\n"


def test_a_file_that_may_not_be_written_is_refused_before_the_work(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A new file in a folder without permission, and an old one without; the same folder is no matter to the latter."""
    old = tmp_path / "old.json"
    old.touch()
    results.check_writable(tmp_path / "new.json")
    monkeypatch.setattr(os, "access", lambda path, _mode: Path(path) != tmp_path)  # a superuser may write anywhere
    results.check_writable(old)
    with pytest.raises(InputError, match=r"--json .*new.json cannot be written: there is no permission"):
        results.check_writable(tmp_path / "new.json")
    monkeypatch.setattr(os, "access", lambda path, _mode: Path(path) != old)
    with pytest.raises(InputError, match=r"--json .*old.json cannot be written: there is no permission"):
        results.check_writable(old)


def test_a_full_disk_behind_json_is_a_failure() -> None:
    """What was asked for was right, and could not be done: exit code 1, as for a full disk behind stdout."""
    with pytest.raises(GraphError, match="--json /dev/full cannot be written: No space left on device"):
        results.write_json(Path("/dev/full"), {"answer": 42})


def test_a_folder_that_got_no_results_is_taken_away_again(tmp_path: Path) -> None:
    """What was there before stays, and so does what holds a result."""

    def fails(folder: Path, result: str | None) -> None:
        with results.folder_made(folder):
            if result:
                (folder / result).touch()
            raise InputError

    (tmp_path / "old").mkdir()
    for place, result in (("old", None), ("new/folder", None), ("kept", "result")):
        with pytest.raises(InputError):
            fails(tmp_path / place, result)
    assert sorted(each.name for each in tmp_path.rglob("*")) == ["kept", "old", "result"]
    with pytest.raises(InputError, match=r"cannot be made: File name too long"):
        fails(tmp_path / "new" / ("long" * 100), None)
