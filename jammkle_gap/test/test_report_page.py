"""The page, the words and the numbers of a diagnosis, whatever was found."""

from __future__ import annotations

import base64
import dataclasses
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from jammkle_common.command.results import Origin
from jammkle_gap import ankle_problem
from jammkle_gap.core.effects import Nuisance
from jammkle_gap.core.result import (
    Candidate,
    Closing,
    Diagnosis,
    FittedConstant,
    FittedEffect,
    FittedParameter,
    HeldOutSetting,
    LedgerEntry,
    NextExperiment,
    Place,
    SignalGap,
    Spent,
    Trace,
    Verdict,
)
from jammkle_gap.diagnosing import corrected_file
from jammkle_gap.report import screen, words
from jammkle_gap.report.page import MOST_BARS, MOST_TRACES, _thinned, bars_of, heat_map, page
from jammkle_gap.report.words import Asked, percent, percents, probability, quantities, quantity, span

LIMIT_BYTES = 5e6
PREFIX = {"k": 1e3, "m": 1e-3, "µ": 1e-6, "n": 1e-9}
PLACES = {"holding": 0.28, "evacuating": 0.22, "venting": 0.2}
LEVER = Nuisance("lever.length_m", "m", 0.04, 0.002, "drawing, 5 %")
SECTIONS = {
    "verdict", "posterior", "traces", "detectable", "where", "closing", "identifiability", "calibration", "notes",
}  # fmt: skip
UNWANTED = re.compile(
    r"\b(astray|off by|is off|are off|at stake|good order|counts as none|told by|foretold|foretells?)\b"
)


def effect(name: str, sentence: str, parameter: str = "size", value: float = 0.002) -> FittedEffect:
    """Make up an effect."""
    fitted = FittedParameter(parameter, "m", value, (0.5 * value, 2.0 * value), at_bound=False, detectable=0.3 * value)
    return FittedEffect(name, "pneumatics", sentence, (fitted,))


LEAK = effect("line_leak_achilles", "The achilles line leaks: check the push-fit.", "conductance_dm3_s_bar")
WEAR = effect("pump_wear", "The pump is worn: check its membrane.")
FRICTION = effect("joint_friction", "The joint rubs: grease it.")
ASKED = Asked(
    ["one", "two"],
    ["healthy"],
    ["pressure"],
    "robot",
    "",
    {each.name: each.sentence for each in (LEAK, WEAR, FRICTION)},
    "out/corrected.yaml",
    Origin("1.2.3", "2026-01-02 03:04:05+00:00", "jammkle gap diagnose one two --since healthy -o out"),
    (LEVER,),
)


def candidate(effects: tuple[FittedEffect, ...], likely: float, equivalents: tuple[str, ...] = ()) -> Candidate:
    """Make up a candidate."""
    return Candidate(tuple(each.name for each in effects), likely, 0.9, effects, equivalents)


CANDIDATES = {
    Verdict.NO_GAP: (),
    Verdict.EFFECTS: (candidate((LEAK,), 0.97),),
    Verdict.AMBIGUOUS: (candidate((LEAK,), 0.6), candidate((WEAR,), 0.35)),
    Verdict.UNKNOWN: (candidate((), 0.8), candidate((WEAR,), 0.17)),
}


