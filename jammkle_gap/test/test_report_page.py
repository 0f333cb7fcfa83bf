"""The page, the words and the numbers of a diagnosis, whatever was found."""

from __future__ import annotations

import dataclasses
import math
import re
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from jammkle_gap import diagnose as gap_command
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.november.closing import Closing, RegimeClosing, SignalClosing
from jammkle_gap.november.described import Candidate, FittedEffect, FittedParameter, Overlay
from jammkle_gap.november.diagnosis import Diagnosis
from jammkle_gap.november.experiments import NextExperiment
from jammkle_gap.november.noise import NoiseSource
from jammkle_gap.november.runs import Spent
from jammkle_gap.november.signatures import Signature
from jammkle_gap.november.unexplained import Formula
from jammkle_gap.november.verdict import Verdict
from jammkle_gap.november.where import HorizonGap, Place, SubsystemGap, Where
from jammkle_gap.report import words
from jammkle_gap.report.figures import MOST_SIGNALS
from jammkle_gap.report.page import Setting, page
from jammkle_gap.report.quantities import percent, percents, quantity, span
from jammkle_gap.report.tables import heat_map

SETTING = Setting(["one", "two"], [], ["pressure"], "", 45, "out/corrected.yaml")
LIMIT_BYTES = 5e6
PREFIX = {"k": 1e3, "m": 1e-3, "µ": 1e-6, "n": 1e-9}


def effect(name: str, sentence: str, value: float = 0.002) -> FittedEffect:
    """Make up an effect."""
    parameter = FittedParameter("size", "m", value, (0.5 * value, 2.0 * value), at_bound=False)
    return FittedEffect(name, "pneumatics", sentence, (parameter,))


LEAK = effect("line_leak_achilles", "The achilles line leaks: check the push-fit.")
WEAR = effect("pump_wear", "The pump is worn: check its membrane.")


def candidate(each: FittedEffect, behind: float) -> Candidate:
    """Make up a candidate of one effect."""
    return Candidate((each.name,), 300.0 - behind, behind, 1.0, (each,))


def made_up(verdict: Verdict, signals: int = 2, samples: int = 400, recordings: int = 1) -> Diagnosis:
    """Make up a diagnosis: the first signal is off most."""
    names = [f"channel_{i}/pressure" for i in range(signals)]
    off = verdict is not Verdict.NO_GAP
    gaps = [20.0 / (i + 1) if off else 0.9 for i in range(signals)]
    left = 9.0 if verdict is Verdict.UNKNOWN else 1.0
    time_s = np.linspace(0.0, 10.0, samples)
    wave = 1e5 + 5e4 * np.sin(time_s)
    scatter = 100.0 * np.random.default_rng(1).standard_normal(samples)
    effects = {Verdict.EFFECTS: (LEAK,), Verdict.AMBIGUOUS: (LEAK,), Verdict.UNKNOWN: (WEAR,)}.get(verdict, ())
    candidates = (candidate(LEAK, 0.0), candidate(WEAR, 1.5)) if verdict is Verdict.AMBIGUOUS else ()
    following = NextExperiment("rig pressure --cycles 9", names[0], 7.0, 700.0, "Pa", "they differ by 700 Pa")
    formula = Formula(names[0], "Pa", (("t", 3.0),), 0.4)
    return Diagnosis(
        verdict=verdict,
        reasons=("because",),
        effects=effects,
        candidates=candidates,
        probabilities={"line_leak_achilles": 0.6, "pump_wear": 0.399, "unknown": 0.001},
        where=Where(
            (
                Place(names[0], "holding", "pneumatics", 0.8, (0.7, 0.9), 20.0),
                Place(names[-1], "still", "", 0.2, (0.1, 0.3), 5.0),
            ),
            (
                SubsystemGap("pneumatics", {names[0]: 20.0}, 20.0, to_blame=True),
                SubsystemGap("tendon", {names[-1]: 1.0}, 1.0, to_blame=False),
            ),
            (HorizonGap(0.0, {names[0]: 1.0}), HorizonGap(math.inf, {names[0]: 20.0})),
        ),
        signatures=(Signature(names[0], "ramp", 1.0, "Pa/s", 0.5, "it ramps by +1 Pa per s"),),
        noise=tuple(NoiseSource(name, "Pa", 100.0, "still stretches") for name in names),
        gap=Closing(20.0, left, 0.95, (0.9, 0.97)),
        signals=tuple(
            SignalClosing(name, "Pa", 100.0, 1.5, Closing(gap, left, 0.95, (0.9, 1.2)), 100.0 * gap, 100.0 * left)
            for name, gap in zip(names, gaps, strict=True)
        ),
        regimes=(RegimeClosing("50 kPa", 20.0, 2.0, 0.94),),
        ceiling=1.2,
        formula=formula if verdict is Verdict.UNKNOWN else None,
        next_experiment=following if verdict is Verdict.AMBIGUOUS else None,
        dropped={"payload": "moves no signal"},
        ranking=((("line_leak_achilles",), 300.0), ((), 0.0)),
        overlays=tuple(
            Overlay(f"run {i}", name, "Pa", time_s, wave + scatter, wave * 0.9, wave)
            for name in names
            for i in range(recordings)
        ),
        notes=("not recorded: imu/data",),
        spent=Spent(100, 500.0, 12.0),
        finished=True,
    )


