"""A diagnosis in words and numbers for people: headline, answers, what to check, and lines of tables."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.locate import EVENT_PHASE
from jammkle_gap.core.result import Verdict, beyond

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_common.command.results import Origin
    from jammkle_gap.core.effects import Nuisance
    from jammkle_gap.core.result import Candidate, Diagnosis, FittedConstant, FittedEffect, FittedParameter, Place

PHASE_WORDS = {
    "evacuating": "while it is evacuated",
    "holding": "while the vacuum is held",
    "venting": "while it is vented",
    "still": "while nothing moves",
    "loading": "while it is loaded",
    "unloading": "while it is unloaded",
    "reversal": "at the reversal",
    "falling": "while it falls",
    "impact": "at the impact",
    "rebound": "in the rebound",
    "sliding": "while it slides",
    "other": "in the rest of the run",
    "whole run": "over the whole run",
}
VERDICTS = {
    Verdict.NO_GAP: "no gap",
    Verdict.EFFECTS: "named",
    Verdict.AMBIGUOUS: "one of these",
    Verdict.UNKNOWN: "something else",
}
"""What people read of a verdict; JSON has its own name."""
NONE_OF_THEM = "none of the effects on offer"
_MOST_IN_WORDS = 3
"""Explanations that are given by their sentences; more are given by their names."""
_DASH = "-"
_PREFIXES = {3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
_PREFIXED = ("Pa", "m", "s", "N", "rad", "V", "A")
"""Units that take a prefix; others are shown as they are."""
_ALWAYS = {"Pa": 3}
"""Powers of ten of units that are shown with one prefix throughout, so that no two numbers of a page differ by it."""
_DIGITS = 3
_LARGEST_PLAIN = 1e5
_SMALLEST_PLAIN = 1e-3
_MANY_UNITS = 10.0
_SURE, _NEVER = 0.99, 0.01
_CLEAR = 1.5
"""Gap of a signal above which its line stands out. Chosen: healthy runs hardly ever leave so much."""


@dataclass(frozen=True)
class Asked:
    """One question, as its answer is shown beside."""

    bags: Sequence[str]
    references: Sequence[str]
    rigs: Sequence[str]
    sensors: str
    """Sensors that were used, such as `robot`."""
    library: str
    """File of the user's own effects; empty for none."""
    sentences: Mapping[str, str]
    """Of every effect on offer: what it is and what to check."""
    corrected: str
    """File of the corrected simulator."""
    origin: Origin
    """Version, date and command that made the page."""
    constants: Sequence[Nuisance]
    """Of the machine, which references calibrate."""


def label(name: str) -> str:
    """Return the name of an effect for people: `line leak achilles`."""
    return name.replace("_", " ")


def names_label(names: Sequence[str]) -> str:
    """Return the names of a candidate; of no effects: none of them."""
    return " + ".join(map(label, names)) or NONE_OF_THEM


def candidate_label(candidate: Candidate) -> str:
    """Return the names of a candidate, and those of its equivalence class."""
    own = names_label(candidate.names)
    if not candidate.equivalents:
        return own
    others = ", ".join(map(label, candidate.equivalents))
    return f"{own}, or as well {others} (an equivalence class: these sensors cannot tell them apart)"


def finding(effect: FittedEffect) -> str:
    """Return what is wrong, without what to do about it."""
    return effect.sentence.partition(": ")[0].rstrip(".")


def advice(sentence: str) -> str:
    """Return what to do about an effect; the whole sentence where it is not split by a colon."""
    found, colon, todo = sentence.partition(": ")
    text = (todo if colon else found).rstrip(".")
    return f"{text[:1].upper()}{text[1:]}."


def place_label(place: Place) -> str:
    """Return where something is: `achilles/pressure while the vacuum is held`."""
    if place.phase == EVENT_PHASE:
        return f"the time of {label(place.signal)}"
    return f"{place.signal} {PHASE_WORDS.get(place.phase, f'while {place.phase}')}"


@dataclass(frozen=True)
class Answer:
    """The answer to one of the three questions that a diagnosis is asked."""

    question: str
    short: str
    """A few words, read first."""
    more: str
    """Numbers with their intervals."""


