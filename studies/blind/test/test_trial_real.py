"""Recordings of real machines beside a trial, where they are present."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from jammkle_common.command.errors import InputError
from studies.blind.diagnose_real import diagnose_real
from studies.blind.real import as_rows

HOUSE = Path(__file__).resolve().parents[3]
DATA = Path(os.environ.get("JAMMKLE_REAL_DATA", HOUSE.parent / "shared" / "data"))


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no real recordings in {DATA}")
@pytest.mark.slow
@pytest.mark.timeout(600)  # sixteen runs of a servo among them
def test_no_real_machine_gets_a_confident_wrong_name() -> None:
    """What is said is what is known beforehand, but for one that docs/gap.md explains, Prusa."""
    cases = {each.name: each for each in diagnose_real(DATA)}
    others = {name for name, each in cases.items() if not each.as_known}
    assert others <= {"leak_down Prusa"}, as_rows(list(cases.values()))
    assert "leak" not in cases["leak_down Prusa"].said
    assert cases["pressure_friction"].verdict == "EFFECTS"
    assert "pressure_friction" in cases["pressure_friction"].said
    assert cases["leak_down Ultimaker_015"].verdict == "EFFECTS"
    assert cases["servo_friction"].verdict == "AMBIGUOUS"


def test_a_folder_without_the_recordings_is_refused(tmp_path: Path) -> None:
    """The message names the folder and the way out."""
    with pytest.raises(InputError, match="--real"):
        diagnose_real(tmp_path)
