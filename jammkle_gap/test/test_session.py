"""`jammkle gap session`: what is recorded when, with a robot and diagnoses that are made up."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import pytest
import typer

from jammkle_bringup.core.node_table import option_value
from jammkle_common.bags.run_sheet import FILE_NAME
from jammkle_common.command.errors import GraphError, InputError
from jammkle_common.parameters import from_mapping
from jammkle_gap import session as room
from jammkle_gap.ankle.problem import plans
from jammkle_gap.core.result import NextExperiment
from jammkle_gap.session import SessionRequest
from jammkle_sim.rigs.catalogue import EXERCISES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from jammkle_common.bags.run_sheet import RunSheet
    from jammkle_gap.diagnosing import DiagnoseRequest

FIRST, SECOND = list(plans(EXERCISES))[:2]


@dataclass(frozen=True)
class MadeUp:
    """What a session looks at of a diagnosis."""

    next_experiment: NextExperiment | None = None
    candidates: tuple[object, ...] = ()
    finished: bool = True


def asks_for(command: str) -> MadeUp:
    """Diagnosis that would have this recorded."""
    return MadeUp(NextExperiment(command, 20.0, "angle", 5.0, 0.1, "rad", "one and two differ by 0.1 rad"))


@dataclass
class Bench:
    """A robot that can be recorded, and what a diagnosis says each time."""

    says: list[MadeUp]
    simulated: bool = True
    there: bool = True
    recorded: list[tuple[str, Mapping[str, object]]] = field(default_factory=list)
    diagnosed: list[list[str]] = field(default_factory=list)

    def record(self, runs: Mapping[Path, RunSheet], _namespace: str, _stop: Callable[[], bool]) -> None:
        """Leave what looks like bags."""
        for bag, sheet in runs.items():
            assert not bag.exists()
            bag.mkdir()
            (bag / "metadata.yaml").touch()
            (bag / FILE_NAME).touch()
            self.recorded.append((bag.name, sheet.options))

    def is_simulated(self, _namespace: str, _stop: Callable[[], bool]) -> bool:
        """Say what kind of robot it is."""
        if not self.there:
            msg = "no driver answers"
            raise GraphError(msg)
        return self.simulated

    def read(self, bags: list[Path], *_: object) -> None:
        """Refuse a bag that is not of this machine."""
        for bag in bags:
            if bag.name == "foreign":
                msg = "bag foreign holds no topic of an ankle"
                raise InputError(msg)

    def diagnose(self, request: DiagnoseRequest) -> MadeUp:
        """Say the next thing."""
        self.diagnosed.append([bag.name for bag in request.bags])
        return self.says.pop(0)


@pytest.fixture(name="put")
def put_bench(monkeypatch: pytest.MonkeyPatch) -> Callable[[Bench], Bench]:
    """Put a bench where the robot and the diagnosis are."""

    def put(bench: Bench) -> Bench:
        offered = {"record": bench.record, "is_simulated": bench.is_simulated}
        monkeypatch.setattr(room, "provided", lambda _group, name, _package: offered[name])
        monkeypatch.setattr(room, "diagnose", bench.diagnose)
        monkeypatch.setattr(room, "recordings_of", bench.read)
        return bench

    return put


def asked(folder: Path, further: int = 3) -> SessionRequest:
    """Return a session's request."""
    return SessionRequest(folder, "/", further, None, 1)


def test_it_records_all_exercises_and_then_what_separates(put: Callable[[Bench], Bench], tmp_path: Path) -> None:
    """Until nothing is left to separate; each further run has a bag of its own and the options that were asked for."""
    bench = put(Bench([asks_for(FIRST), asks_for(SECOND), MadeUp()]))
    room.session(asked(tmp_path))
    kinds = [plans(EXERCISES)[each] for each in (FIRST, SECOND)]
    assert [name for name, _ in bench.recorded[:4]] == list(EXERCISES)
    assert [options for _, options in bench.recorded[4:]] == [each.options for each in kinds]
    assert len({name for name, _ in bench.recorded}) == 6
    assert [len(bags) for bags in bench.diagnosed] == [4, 5, 6]