def answers(diagnosis: Diagnosis) -> tuple[Answer, ...]:
    """Return where the gap lies, which effect causes it, and how far it closes; the same wherever it is asked."""
    return _where(diagnosis), _which(diagnosis), _how_far(diagnosis)


def _where(diagnosis: Diagnosis) -> Answer:
    if diagnosis.verdict is Verdict.NO_GAP:
        worst = max(diagnosis.signals, key=lambda each: each.nominal)
        before, after = quantity(worst.nominal_physical, worst.unit), quantity(worst.corrected_physical, worst.unit)
        if diagnosis.ledger:
            more = f"Most in {worst.signal}: of {before} {after} are left (root mean square)."
            return Answer("Where", "Within tolerance", more)
        size = f"{before}, {times(worst.nominal)} times healthy scatter"
        return Answer("Where", "Nowhere", f"The largest difference, in {worst.signal}, is {size} (root mean square).")
    place, share = main_place(diagnosis.where)
    more = f"{percent(share)} of the gap is in this signal, {percent(place.share)} ({percents(place.interval)}) then."
    signal = next((each for each in diagnosis.signals if each.signal == place.signal), None)
    if signal is not None:
        size = quantity(signal.nominal_physical, signal.unit)
        more += f" It differs by {size} over the whole run (root mean square)."
    return Answer("Where", place_label(place), more)


def signal_shares(where: Sequence[Place]) -> dict[str, float]:
    """Return the share of each signal, over all phases."""
    shares: dict[str, float] = {}
    for place in where:
        shares[place.signal] = shares.get(place.signal, 0.0) + place.share
    return shares


def main_place(where: Sequence[Place]) -> tuple[Place, float]:
    """Return where most of the gap lies, and its signal's share: that of the largest share, in its largest phase."""
    shares = signal_shares(where)
    signal = max(shares, key=lambda name: shares[name])
    return max((each for each in where if each.signal == signal), key=lambda each: each.share), shares[signal]


def _which(diagnosis: Diagnosis) -> Answer:
    if diagnosis.verdict is Verdict.NO_GAP:
        return Answer("Which", "No effect", "Nothing is named without a gap.")
    far = _explaining(diagnosis)
    if far:
        short = ", ".join(label(each.name) for each in far)
        moved = ", ".join(f"{each.deviations:+.1f}" for each in far)
        return Answer(
            "Which", short, f"Standard deviations from nominal: {moved}. None of the effects on offer is needed."
        )
    if diagnosis.verdict is Verdict.UNKNOWN:
        sure = _how_sure(diagnosis, ())
        return Answer("Which", f"{NONE_OF_THEM[:1].upper()}{NONE_OF_THEM[1:]}", f"Most likely{sure}.")
    best = diagnosis.candidates[0]
    short = " = ".join((names_label(best.names), *map(label, best.equivalents)))
    lines = parameter_lines(diagnosis.effects)
    sizes = "; ".join(f"{label(line['quantity'])} {line['value']} ({line['interval']})" for line in lines)
    said = [f"Probability {probability(best.probability)}", f"{sizes[:1].upper()}{sizes[1:]}"]
    if best.equivalents:
        said.append("Joined by =: these sensors cannot tell them apart")
    others = len(diagnosis.candidates) - 1
    if others:
        said.append(f"{others} more cannot be excluded: see below")
    return Answer("Which", short, "".join(f"{each}. " for each in said if each).rstrip())


_MOVED = 1.0
"""Standard deviations of its tolerance from which on a constant is said to have moved."""


def _moved(diagnosis: Diagnosis) -> str:
    """Return which constants moved most, as the end of a sentence."""
    moved = [each for each in diagnosis.constants if abs(each.deviations) >= _MOVED][:_MOST_IN_WORDS]
    found = ", ".join(map(_constant, moved))
    return f", with {found}" if found else ""


def _constant(constant: FittedConstant) -> str:
    return f"{label(constant.name)} {quantity(constant.value, constant.unit)}"


