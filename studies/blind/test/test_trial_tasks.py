"""What is asked once the key is open."""

from __future__ import annotations

from typing import TYPE_CHECKING

from studies.blind import files
from studies.blind.files import CaseNote
from studies.blind.key import Key, Kind, Rung, TrueEffect, Truth
from studies.blind.questions import Run
from studies.blind.tasks import BLIND, EVERY, FEW, blind_tasks, open_tasks, sample

if TYPE_CHECKING:
    from pathlib import Path


def test_every_effect_is_left_out_once_in_its_largest_case(tmp_path: Path) -> None:
    """Among the cases that figures are of, however small; pairs and the other rungs are no such case."""

    def single(name: str, size: float, rung: Rung = Rung.WITHHELD) -> Truth:
        return Truth(Kind.SINGLE, (TrueEffect(name),), rung, size=size)

    pair = Truth(Kind.PAIR, (TrueEffect("leak"), TrueEffect("wear")), size=9.0)
    cases = {
        "1": single("leak", 2.0),
        "2": single("leak", 4.0),
        "3": single("leak", 8.0, Rung.KNOWN),
        "4": single("wear", 0.5),
        "5": pair,
        "6": Truth(Kind.NONE),
    }
    for name in cases:
        (tmp_path / files.CASES / name / "bag").mkdir(parents=True)
        files.write_case(tmp_path / files.CASES / name, CaseNote(("bag",)))
    files.write_trial(tmp_path, files.TrialFacts("0" * 64, regimes="development"))
    asked = {task.case: {way.run: way for way in task.asked.ways} for task in open_tasks(tmp_path, Key(cases, ""))}
    assert {case for case, ways in asked.items() if Run.ORACLE in ways} == {"1", "2", "3", "4", "5"}
    left_out = {case: ways[Run.LEFT_OUT].without for case, ways in asked.items() if Run.LEFT_OUT in ways}
    assert left_out == {"2": ("leak",), "4": ("wear",)}
    assert {case for case, ways in asked.items() if Run.CEILING in ways} == {"1", "2", "5"}


def test_a_sample_is_drawn_by_the_hash_of_the_key(tmp_path: Path) -> None:
    """A small trial is diagnosed in all ways; of a large one about a sixth, the same whenever it is asked."""
    for count, sha256 in ((FEW, "0" * 64), (300, "1" * 64)):
        trial = tmp_path / str(count)
        for k in range(count):
            (trial / files.CASES / f"{k:04d}" / "bag").mkdir(parents=True)
            files.write_case(trial / files.CASES / f"{k:04d}", CaseNote(("bag",)))
        files.write_trial(trial, files.TrialFacts(sha256))
    assert len(sample(tmp_path / str(FEW))) == FEW
    drawn = sample(tmp_path / "300")
    assert drawn == sample(tmp_path / "300")
    assert 30 <= len(drawn) <= 70
    ways = {task.case: {way.run for way in task.asked.ways} for task in blind_tasks(tmp_path / "300")}
    assert all(asked == set(BLIND if case in drawn else EVERY) for case, asked in ways.items())