def test_it_goes_on_from_what_is_there(put: Callable[[Bench], Bench], tmp_path: Path) -> None:
    """A folder with bags is not recorded again, and a bag of something else in it counts too."""
    for name in (*EXERCISES, "a_landing"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.yaml").touch()
        if name in EXERCISES:
            (tmp_path / name / FILE_NAME).touch()
    (tmp_path / "notes").mkdir()
    bench = put(Bench([MadeUp()]))
    room.session(asked(tmp_path))
    assert not bench.recorded
    assert bench.diagnosed == [sorted((*EXERCISES, "a_landing"))]


def test_an_exercise_that_was_stopped_is_recorded_anew(
    put: Callable[[Bench], Bench], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whether its recorder could complete the bag or not; what there is of it is kept, twice if need be."""
    first, second, *others = EXERCISES
    for name in (first, *others):
        (tmp_path / name).mkdir()
    for name in others:
        (tmp_path / name / "metadata.yaml").touch()
        (tmp_path / name / FILE_NAME).touch()
    bench = put(Bench([MadeUp(), MadeUp()]))
    room.session(asked(tmp_path))
    assert [name for name, _ in bench.recorded] == [first, second]
    assert bench.diagnosed == [sorted(EXERCISES)]
    assert (tmp_path / "unfinished" / first).is_dir()
    assert f"{first} has no run sheet" in capsys.readouterr().err
    (tmp_path / first / FILE_NAME).unlink()
    room.session(asked(tmp_path))
    assert (tmp_path / "unfinished" / f"{first}_2").is_dir()
    assert bench.diagnosed[-1] == sorted(EXERCISES)


@pytest.mark.parametrize(
    ("there", "jobs", "said"),
    [
        ("", 0, "--jobs 0 must be 1 or more"),
        ("cycle", 1, "cycle is no bag, and has the name that the bag of an exercise will have: move it away"),
        ("press/notes.txt", 1, "press is no bag, and has the name"),
        ("foreign/foreign.mcap", 1, "bag foreign holds no topic of an ankle"),
    ],
)
def test_what_cannot_work_is_refused_before_the_robot_moves(
    put: Callable[[Bench], Bench], tmp_path: Path, there: str, jobs: int, said: str
) -> None:
    """Nothing is recorded, and what stands in the folder stays where it is."""
    if there:
        (tmp_path / there).parent.mkdir(exist_ok=True)
        (tmp_path / there).touch()
    bench = put(Bench([]))
    with pytest.raises(InputError, match=said):
        room.session(replace(asked(tmp_path), jobs=jobs))
    assert not bench.recorded
    assert not there or (tmp_path / there).is_file()


def test_it_ends_after_as_many_further_runs_as_are_allowed(put: Callable[[Bench], Bench], tmp_path: Path) -> None:
    """And says what would be next."""
    bench = put(Bench([asks_for(FIRST)] * 3))
    found = room.session(asked(tmp_path, 2))
    assert len(bench.recorded) == 6
    assert found.next_experiment is not None
    with pytest.raises(InputError, match="--further -1 must be 0 or more"):
        room.session(asked(tmp_path, -1))


def test_a_real_robot_moves_again_only_when_a_person_says_so(
    put: Callable[[Bench], Bench], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A no ends the session with what is known; a simulated robot is not asked for."""
    bench = put(Bench([asks_for(FIRST), asks_for(SECOND), MadeUp()], simulated=False))
    answers = [True, False]
    monkeypatch.setattr(typer, "confirm", lambda *_, **__: answers.pop(0))
    room.session(asked(tmp_path))
    assert not answers
    assert len(bench.recorded) == 5


def test_without_a_graph_it_says_what_to_record(
    put: Callable[[Bench], Bench], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A robot that is elsewhere: the command is there, and the session can be called again."""
    put(Bench([asks_for(FIRST)], there=False))
    room.session(asked(tmp_path))
    said = capsys.readouterr().err
    assert f"next: jammkle {FIRST}" in said
    assert "no driver answers" in said
    assert "call the session again" in said


def test_a_command_that_is_proposed_is_one_that_can_be_typed() -> None:
    """Every exercise on offer, read back as the command reads it, is what was planned."""
    for command, sheet in plans(EXERCISES).items():
        verb, name, *words = command.split()
        assert verb == "exercise"
        assert words[::2] == ["-p"] * len(sheet.options)
        read = dict(option_value(word, word) for word in words[1::2])
        assert from_mapping(EXERCISES[name].options, read) == from_mapping(EXERCISES[name].options, sheet.options)