def ledger_lines(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """Return one line per part of the ledger."""
    return [
        {"part": label(each.part), "share": percent(each.share), "gap": times(each.gap)} for each in diagnosis.ledger
    ]


def _how_far(diagnosis: Diagnosis) -> Answer:
    gap = diagnosis.gap
    if diagnosis.ledger:
        closed = percent(gap.closed) if math.isfinite(gap.closed) else "Nothing to close"
        if not math.isfinite(diagnosis.ledger[0].share):
            return Answer(
                "How far", "Nothing to close", f"The nominal simulator is {times(gap.nominal)} times scatter off."
            )
        parts = ", ".join(f"{line['part']} {line['share']}" for line in ledger_lines(diagnosis))
        text = f"From {times(gap.nominal)} to {times(gap.corrected)} times scatter, where nothing was fitted"
        return Answer("How far", f"{closed} closed" if math.isfinite(gap.closed) else closed, f"{text}: {parts}.")
    if not diagnosis.effects or diagnosis.verdict in {Verdict.NO_GAP, Verdict.UNKNOWN}:
        short = f"{times(gap.nominal)} times healthy scatter"
        return Answer("How far", short, "Nothing is corrected: no effect is named as the cause.")
    closed = "Nothing to close"
    if math.isfinite(gap.closed):
        closed = f"{percent(gap.closed)} closed ({percents(gap.interval)})"
    text = f"From {times(gap.nominal)} to {times(gap.corrected)} times healthy scatter"
    held = [each for each in diagnosis.held_out if math.isfinite(each.closing.closed)]
    if held:
        least = min(held, key=lambda each: each.closing.closed)
        text += f"; in settings that it was not fitted to at least {percent(least.closing.closed)} ({least.setting})"
    return Answer("How far", closed, f"{text}.")


def headline(diagnosis: Diagnosis) -> str:
    """Return the verdict in one sentence."""
    named = [each for each in diagnosis.candidates if each.names]
    if diagnosis.verdict is Verdict.NO_GAP and diagnosis.ledger:
        return f"The gap is within tolerance: the machine is as drawn{_moved(diagnosis)}."
    if diagnosis.verdict is Verdict.NO_GAP:
        return "No gap is detected: the recordings differ from the simulator by no more than healthy runs scatter."
    if diagnosis.verdict is Verdict.UNKNOWN or not named:
        return _none_of_them(diagnosis)
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        return _one_of(diagnosis)
    best = named[0]
    if best.equivalents:
        members = ", ".join(map(label, best.equivalents))
        return (
            f"An equivalence class explains the gap{_how_sure(diagnosis, best.names)}: {names_label(best.names)}, "
            f"one of a class with {members} (these sensors cannot tell them apart)."
        )
    found = _sentence_of([finding(effect) for effect in best.effects])
    return f"{found}: that explains the gap{_how_sure(diagnosis, best.names)}."


def _explaining(diagnosis: Diagnosis) -> list[FittedConstant]:
    """Return constants beyond their tolerance that explain the gap where no effect does."""
    explained = diagnosis.verdict is Verdict.UNKNOWN and diagnosis.gap.corrected < _CLEAR
    return beyond(diagnosis.constants) if explained else []


def _none_of_them(diagnosis: Diagnosis) -> str:
    far = _explaining(diagnosis)
    if far:
        moved = ", ".join(f"{_constant(each)} ({each.deviations:+.1f} standard deviations)" for each in far)
        which = "A constant beyond its tolerance explains" if len(far) == 1 else "Constants beyond tolerance explain"
        return f"{which} the gap, and none of the effects on offer does: {moved}."
    likely = f"There is a gap, and most likely {NONE_OF_THEM} causes it{_how_sure(diagnosis, ())}"
    place, share = main_place(diagnosis.where)
    return f"{likely}: {percent(share)} of it is in {place.signal}."


def _how_sure(diagnosis: Diagnosis, names: tuple[str, ...]) -> str:
    value = next((each.probability for each in diagnosis.candidates if each.names == names), None)
    value = diagnosis.posterior.get(names) if value is None else value
    return "" if value is None else f" (probability {probability(value)})"


def _one_of(diagnosis: Diagnosis) -> str:
    """Return the credible set in one sentence: what all of it holds, and what differs; by names where it is long."""
    every = [{effect.name: effect for effect in each.effects} for each in diagnosis.candidates]
    shared = [effect for name, effect in every[0].items() if all(name in each for each in every)]
    common = {each.name for each in shared}
    rest = [[each[name] for name in each if name not in common] for each in every]
    brief = bool(shared) or len(rest) > _MOST_IN_WORDS
    options = []
    for candidate, effects in zip(diagnosis.candidates, rest, strict=True):
        words = [label(each.name) if brief else finding(each) for each in effects]
        nothing = "nothing else" if shared else NONE_OF_THEM
        text = " + ".join(words) if brief else "; ".join(words)
        members = "".join(f" = {label(each)}" for each in candidate.equivalents)
        options.append(f"{text or nothing}{members} ({probability(candidate.probability)})")
    found = f"{'; ' if brief else '; or '}".join(f"{text[:1].lower()}{text[1:]}" for text in options)
    if not shared:
        return f"One of {len(rest)} explanations, between which these recordings do not decide: {found}."
    first = _sentence_of([finding(effect) for effect in shared])
    return f"{first}; with it comes one of {len(rest)}, between which these recordings do not decide: {found}."


def checks(diagnosis: Diagnosis, sentences: Mapping[str, str]) -> tuple[str, ...]:
    """Return what a technician should check, most probable first.

    Args:
        diagnosis: What was found.
        sentences: Of effects, for those of an equivalence class that were not fitted.

    """
    if diagnosis.verdict is Verdict.NO_GAP:
        return ()
    texts = []
    if diagnosis.verdict is Verdict.UNKNOWN:
        texts += [
            f"{label(each.name)}: measure it. Fitted, it is {quantity(each.value, each.unit)}, {each.deviations:+.1f} "
            f"standard deviations of its tolerance from {quantity(each.nominal, each.unit)}."
            for each in beyond(diagnosis.constants)
        ]
        texts += [_kept(each, whole(diagnosis)) for each in diagnosis.candidates if each.names]
        return tuple(texts)
    for candidate in diagnosis.candidates:
        texts += [f"{label(effect.name)}: {advice(effect.sentence)}" for effect in candidate.effects]
        texts += [
            f"{label(name)} (equivalent): {advice(sentences[name])}"
            for name in candidate.equivalents
            if name in sentences
        ]
    return tuple(dict.fromkeys(texts))


def whole(diagnosis: Diagnosis) -> str:
    """Return what shares that a candidate explains are of."""
    return "what the constants leave, squared" if diagnosis.constants else "the squared difference"


def _kept(candidate: Candidate, of: str) -> str:
    left = f"it explains {percent(candidate.explained)} of {of}"
    return (
        f"{candidate_label(candidate)} is kept in the credible set beside none of them, with a probability of "
        f"{probability(candidate.probability)}: {left}."
    )


def explanation(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return how sure the verdict is, and what to record next; where, which and how far are in `answers`."""
    chance = f"{diagnosis.p_value:.1g}; the detection threshold is {diagnosis.false_alarm_rate:g}"
    asked = "A machine within its tolerances" if diagnosis.ledger else "A healthy machine"
    texts = [f"{asked} shows a difference like this one with a probability of {chance}."]
    if diagnosis.next_experiment is not None:
        texts.append(f"To split the set, record '{diagnosis.next_experiment.name}': there, {next_sentence(diagnosis)}.")
    return tuple(texts)


def next_sentence(diagnosis: Diagnosis) -> str:
    """Return what the next experiment would show, with the effects' names for people."""
    text = "" if diagnosis.next_experiment is None else diagnosis.next_experiment.sentence
    names = {name for each in diagnosis.candidates for name in each.names}
    for name in sorted(names, key=len, reverse=True):
        text = text.replace(name, label(name))
    return text


def effects_title(diagnosis: Diagnosis) -> str:
    """Return what the table of effects and their sizes shows."""
    return {
        Verdict.UNKNOWN: "Kept beside none of them",
        Verdict.AMBIGUOUS: "Most probable of the credible set",
    }.get(diagnosis.verdict, "What explains the gap")


def corrected_note(diagnosis: Diagnosis, file: str) -> str:
    """Return what can be done with the file of the corrected simulator."""
    if file.endswith(".xml"):
        return f"{file} holds what the notes say; load it in place of the model."
    use = f"jammkle rig ... --effects {file} runs with it"
    constants = any(each.value != each.nominal for each in diagnosis.constants)
    if constants and not (diagnosis.effects and diagnosis.verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS}):
        return f"{file} holds the constants of the machine, and no effect; {use}."
    if diagnosis.verdict is Verdict.NO_GAP:
        return f"{file} holds no effect: no gap was detected."
    if diagnosis.verdict is Verdict.UNKNOWN:
        return f"{file} holds no effect: what is kept beside none of them is not loaded."
    held = "the most probable of the set" if diagnosis.verdict is Verdict.AMBIGUOUS else "it"
    return f"{file} holds {held}{', and the constants of the machine' if constants else ''}; {use}."


def first_answer(shares: Sequence[tuple[str, float]]) -> str:
    """Return the provisional answer: effects, and the share of the squared difference that each explains."""
    shown = ", ".join(f"{label(name)} {percent(share)}" for name, share in shares[:3])
    return f"first answer, before any fit: {shown} of the squared difference; refining"


def _sentence_of(found: list[str]) -> str:
    first, *rest = found
    return " and ".join([first, *(f"{text[:1].lower()}{text[1:]}" for text in rest)])


def _without_unit(name: str, unit: str) -> str:
    """Return a parameter's name without the unit at its end: `conductance` for `conductance_dm3_s_bar`."""
    end = "_".join(re.findall(r"[a-z0-9]+", unit.lower()))
    return name.removesuffix(f"_{end}")


def parameter_lines(effects: Sequence[FittedEffect]) -> list[dict[str, str]]:
    """Return one line per parameter of each effect."""
    return [
        {
            "effect": effect.name,
            "subsystem": effect.subsystem,
            "sentence": effect.sentence,
            "parameter": each.name,
            "quantity": _without_unit(each.name, each.unit),
            "value": estimate(each.value, each.interval, each.unit),
            "interval": _interval(each),
            "detectable": estimate(each.detectable, each.interval, each.unit)
            if math.isfinite(each.detectable)
            else "none within its bounds",
            "remark": "at a bound: the truth may lie beyond" if each.at_bound else "",
        }
        for effect in effects
        for each in effect.parameters
    ]


def signal_lines(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """Return the gap of every signal before and after, largest first."""
    lines = []
    for each in sorted(diagnosis.signals, key=lambda one: -one.nominal):
        sizes = quantities((each.scatter_physical, each.nominal_physical, each.corrected_physical), each.unit)
        lines.append(
            {
                "signal": each.signal,
                **dict(zip(("scatter", "nominal_physical", "corrected_physical"), sizes, strict=True)),
                "nominal": times(each.nominal),
                "corrected": times(each.corrected),
                "tone": "" if each.nominal > _CLEAR else "quiet",
            }
        )
    return lines


def constant_lines(diagnosis: Diagnosis, constants: Sequence[Nuisance]) -> list[dict[str, str]]:
    """Return one line per constant that moved by more than a standard deviation, largest move first.

    Args:
        diagnosis: What was found; constants are fitted beside the effects, or calibrated to references before.
        constants: All that the machine has.

    """
    by_name = {each.name: each for each in constants}
    if diagnosis.constants:
        moved = [
            (
                each.name,
                each.deviations,
                f"{quantity(each.value, each.unit)} ({_interval(each)})",
            )
            for each in diagnosis.constants
            if abs(each.deviations) >= _MOVED
        ]
    else:
        moved = [
            (name, deviations, quantity(_calibrated(by_name[name], deviations), by_name[name].unit))
            for name, deviations in diagnosis.calibration.items()
        ]
    return [
        {
            "name": name,
            "deviations": f"{deviations:+.1f}",
            "nominal": quantity(by_name[name].null, by_name[name].unit),
            "value": value,
            "source": by_name[name].source,
        }
        for name, deviations, value in moved
    ]


def _calibrated(constant: Nuisance, deviations: float) -> float:
    """Return the value of a constant that moved by some standard deviations of its prior, within its bounds."""
    return float(np.clip(constant.null + deviations * constant.sigma, constant.minimum, constant.maximum))


def scale(value: float, unit: str) -> tuple[float, str]:
    """Return what to divide by, and the unit with its prefix, for a number of this size and those beside it."""
    if unit in _ALWAYS:
        return 10.0 ** _ALWAYS[unit], f"{_PREFIXES[_ALWAYS[unit]]}{unit}"
    if unit not in _PREFIXED or not math.isfinite(value) or value == 0.0:
        return 1.0, "" if unit == "1" else unit
    power = 3 * math.floor(math.log10(abs(value)) / 3)
    # Millimetres and milliseconds are read more easily than 12.3e-6.
    power = min(max(power, min(_PREFIXES)), max(_PREFIXES))
    return 10.0**power, f"{_PREFIXES[power]}{unit}"


def digits(value: float) -> str:
    """Return a number with three digits."""
    if not math.isfinite(value):
        return _DASH
    if value == 0.0:
        return "0"
    if not _SMALLEST_PLAIN <= abs(value) < _LARGEST_PLAIN:
        return f"{value:.2e}"
    places = max(_DIGITS - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{places}f}"


def times(gap: float) -> str:
    """Return a gap in healthy scatter: what lies far below 1 is nothing, and needs no digits."""
    if not math.isfinite(gap):
        return _DASH
    return f"{gap:.0f}" if gap >= _MANY_UNITS**2 else f"{gap:.1f}" if gap >= _MANY_UNITS else f"{gap:.2f}"


def quantity(value: float, unit: str) -> str:
    """Return a number with its unit, such as `12.3 kPa`."""
    return quantities([value], unit)[0]


def quantities(values: Sequence[float], unit: str) -> list[str]:
    """Return numbers that are read side by side, all in the unit that fits the largest."""
    factor, name = scale(max((abs(each) for each in values if math.isfinite(each)), default=0.0), unit)
    return [f"{digits(each / factor)} {name}".rstrip() if math.isfinite(each) else _DASH for each in values]


def estimate(value: float, interval: tuple[float, float], unit: str) -> str:
    """Return a number with its unit and as many digits as its interval has."""
    if not all(map(math.isfinite, (value, *interval))):
        return quantity(value, unit)
    factor, name = scale(value or max(interval, key=abs), unit)
    return f"{_to(value / factor, (interval[1] - interval[0]) / factor)} {name}".rstrip()


def span(value: float, interval: tuple[float, float], unit: str) -> str:
    """Return an interval in the unit that its value is shown in, such as `12.1 to 12.5 kPa`."""
    if not all(map(math.isfinite, interval)):
        return _DASH
    factor, name = scale(value or max(interval, key=abs), unit)
    low, high = (_to(end / factor, (interval[1] - interval[0]) / factor) for end in interval)
    return f"{low} to {high} {name}".rstrip()


def _interval(fitted: FittedParameter | FittedConstant) -> str:
    """Return the interval of what was fitted, and whether it is none of the posterior's, but ends at a bound."""
    shown = span(fitted.value, fitted.interval, fitted.unit)
    return f"{shown}, cut at a bound" if fitted.is_cut else shown


def _to(value: float, width: float) -> str:
    """Return a number with as many digits as the width of its interval deserves, three at least."""
    if width <= 0.0 or value == 0.0:
        return digits(value)
    places = max(_DIGITS - 1 - math.floor(math.log10(abs(value))), 1 - math.floor(math.log10(width)), 0)
    return digits(value) if places > 2 * _DIGITS else f"{value:.{places}f}"


def probability(value: float) -> str:
    """Return a probability with two digits; never 0 or 1, which nothing is."""
    if not math.isfinite(value):
        return _DASH
    if value > _SURE:
        return f"above {_SURE}"
    return f"below {_NEVER}" if value < _NEVER else f"{value:.2f}"


def percent(share: float) -> str:
    """Return a share as a whole per cent; what was closed beyond scatter counts as all."""
    return _DASH if not math.isfinite(share) else f"{_whole(share)} %"


def percents(interval: tuple[float, float]) -> str:
    """Return an interval of shares, such as `91 to 97 %`."""
    if not all(map(math.isfinite, interval)):
        return _DASH
    low, high = map(_whole, interval)
    return f"{low} %" if low == high else f"{low} to {high} %"


def _whole(share: float) -> int:
    return round(min(100.0 * share, 100.0))
