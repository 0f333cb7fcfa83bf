"""What the diagnosis is asked about: bags and how their rig was set, and the effects on offer."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from jammkle_common.command.errors import GraphError, InputError, Interrupted
from jammkle_common.command.results import progress_bar
from jammkle_common.parameters import as_typed, typed_name
from jammkle_gap.ankle.alike import difference
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.loading import load_recordings
from jammkle_gap.ankle.per_bag import BadRequestError, requests_for
from jammkle_gap.ankle.sensor_sets import headline_set, selected
from jammkle_gap.ankle.setting import with_settings
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.effects import BadEffectError, Library
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from jammkle_gap.ankle.per_bag import BagRequest
    from jammkle_gap.ankle.sensor_sets import SensorSet
    from jammkle_gap.core.data import Recording


def asked_of(
    bags: Sequence[Path], references: Sequence[Path], rigs: Sequence[str], settings: Sequence[str]
) -> tuple[tuple[BagRequest, ...], tuple[BagRequest, ...]]:
    """Return what is said of each bag and of each reference, refusing what cannot work before anything is read.

    Args:
        bags: To be diagnosed.
        references: Of the healthy machine.
        rigs: `RIG` or `BAG=RIG`.
        settings: `NAME=VALUE` or `BAG:NAME=VALUE`.

    Raises:
        InputError: a rig does not exist, a setting is none, or a bag is given twice.

    """
    paths = (*bags, *references)
    try:
        found = requests_for([str(bag) for bag in paths], rigs, settings)
    except BadRequestError as error:
        raise InputError(str(error)) from error
    given = [bag.resolve() for bag in paths]
    for place, bag in enumerate(given):
        if bag in given[:place]:
            known = "as a reference too" if place >= len(bags) else "twice"
            msg = f"bag {bag.name} is given {known}; a repeat and a reference must be runs of their own"
            raise InputError(msg)
    return found[: len(bags)], found[len(bags) :]


def library_of(file: Path | None, only: Sequence[str] = (), without: Sequence[str] = ()) -> Library:
    """Return the effects on offer.

    Args:
        file: Effects of a user's own, beside the built-in ones.
        only: Those on offer, and no others; empty: all.
        without: Those taken out.

    Raises:
        InputError: one of them cannot be used.

    """
    try:
        library = ankle_library(file)
        if only:
            library = Library(tuple(library.effect(name) for name in dict.fromkeys(only)))
        for name in dict.fromkeys(without):
            library = library.without(library.effect(name).name)
    except BadEffectError as error:
        raise InputError(str(error)) from error
    if not library.effects:
        msg = "--without leaves no effect to offer; leave one in the library"
        raise InputError(msg)
    return library


def recordings_of(
    bags: Sequence[Path],
    requests: Sequence[BagRequest],
    stop: Callable[[], bool],
    namespace: str | None = None,
    sensors: SensorSet | None = None,
) -> list[Recording]:
    """Read bags: a recording for each run that they hold.

    Args:
        bags: To be read.
        requests: What is said of each.
        stop: Asked before each bag; True ends it.
        namespace: Of the ankle, if the bags hold several.
        sensors: That are used; None: those of a robot, and the load cell where it was recorded.

    Raises:
        InputError: one cannot be used.
        GraphError: the simulator fails on one.
        Interrupted: asked to stop.

    """
    found: list[tuple[Path, tuple[Recording, ...]]] = []
    with progress_bar("reading bags") as update:
        for place, (bag, request) in enumerate(zip(bags, requests, strict=True)):
            if stop():
                raise Interrupted
            update(place / len(bags), bag.name)
            try:
                runs = load_recordings(bag, request.rig, options=request.options, namespace=namespace)
                found.append((bag, tuple(selected(each, sensors or headline_set(each)) for each in runs)))
            except BadRecordingError as error:
                raise InputError(as_typed(error, "--set ")) from error
            except UnstableSimulationError as error:
                msg = f"bag {bag}: {error}"
                raise GraphError(msg) from error
    _check_options(found, requests)
    names = [each.name for _, runs in found for each in runs]
    return [
        dataclasses.replace(each, name=f"{bag}{each.name[len(bag.name) :]}") if names.count(each.name) > 1 else each
        for bag, runs in found
        for each in runs
    ]


def in_settings(
    recordings: Sequence[Recording], references: Sequence[Recording]
) -> tuple[list[Recording], list[Recording]]:
    """Return recordings and references with their settings; those that are repeats of each other have the same.

    A reference that is no repeat of a recording is left out, and noted.

    Raises:
        InputError: no reference is a repeat of a recording; the message says how they differ.

    """
    every = with_settings([*recordings, *references])
    own, others = list(every[: len(recordings)]), every[len(recordings) :]
    settings = {each.setting for each in own}
    found = [each for each in others if each.setting in settings]
    strange = {each.name: difference(own[0], each) for each in others if each.setting not in settings}
    if others and not found:
        told = "; ".join(f"{name}: {how}" for name, how in strange.items())
        msg = f"no reference is a repeat of recording {own[0].name}: {told}"
        msg += "; record references that do the same, or leave them out"
        raise InputError(msg)
    notes = tuple(f"reference {name} is no repeat of it, and left out: {how}" for name, how in strange.items())
    own[0] = dataclasses.replace(own[0], notes=(*own[0].notes, *notes))
    return own, found


def _check_options(found: Sequence[tuple[Path, Sequence[Recording]]], requests: Sequence[BagRequest]) -> None:
    """Refuse an option that its bag's rig does not have; one for all bags, if none of their rigs has it."""
    rigs = [runs[0].inputs for _, runs in found]
    every = {name for inputs in rigs for name, _ in inputs.options}
    for inputs, request in zip(rigs, requests, strict=True):
        own = {name for name, _ in inputs.options}
        unknown = sorted(name for name in request.options if name not in (own if name in request.own else every))
        if unknown:
            known = ", ".join(typed_name(name) for name, _ in inputs.options)
            wrong = typed_name(unknown[0])
            msg = f"--set {wrong} is no option of rig {inputs.rig}; it has: {known}"
            raise InputError(msg)