def made_up(verdict: Verdict, signals: int = 2, samples: int = 400, settings: int = 1) -> Diagnosis:
    """Make up a diagnosis: the first signal has the largest residual."""
    names = [f"channel_{i}/pressure" for i in range(signals)]
    gaps = [20.0 / (i + 1) if verdict is not Verdict.NO_GAP else 0.9 for i in range(signals)]
    time_s = np.linspace(0.0, 10.0, samples)
    scatter = 100.0 * np.random.default_rng(1).standard_normal(samples)
    following = NextExperiment(
        "rig pressure --cycles 9", 21.0, names[0], 7.0, 700.0, "Pa", "pump_wear differs by 700 Pa"
    )
    candidates = CANDIDATES[verdict]
    named = {each.names: each.probability for each in candidates}
    rest = 1.0 - sum(named.values())
    missing = [names for names in ((), ("joint_friction",)) if names not in named]
    posterior = {**named, **{names: rest / len(missing) for names in missing}}
    return Diagnosis(
        verdict=verdict,
        reasons=("because",),
        candidates=candidates,
        posterior=dict(sorted(posterior.items(), key=lambda item: -item[1])),
        gap_probability=0.999,
        p_value=0.001 if verdict is not Verdict.NO_GAP else 0.4,
        false_alarm_rate=0.01,
        where=(
            Place(names[0], "holding", 0.8, (0.7, 0.9), 20.0),
            Place(names[-1], "still", 0.2, (0.1, 0.3), 5.0),
        ),
        subsystems={"pneumatics": 0.97},
        gap=Closing(20.0, 1.1, 0.99, (0.9, 1.0)),
        signals=tuple(
            SignalGap(name, "Pa", gap, 1.0, 100.0 * gap, 100.0, 100.0) for name, gap in zip(names, gaps, strict=True)
        ),
        held_out=(HeldOutSetting("50 kPa", Closing(20.0, 2.0, 0.94, (0.9, 0.97))),),
        classes=(("line_leak_achilles", "line_leak_manifold"),),
        silent=("payload",),
        calibration={"lever.length_m": -1.7},
        references_left=1.44,
        traces=tuple(
            Trace(f"run {i}", name, "Pa", time_s, gap * scatter, 100.0 + 0.0 * time_s, scatter, 1e5 + scatter, scatter)
            for name, gap in zip(names, gaps, strict=True)
            for i in range(settings)
        ),
        next_experiment=following if verdict is Verdict.AMBIGUOUS else None,
        notes=("not recorded: imu/data",),
        spent=Spent(12.0, 100, 500.0),
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
    text = page(diagnosis, ASKED)
    read = Reader(text)
    assert all(source.startswith("data:image/svg+xml;base64,") for source in read.loaded)
    assert not re.search(r"https?://(?!www\.w3\.org)", text)
    assert read.ids >= SECTIONS
    assert words.VERDICTS[verdict].upper() in read.words
    said = [words.headline(diagnosis), *words.checks(diagnosis, ASKED.sentences), *words.explanation(diagnosis)]
    said += [text for each in words.answers(diagnosis) for text in (each.short, each.more)]
    for sentence in (*said, ASKED.origin.version, ASKED.origin.date, ASKED.origin.command):
        assert sentence in read.words
    assert ("set" in read.ids) == bool(diagnosis.candidates)
    assert "unfinished" not in read.ids


@pytest.mark.parametrize("verdict", list(Verdict))
def test_the_words_are_those_of_the_field(verdict: Verdict, capsys: pytest.CaptureFixture[str]) -> None:
    """None of the words that an engineer would stumble over is on the page or in the terminal."""
    screen.show(made_up(verdict), ASKED, Path("gap.html"))
    for text in (Reader(page(made_up(verdict), ASKED)).words, capsys.readouterr().out):
        assert not UNWANTED.search(text)


def test_a_name_is_only_given_where_something_is_named() -> None:
    """NO_GAP and UNKNOWN assert no effect; EFFECTS asserts one; AMBIGUOUS all of the set, and how to split it."""
    said = {verdict: words.headline(made_up(verdict)) for verdict in Verdict}
    assert [("line leaks" in said[each], "pump is worn" in said[each]) for each in said] == [
        (False, False),
        (True, False),
        (True, True),
        (False, False),
    ]
    assert "pump wear differs by 700 Pa" in " ".join(words.explanation(made_up(Verdict.AMBIGUOUS)))
    assert not words.checks(made_up(Verdict.NO_GAP), {})


def picture_texts(text: str, name: str) -> str:
    """Return the text of a picture of the page as SVG."""
    found = re.search(rf'<img[^>]*id="{name}"[^>]*src="data:image/svg\+xml;base64,([^"]+)"', text)
    assert found
    return base64.b64decode(found[1]).decode()


@pytest.mark.parametrize("verdict", list(Verdict))
def test_the_first_picture_shows_the_gap_that_shrinks(verdict: Verdict) -> None:
    """Measured and nominal stand in the first picture; the corrected simulator where an effect is named; one unit."""
    text = page(made_up(verdict), ASKED)
    drawn = picture_texts(text, "overview")
    assert all(f">{each}<" in drawn for each in ("measured", "nominal simulator", "[kPa]", "difference [kPa]"))
    assert (">corrected simulator<" in drawn) == (verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS})
    assert text.index('id="verdict"') < text.index('id="answers"') < text.index('id="overview"')
    assert text.index('id="overview"') < text.index("<h2")


