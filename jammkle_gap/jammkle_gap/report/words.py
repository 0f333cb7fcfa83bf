"""A diagnosis in plain words: one sentence, what to check, and how sure it is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_gap.november.verdict import Verdict
from jammkle_gap.report.quantities import noise_units, percent, percents, quantity

if TYPE_CHECKING:
    from jammkle_gap.november.described import Candidate, FittedEffect
    from jammkle_gap.november.diagnosis import Diagnosis
    from jammkle_gap.november.where import Place

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
_NO_EFFECT = "no effect at all"
_MOST_IN_WORDS = 3
"""Explanations that are told by their sentences; more are told by their names."""


def label(name: str) -> str:
    """Return the name of an effect for people: `line leak achilles`."""
    return name.replace("_", " ")


def finding(effect: FittedEffect) -> str:
    """Return what is wrong, without what to do about it."""
    return effect.sentence.partition(": ")[0].rstrip(".")


def advice(effect: FittedEffect) -> str:
    """Return what to do about it; the whole sentence where it is not split by a colon."""
    found, colon, todo = effect.sentence.partition(": ")
    text = (todo if colon else found).rstrip(".")
    return f"{text[:1].upper()}{text[1:]}."


def candidate_label(candidate: Candidate) -> str:
    """Return the names of a candidate."""
    return " + ".join(label(name) for name in candidate.names) or _NO_EFFECT


def place_label(place: Place) -> str:
    """Return where something is: `achilles/pressure while the vacuum is held`."""
    return f"{place.signal} {PHASE_WORDS.get(place.phase, f'while {place.phase}')}"


def headline(diagnosis: Diagnosis) -> str:
    """Return the verdict in one sentence."""
    if diagnosis.verdict is Verdict.NO_GAP:
        return "Simulation and recordings agree within the noise: there is no gap to explain."
    if diagnosis.verdict is Verdict.UNKNOWN:
        return _unexplained(diagnosis)
    if diagnosis.verdict is Verdict.EFFECTS:
        found = [finding(effect) for effect in diagnosis.effects]
        rival = "candidate does as well" if diagnosis.finished else "does as well of what was tried before the stop"
        return f"{_sentence_of(found)}: that explains the gap, and no other {rival}."
    return _one_of(diagnosis)


def _one_of(diagnosis: Diagnosis) -> str:
    """Return the set in one sentence: what all of it holds, and what differs; by names where sentences are many."""
    every = [{effect.name: effect for effect in each.effects} for each in diagnosis.candidates]
    shared = [effect for name, effect in every[0].items() if all(name in each for each in every)]
    rest = [[each[name] for name in each if name not in {one.name for one in shared}] for each in every]
    if shared or len(rest) > _MOST_IN_WORDS:
        options = "; ".join(" + ".join(label(effect.name) for effect in each) or "nothing else" for each in rest)
    else:
        options = "; or ".join("; ".join(finding(effect) for effect in each) or _NO_EFFECT for each in rest)
    if not shared:
        return f"One of {len(rest)} explanations, which these recordings cannot tell apart: {options}."
    found = _sentence_of([finding(effect) for effect in shared])
    return f"{found}; with it comes one of {len(rest)} that these recordings cannot tell apart: {options}."


def _unexplained(diagnosis: Diagnosis) -> str:
    left = max(diagnosis.signals, key=lambda each: each.closing.with_effect)
    most = f"{left.signal} is off by {noise_units(left.closing.with_effect)} times its noise"
    but = " with the best of them" if diagnosis.effects else ""
    if not diagnosis.finished:
        return f"Stopped before an explanation was found: {most}{but}."
    if diagnosis.effects and _is_closed(diagnosis):
        lead = " + ".join(label(effect.name) for effect in diagnosis.effects)
        return f"There is a gap, and nothing is proven to cause it: {lead} would close it, but not clearly better."
    return f"Something real is left that no effect of the library explains: {most}{but}."


def _is_closed(diagnosis: Diagnosis) -> bool:
    return all(each.closing.with_effect <= each.limit for each in diagnosis.signals)


def checks(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what a technician should check, in the order of what speaks for it."""
    if diagnosis.verdict is Verdict.NO_GAP:
        return ()
    if diagnosis.verdict is Verdict.UNKNOWN:
        worst = diagnosis.where.places[0]
        share = f"{percent(worst.share)} ({percents(worst.interval)})"
        texts = [f"The largest part of the gap is in {place_label(worst)}: {share}."]
        if diagnosis.effects:
            names = " + ".join(label(effect.name) for effect in diagnosis.effects)
            texts.append(f"Closest of the library, and not {'proven' if _is_closed(diagnosis) else 'enough'}: {names}.")
        return tuple(texts)
    if diagnosis.verdict is Verdict.EFFECTS:  # the headline has told what is wrong
        return tuple(dict.fromkeys(f"{label(effect.name)}: {advice(effect)}" for effect in diagnosis.effects))
    effects = [effect for each in diagnosis.candidates for effect in each.effects]
    return tuple(dict.fromkeys(f"{label(effect.name)}: {effect.sentence}" for effect in effects))