class Reader(HTMLParser):
    """Collects ids, what is loaded from where, open tags, and the text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.loaded: list[str] = []
        self.words = ""
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.ids |= {values["id"]} if values.get("id") else set()
        self.loaded += [str(values[key]) for key in ("src", "href") if values.get(key)]
        if tag not in {"meta", "img", "br", "link"}:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data if not (self._open and self._open[-1] == "style") else ""


@pytest.mark.parametrize("verdict", list(Verdict))
def test_every_verdict_has_a_page_that_needs_no_network(verdict: Verdict) -> None:
    """Whatever the verdict, the page is well-formed, loads nothing, and says verdict and reason in words."""
    diagnosis = made_up(verdict)
    text = page(diagnosis, SETTING)
    read = Reader(text)
    assert all(source.startswith("data:image/svg+xml;base64,") for source in read.loaded)
    assert not re.search(r"https?://(?!www\.w3\.org)", text)
    assert {"verdict", "gap", "where", "set", "next", "curves", "signatures", "left-out", "noise", "how"} <= read.ids
    assert verdict.value.replace("_", " ") in read.words
    for sentence in (words.headline(diagnosis), *words.checks(diagnosis), *words.explanation(diagnosis)):
        assert sentence in read.words
    assert ("effects" in read.ids) == bool(diagnosis.effects)
    assert ("formula" in read.ids) == (verdict is Verdict.UNKNOWN)
    assert "unfinished" not in read.ids


def test_a_name_is_only_given_where_something_is_named() -> None:
    """NO_GAP and UNKNOWN assert no effect; EFFECTS asserts one; AMBIGUOUS all of the set, and how to part them."""
    said = {verdict: words.headline(made_up(verdict)) for verdict in Verdict}
    assert [("line leaks" in said[each], "pump is worn" in said[each]) for each in said] == [
        (False, False),
        (True, False),
        (True, True),
        (False, False),
    ]
    assert "700 Pa" in " ".join(words.explanation(made_up(Verdict.AMBIGUOUS)))
    assert "not enough" in " ".join(words.checks(made_up(Verdict.UNKNOWN)))
    assert not words.checks(made_up(Verdict.NO_GAP))


def test_what_a_whole_set_holds_is_said_once() -> None:
    """A set of pairs with one effect in common names that one first, and the others by their names."""
    friction = effect("joint_friction", "The joint rubs: grease it.")
    pairs = tuple(
        dataclasses.replace(
            candidate(LEAK, 0.0), names=(LEAK.name, *(each.name for each in more)), effects=(LEAK, *more)
        )
        for more in ((WEAR,), (friction,), ())
    )
    following = NextExperiment("rig drop", "a", 7.0, 1.0, "Pa", "line_leak_achilles + pump_wear differ by 1 Pa")
    found = dataclasses.replace(made_up(Verdict.AMBIGUOUS), candidates=pairs, next_experiment=following)
    said = words.headline(found)
    assert said.startswith("The achilles line leaks; with it comes one of 3")
    assert said.endswith("pump wear; joint friction; nothing else.")
    assert "joint friction: The joint rubs: grease it." in words.checks(found)
    assert "line leak achilles + pump wear differ" in words.explanation(found)[-1]


def test_a_lead_that_would_be_enough_is_not_called_too_little() -> None:
    """Where a lead closes the gap but is not proven, the words say that, and not that nothing explains it."""
    given = made_up(Verdict.UNKNOWN)
    closed = tuple(
        dataclasses.replace(each, closing=dataclasses.replace(each.closing, with_effect=1.0)) for each in given.signals
    )
    proposed = dataclasses.replace(given, signals=closed)
    assert "pump wear would close it, but not clearly better" in words.headline(proposed)
    assert "not proven" in " ".join(words.checks(proposed))


def test_what_was_stopped_says_so_first() -> None:
    """A diagnosis that was ended early warns above its verdict."""
    text = page(dataclasses.replace(made_up(Verdict.EFFECTS), finished=False), SETTING)
    assert 0 < text.index('id="unfinished"') < text.index('id="verdict"')
    unknown = words.headline(dataclasses.replace(made_up(Verdict.UNKNOWN), finished=False))
    assert "no effect of the library" not in unknown


@pytest.mark.parametrize("verdict", list(Verdict))
def test_only_what_is_known_is_loaded(verdict: Verdict) -> None:
    """The corrected simulator holds the effect where one explains the gap; a mere lead is not put into it."""
    parameter = FittedParameter("conductance_dm3_s_bar", "dm3/(s bar)", 0.002, (0.001, 0.003), at_bound=False)
    effects = (dataclasses.replace(LEAK, parameters=(parameter,)),) if verdict is not Verdict.NO_GAP else ()
    text = gap_command._corrected(dataclasses.replace(made_up(verdict), effects=effects), ankle_library(), None)
    expected = {"line_leak_achilles": {"conductance_dm3_s_bar": 0.002}}
    assert yaml.safe_load(text) == (expected if verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS} else None)


def test_pages_stay_small_however_much_was_recorded() -> None:
    """Twenty recordings of forty signals at length stay below 5 MB, and the page says what was not drawn."""
    text = page(made_up(Verdict.EFFECTS, signals=40, samples=20_000, recordings=20), SETTING)
    assert len(text.encode()) < LIMIT_BYTES
    assert text.count("<img") == MOST_SIGNALS
    assert f"The {MOST_SIGNALS} signals that are off most are drawn" in text


def test_names_cannot_break_the_page() -> None:
    """Names out of a bag are text on the page, never markup."""
    setting = dataclasses.replace(SETTING, bags=["<script>alert(1)</script>"])
    text = page(made_up(Verdict.EFFECTS), setting)
    assert "<script" not in text
    Reader(text)


def test_the_heat_map_keeps_every_share() -> None:
    """Each share stands in the row of its signal and the column of its phase."""
    table = heat_map(made_up(Verdict.EFFECTS).where.places)
    assert table["phases"] == ["holding", "still"]
    shown: list[list[Any]] = [[cell and cell["share"] for cell in row["cells"]] for row in table["rows"]]
    assert shown == [["80 %", None], [None, "20 %"]]


@given(st.floats(1e-8, 1e4), st.sampled_from([1.0, -1.0]), st.sampled_from(["Pa", "m", "s", "N", "dm3/(s bar)", "1"]))
def test_quantities_are_what_they_were(size: float, sign: float, unit: str) -> None:
    """A printed quantity, read back with its prefix, is the number to within a per cent."""
    text = quantity(sign * size, unit)
    number, _, name = text.partition(" ")
    factor = PREFIX[name[0]] if unit not in {"1", name} else 1.0
    assert float(number) * factor == pytest.approx(sign * size, rel=1e-2)
    assert name.endswith(unit) or unit == "1"


def test_what_is_not_known_is_a_dash() -> None:
    """Numbers that are none are shown as none, and more than all is all."""
    nothing = (math.nan, math.nan)
    assert [quantity(math.nan, "Pa"), span(1.0, nothing, "Pa"), percent(math.nan), percents(nothing)] == ["-"] * 4
    assert percent(1.3) == "100 %"
    assert percents((0.91, 0.97)) == "91 to 97 %"
    assert span(0.0301, (0.0285, 0.0315), "s") == "28.5 to 31.5 ms"