def test_the_page_has_one_answer_to_where_and_one_unit_of_pressure() -> None:
    """The place is that of the largest share, in the headline too, and no pressure is given in Pa."""
    found = made_up(Verdict.UNKNOWN)
    worst = dataclasses.replace(found.signals[1], nominal=99.0)  # a larger residual, yet a small share
    found = dataclasses.replace(found, signals=(found.signals[0], worst))
    one = Place("channel_1/pressure", "still", 0.3, (0.2, 0.4), 30.0)  # the largest cell, of the smaller signal
    others = [Place("channel_0/pressure", phase, share, (0.1, 0.5), 20.0) for phase, share in PLACES.items()]
    found = dataclasses.replace(found, where=(one, *others))
    assert words.main_place(found.where) == (others[0], pytest.approx(0.7))
    assert words.answers(found)[0].short == "channel_0/pressure while the vacuum is held"
    assert "channel_0/pressure" in words.headline(found)
    assert "channel_1/pressure" not in words.headline(found) + " ".join(words.explanation(found))
    text = page(found, ASKED)
    # The sentence of the next experiment is given by the diagnosis.
    assert not re.search(r"\d Pa\b|\[Pa\]", Reader(text).words + picture_texts(text, "overview"))


def test_an_effect_that_is_kept_beside_none_of_them_says_so() -> None:
    """With UNKNOWN what else is in the credible set is called that, with its probability, and is no finding."""
    (said,) = [text for text in words.checks(made_up(Verdict.UNKNOWN), {}) if "pump wear" in text]
    assert "kept in the credible set beside none of them, with a probability of 0.17" in said
    assert "none of the effects on offer causes it (probability 0.80)" in words.headline(made_up(Verdict.UNKNOWN))


def test_an_equivalence_class_is_named_as_one() -> None:
    """What these sensors cannot tell apart is one answer: named together, checked together, one bar together."""
    members = ("line_leak_manifold",)
    found = dataclasses.replace(
        made_up(Verdict.EFFECTS),
        candidates=(candidate((LEAK,), 0.97, members),),
        posterior={("line_leak_achilles",): 0.5, ("line_leak_manifold",): 0.47, (): 0.03},
    )
    said = words.headline(found)
    assert "line leak achilles, one of a class with line leak manifold (these sensors cannot tell them apart)" in said
    sentences = {**ASKED.sentences, "line_leak_manifold": "The manifold leaks: tighten it."}
    assert "line leak manifold (equivalent): Tighten it." in words.checks(found, sentences)
    which = words.answers(found)[1]
    assert (which.short, "Probability 0.97" in which.more) == ("line leak achilles = line leak manifold", True)
    bars = bars_of(found)
    assert [each.label for each in bars] == ["line leak achilles = line leak manifold", words.NONE_OF_THEM]
    assert bars[0].probability == pytest.approx(0.97)
    assert "(in the credible set)" in Reader(page(found, ASKED)).words


def test_the_posterior_keeps_all_of_its_probability() -> None:
    """However many candidates, bars add up to 1, the small ones are one bar, and none of them has one of its own."""
    many = {(f"effect_{i}",): 0.0197 + 1e-6 * i for i in range(50)}
    found = dataclasses.replace(made_up(Verdict.AMBIGUOUS), posterior={**many, (): 1.0 - sum(many.values())})
    bars = bars_of(found)
    assert sum(each.probability for each in bars) == pytest.approx(1.0)
    assert len(bars) <= MOST_BARS + 2
    assert words.NONE_OF_THEM in [each.label for each in bars]


def test_what_a_whole_set_holds_is_said_once() -> None:
    """A set of pairs with one effect in common names that one first, and the others by their names."""
    pairs = (candidate((LEAK, WEAR), 0.5), candidate((LEAK, FRICTION), 0.3), candidate((LEAK,), 0.2))
    following = NextExperiment("rig drop", 2.0, "a", 7.0, 1.0, "Pa", "line_leak_achilles + pump_wear differ by 1 Pa")
    found = dataclasses.replace(made_up(Verdict.AMBIGUOUS), candidates=pairs, next_experiment=following)
    said = words.headline(found)
    assert said.startswith("The achilles line leaks; with it comes one of 3")
    assert said.endswith("pump wear (0.50); joint friction (0.30); nothing else (0.20).")
    assert "joint friction: Grease it." in words.checks(found, {})
    assert "line leak achilles + pump wear differ" in words.explanation(found)[-1]


