"""`make contact` as a user calls it: a trial of a few dozen steps, and input that is wrong."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


def contact(*arguments: object) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "studies.contact", *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, check=False, cwd=ROOT)


@pytest.mark.slow
def test_a_small_trial_of_the_detectors(tmp_path: Path) -> None:
    """Every detector has its figures beside the simple ways, on the tuning part and on what is held out."""
    answer = contact("--steps", 40, "--runs", 0, "-o", tmp_path)
    assert answer.returncode == 0, answer.stderr
    found = json.loads((tmp_path / "contact.json").read_text())
    rows = {(row["part"], row["kind"], row["way"]) for row in found["rows"]}
    for part in ("tuning", "held out"):
        assert {(part, kind, "ours") for kind in ("impact", "lift-off", "slip")} <= rows
        assert len({way for reported, _, way in rows if reported == part}) >= 4
    assert found["blown_up"] == 0
    assert found["aims"]["lift-off"] in (tmp_path / "contact.html").read_text()


def test_too_few_steps_are_refused_in_a_line(tmp_path: Path) -> None:
    """The line names the value and the least that is allowed."""
    answer = contact("--steps", 16, "-o", tmp_path)
    assert answer.returncode == 2
    assert answer.stderr == "jammkle: --steps is 16; it must be 40 or more\n"
