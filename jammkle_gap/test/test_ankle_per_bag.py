"""What a command line says of all bags, or of one."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_gap.ankle.per_bag import BadRequestError, requests_for
from jammkle_sim.rigs.catalogue import RIGS

BAGS = ("runs/day_1/pull", "runs/day_2/pull", "runs/day_2/drop")


def test_what_is_said_of_all_and_of_one() -> None:
    """What names a bag goes before what is for all; a name is the end of a path."""
    found = requests_for(
        BAGS,
        ["tensile", "drop=drop"],
        ["vacuum-kpa=50", "drop:foot=jammed", "day_2/pull:vacuum_kpa=3e1", "drop:friction=0.2"],
    )
    assert [each.rig for each in found] == ["tensile", "tensile", "drop"]
    assert [dict(each.options) for each in found] == [
        {"vacuum_pa": 50000},
        {"vacuum_pa": 30000.0},
        {"vacuum_pa": 50000, "foot": "jammed", "friction": 0.2},
    ]
    assert [set(each.own) for each in found] == [set(), {"vacuum_pa"}, {"foot", "friction"}]


def test_nothing_said_leaves_everything_to_the_bags() -> None:
    """No rig, no options."""
    assert [(each.rig, dict(each.options)) for each in requests_for(BAGS, [], [])] == [(None, {})] * 3


@pytest.mark.parametrize(
    ("rigs", "settings", "said"),
    [
        (["catapult"], [], "--rig 'catapult' names the rig 'catapult', which does not exist; known are: tensile"),
        (["drop=catapult"], [], "which does not exist; known are"),
        (
            ["pull=tensile"],
            [],
            "--rig 'pull=tensile' names 2 bags; name one of these by the end of its path: runs/day_1",
        ),
        (["nowhere=tensile"], [], "--rig 'nowhere=tensile' names no bag; name one of these"),
        (["tensile", "drop"], [], "--rig is given twice for all bags, as 'tensile' and 'drop'"),
        ([], ["vacuum-kpa"], "--set 'vacuum-kpa' must be NAME=VALUE or BAG:NAME=VALUE, such as"),
        ([], ["vacuum-kpa="], "must be NAME=VALUE"),
        ([], [":vacuum-kpa=3"], "must be NAME=VALUE"),
        ([], ["drop:=3"], "must be NAME=VALUE"),
        ([], ["drop:vacuum-kpa=["], "has a value that cannot be read; write a number or a word"),
        ([], ["pull:vacuum-kpa=3"], "--set 'pull:vacuum-kpa=3' names 2 bags"),
        ([], ["vacuum_pa=50000"], "--set 'vacuum_pa=50000': vacuum-pa is vacuum-kpa now, in kPa: 50 for 50000 Pa"),
        ([], ["=drop:a=3"], "must be NAME=VALUE"),
    ],
)
def test_what_cannot_be_meant_is_one_line(rigs: list[str], settings: list[str], said: str) -> None:
    """It names the request and says what would be right."""
    with pytest.raises(BadRequestError) as error:
        requests_for(BAGS, rigs, settings)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@given(
    st.text(min_size=1, max_size=30), st.sampled_from(sorted(RIGS)), st.sampled_from(["{0}={1}", "{0}", "{0}:foot=a"])
)
def test_any_text_is_read_or_refused(text: str, rig: str, form: str) -> None:
    """No text makes another error than the one that says so."""
    request = form.format(text, rig)
    for rigs, settings in (([request], []), ([], [request])):
        with contextlib.suppress(BadRequestError):
            assert len(requests_for(BAGS, rigs, settings)) == len(BAGS)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_is_read_as_itself(value: float) -> None:
    """However it is written."""
    (found,) = requests_for(["bag"], [], [f"foot={value!r}"])
    assert found.options["foot"] == value
    (word,) = requests_for(["bag"], [], ["membrane=yes"])
    assert word.options["membrane"] == "yes"