def test_what_was_stopped_says_so_first() -> None:
    """A diagnosis that was ended early warns above its verdict."""
    text = page(dataclasses.replace(made_up(Verdict.EFFECTS), finished=False), ASKED)
    assert 0 < text.index('id="unfinished"') < text.index('id="verdict"')


def test_the_ledger_and_the_fitted_constants_are_on_the_page() -> None:
    """A waterfall, and a line for the constant that moved; without a gap to share there is none."""
    constant = FittedConstant("lever.length_m", "m", 0.0448, 0.04, 2.4, (0.043, 0.0466))
    still = FittedConstant("foot.mass", "kg", 0.2, 0.2, 0.0, (0.19, 0.21))
    parts = (LedgerEntry("constants of the machine", 0.3, 9.0), LedgerEntry("line_leak_achilles", 0.6, 4.0))
    left = LedgerEntry("left", 0.1, 2.0)
    alone = dataclasses.replace(ASKED, references=[])
    found = dataclasses.replace(made_up(Verdict.EFFECTS), constants=(constant, still), ledger=(*parts, left))
    text = page(found, alone)
    assert 'id="waterfall"' in text
    read = Reader(text).words
    assert "44.8 mm (43.0 to 46.6 mm)" in read
    assert "constants of the machine 30 %, line leak achilles 60 %, left 10 %" in read
    nothing = (LedgerEntry("constants of the machine", math.nan, 1.0), LedgerEntry("left", math.nan, 1.0))
    assert 'id="waterfall"' not in page(dataclasses.replace(found, ledger=nothing), alone)


def test_an_interval_that_is_cut_at_a_bound_says_so() -> None:
    """Of effects and of constants, and nowhere else."""
    lever = FittedConstant("lever.length_m", "m", 0.0448, 0.04, 2.4, (0.043, 0.045), is_cut=True)
    (leak,) = LEAK.parameters
    cut = dataclasses.replace(LEAK, parameters=(dataclasses.replace(leak, is_cut=True),))
    found = dataclasses.replace(made_up(Verdict.EFFECTS), candidates=(candidate((cut,), 0.97),), constants=(lever,))
    said = Reader(page(found, ASKED)).words
    assert "1.00 to 4.00 mm, cut at a bound" in said
    assert "43.0 to 45.0 mm, cut at a bound" in said
    assert "cut" not in Reader(page(made_up(Verdict.EFFECTS), ASKED)).words


def test_a_part_that_leaves_more_than_was_there_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    """Constants fitted without the effect stand in for it, and predict worse than the nominal simulator."""
    for gap, said in ((25.0, True), (9.0, False)):
        ledger = (LedgerEntry("constants of the machine", 0.0, gap), LedgerEntry("left", 0.1, 2.0))
        screen.show(dataclasses.replace(made_up(Verdict.EFFECTS), ledger=ledger), ASKED, Path("gap.html"))
        assert ("more than the nominal 20.0" in capsys.readouterr().out) is said


def test_the_calibration_is_shown_in_its_units() -> None:
    """A constant that references moved stands with nominal and calibrated value, and in standard deviations."""
    said = Reader(page(made_up(Verdict.EFFECTS), ASKED)).words
    assert "40.0 mm" in said
    assert "36.6 mm" in said  # 40 mm less 1.7 times 2 mm
    assert "-1.7" in said
    assert "leaves 1.20 times healthy scatter" in said
    alone = dataclasses.replace(ASKED, references=[])
    assert "fitted together with every candidate" in Reader(page(made_up(Verdict.EFFECTS), alone)).words


@pytest.mark.parametrize("verdict", list(Verdict))
def test_only_what_is_known_is_loaded(verdict: Verdict) -> None:
    """The corrected simulator holds the effect where one explains the gap; one kept beside none of them is not in it.

    The calibration stands in its comments.
    """
    problem = dataclasses.replace(ankle_problem(), constants=(LEVER,))
    text = corrected_file(made_up(verdict), problem, None)
    expected = {"line_leak_achilles": {"conductance_dm3_s_bar": 0.002}}
    assert yaml.safe_load(text) == (expected if verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS} else None)
    assert "#   lever.length_m: 36.6 mm, nominal 40.0 mm (-1.7 standard deviations)" in text