def explanation(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what the verdict stands on, one sentence each."""
    texts = []
    worst = max(diagnosis.signals, key=lambda each: each.closing.nominal)
    texts.append(
        f"The nominal simulator is off most in {worst.signal}: by {quantity(worst.nominal_physical, worst.unit)} "
        f"(root mean square), {noise_units(worst.closing.nominal)} times its noise."
    )
    if diagnosis.verdict is Verdict.NO_GAP:
        return (*texts, "Up to about 1 is noise, and a simulator is never perfect: this does not count as a gap.")
    place = diagnosis.where.places[0]
    texts.append(
        f"{percent(place.share)} of the gap ({percents(place.interval)}) is in {place_label(place)}.{_blame(diagnosis)}"
    )
    texts.append(closed_sentence(diagnosis))
    if diagnosis.formula is not None:
        texts.append(
            f"A formula explains {percent(diagnosis.formula.share)} of what is left of {diagnosis.formula.signal}."
        )
    if diagnosis.next_experiment is not None:
        following = diagnosis.next_experiment
        texts.append(f"To tell them apart, record '{following.name}': there, {next_sentence(diagnosis)}.")
    return tuple(texts)


def next_sentence(diagnosis: Diagnosis) -> str:
    """Return what the next experiment would show, with the effects' names for people."""
    text = "" if diagnosis.next_experiment is None else diagnosis.next_experiment.sentence
    names = {name for each in diagnosis.candidates for name in each.names}
    for name in sorted(names, key=len, reverse=True):
        text = text.replace(name, label(name))
    return text


def closed_sentence(diagnosis: Diagnosis) -> str:
    """Return how far the gap shrinks, with its interval, on what the effect was not fitted to."""
    names = " + ".join(label(effect.name) for effect in diagnosis.effects)
    worst = max(diagnosis.signals, key=lambda each: each.closing.nominal)
    overall, closing = diagnosis.gap, worst.closing
    if not names and not diagnosis.finished:
        return "What was fitted before the stop foretells nothing clearly better than the nominal simulator does."
    if not names:
        return "No candidate foretells what it was not fitted to clearly better than the nominal simulator."
    text = f"With {names}, {worst.signal} goes from {noise_units(closing.nominal)} to"
    text += f" {noise_units(closing.with_effect)} times its noise"
    text += f" on stretches it was not fitted to: {percent(closing.closed)} closed ({percents(closing.interval)})"
    if math.isfinite(overall.closed):
        text += f"; over all signals {percent(overall.closed)} ({percents(overall.interval)})"
    return f"{text}."


def notes(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what was noted on the recordings, each thing once."""
    counted: dict[str, int] = {}
    for note in diagnosis.notes:
        counted[note] = counted.get(note, 0) + 1
    return tuple(f"{note} ({count} recordings)" if count > 1 else note for note, count in counted.items())


def effects_title(diagnosis: Diagnosis) -> str:
    """Return what the table of effects and their sizes shows."""
    return {
        Verdict.UNKNOWN: "The closest lead, which does not explain the gap",
        Verdict.AMBIGUOUS: "The first of the set",
    }.get(diagnosis.verdict, "What explains the gap")


def corrected_note(diagnosis: Diagnosis, file: str) -> str:
    """Return what can be done with the file of the corrected simulator."""
    if diagnosis.verdict is Verdict.NO_GAP:
        return f"{file} holds no effect: the simulator is right as it is."
    if diagnosis.verdict is Verdict.UNKNOWN:
        return f"{file} holds no effect: what explains a part only is a lead, and not loaded."
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        return f"{file} holds the first of the set; jammkle rig ... --effects {file} runs with it."
    return f"{file} holds it; jammkle rig ... --effects {file} runs with it."


def _blame(diagnosis: Diagnosis) -> str:
    blamed = [each.name for each in diagnosis.where.subsystems if each.to_blame]
    innocent = [each.name for each in diagnosis.where.subsystems if each.gaps and not each.to_blame]
    if not blamed and not innocent:
        return ""
    if not blamed:
        return " No subsystem is off on its own, fed with what was measured at its inputs."
    text = f" Fed with what was measured at their inputs, {_listed(blamed)} {'is' if len(blamed) == 1 else 'are'} off"
    return f"{text}; {_listed(innocent)} {'is' if len(innocent) == 1 else 'are'} not." if innocent else f"{text}."


def _listed(names: list[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last


def _sentence_of(found: list[str]) -> str:
    first, *rest = found
    return " and ".join([first, *(f"{text[:1].lower()}{text[1:]}" for text in rest)])