@pytest.mark.parametrize("moved", [0.0, 0.002])
@pytest.mark.parametrize("verdict", list(Verdict))
def test_the_note_says_constants_where_the_file_holds_some(verdict: Verdict, moved: float) -> None:
    """Without references, too, none may have moved, or the machine has none; a diagnosis that was stopped has some."""
    lever = FittedConstant("lever.length_m", "m", 0.04 + moved, 0.04, 500.0 * moved, (0.039, 0.044))
    ledger = (LedgerEntry("constants of the machine", 0.0, 20.0), LedgerEntry("left", 1.0, 20.0))
    found = dataclasses.replace(made_up(verdict), constants=(lever,), ledger=() if moved else ledger)
    assert ("constants" in words.corrected_note(found, "out/corrected.yaml")) is (moved > 0.0)


@pytest.mark.parametrize("verdict", list(Verdict))
def test_only_the_notes_say_what_a_corrected_model_holds(verdict: Verdict) -> None:
    """It may hold a lead beside none of them, which the verdict does not say."""
    note = words.corrected_note(made_up(verdict), "out/corrected.xml")
    assert "what the notes say" in note
    assert "effect" not in note


def test_pages_stay_small_however_much_was_recorded() -> None:
    """Twenty settings of forty signals at length stay below 5 MB, and the page says what was not drawn."""
    text = page(made_up(Verdict.EFFECTS, signals=40, samples=20_000, settings=20), ASKED)
    assert len(text.encode()) < LIMIT_BYTES
    assert text.count("<img") == MOST_TRACES + 2  # and the overview and the bars
    assert f"{40 * 20 - MOST_TRACES} more, with the smallest shares, are not drawn" in text


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("samples", "place"), [(1, 0), (899, 897), (3000, 2998), (3006, 1500), (3006, 3000), (3006, 3004), (5999, 5997)]
)
def test_no_peak_is_lost(samples: int, place: int, sign: float) -> None:
    """Wherever it is, also behind the last whole stretch; there are two points a stretch, and both ends."""
    y = np.zeros(samples)
    y[place] = 100.0 * sign
    x, kept = _thinned(np.arange(samples, dtype=np.float64), y, 300)
    assert place in x
    assert kept[x.tolist().index(place)] == y[place]
    assert {0, samples - 1} <= set(x)
    assert len(x) <= max(3 * 300, 2 * (300 + 1) + 2)


def test_names_cannot_break_the_page() -> None:
    """Names out of a bag are text on the page, never markup."""
    asked = dataclasses.replace(ASKED, bags=["<script>alert(1)</script>"])
    text = page(made_up(Verdict.EFFECTS), asked)
    assert "<script" not in text
    Reader(text)


def test_the_heat_map_keeps_every_share() -> None:
    """Each share stands in the row of its signal and the column of its phase."""
    table = heat_map(made_up(Verdict.EFFECTS).where)
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


def test_numbers_side_by_side_have_one_unit() -> None:
    """The largest chooses the unit; pressures are in kPa whatever their size."""
    assert quantities((0.0003, 0.02), "m") == ["0.300 mm", "20.0 mm"]
    assert quantities((0.9, 250.0), "Pa") == ["9.00e-04 kPa", "0.250 kPa"]
    assert quantities((math.nan, 1.0), "s") == ["-", "1.00 s"]


def test_what_is_not_known_is_a_dash() -> None:
    """Numbers that are none are shown as none, more than all is all, and nothing is certain."""
    nothing = (math.nan, math.nan)
    assert [quantity(math.nan, "Pa"), span(1.0, nothing, "Pa"), percent(math.nan), percents(nothing)] == ["-"] * 4
    assert percent(1.3) == "100 %"
    assert percents((0.91, 0.97)) == "91 to 97 %"
    assert span(0.0301, (0.0285, 0.0315), "s") == "28.5 to 31.5 ms"
    assert [probability(each) for each in (1.0, 0.5, 0.0)] == ["above 0.99", "0.50", "below 0.01"]
