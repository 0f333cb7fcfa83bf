"""What the diagnosis is asked about: bags and how their rig was set, and the effects on offer."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.loading import load_recording
from jammkle_gap.core.effects import BadEffectError, Library
from jammkle_gap.core.data import BadRecordingError
from jammkle_graph.command.errors import GraphError, InputError
from jammkle_graph.command.progress import progress_bar
from jammkle_graph.command.signals import Interrupted
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from jammkle_gap.core.data import Recording


def check_given(bags: Sequence[Path], references: Sequence[Path], rig: str | None) -> None:
    """Refuse bags and a rig that cannot work before anything is read.

    Raises:
        InputError: the rig does not exist, or a bag is given twice.

    """
    if rig is not None and rig not in RIGS:
        msg = f"--rig '{rig}' does not exist; known are: {', '.join(RIGS)}"
        raise InputError(msg)
    given = [bag.resolve() for bag in (*bags, *references)]
    for place, bag in enumerate(given):
        if bag in given[:place]:
            known = "as a reference too" if place >= len(bags) else "twice"
            msg = f"bag {bag.name} is given {known}; a repeat and a reference must be runs of their own"
            raise InputError(msg)


def rig_options(settings: Sequence[str]) -> dict[str, Any]:
    """Return how the rig is set, whatever the bags say; `settings` are NAME=VALUE.

    Raises:
        InputError: a setting that is none.

    """
    return dict(map(_setting, settings))


def _setting(text: str) -> tuple[str, Any]:
    name, sign, value = text.partition("=")
    if not name or not sign:
        msg = f"--set '{text}' must be NAME=VALUE, such as vacuum_pa=50000"
        raise InputError(msg)
    try:
        read = yaml.safe_load(value)
    except yaml.YAMLError as error:
        msg = f"--set '{text}' has a value that cannot be read; write a number or a word, such as vacuum_pa=50000"
        raise InputError(msg) from error
    try:
        return name.replace("-", "_"), float(read) if isinstance(read, str) else read
    except ValueError:  # a word, such as a foot
        return name.replace("-", "_"), read


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
    rig: str | None,
    options: Mapping[str, Any],
    stop: Callable[[], bool],
    namespace: str | None = None,
) -> list[Recording]:
    """Read bags.

    Args:
        bags: To be read.
        rig: What was recorded, where the bags do not tell.
        options: How it was set, whatever the bags say.
        stop: Asked before each bag; True ends it.
        namespace: Of the ankle, if the bags hold several.

    Raises:
        InputError: one cannot be used.
        GraphError: the simulator fails on one.
        Interrupted: asked to stop.

    """
    found: list[Recording] = []
    with progress_bar("reading bags") as update:
        for place, bag in enumerate(bags):
            if stop():
                raise Interrupted
            update(place / len(bags), bag.name)
            try:
                recording = load_recording(bag, rig, options=options, namespace=namespace)
            except BadRecordingError as error:
                raise InputError(str(error)) from error
            except UnstableSimulationError as error:
                msg = f"bag {bag}: {error}"
                raise GraphError(msg) from error
            unknown = sorted(set(options) - {name for name, _ in recording.inputs.options})
            if unknown:
                known = ", ".join(name for name, _ in recording.inputs.options)
                msg = f"--set {unknown[0]} is no option of rig {recording.inputs.rig}; it has: {known}"
                raise InputError(msg)
            found.append(recording)
    names = [each.name for each in found]
    return [
        dataclasses.replace(each, name=str(bag)) if names.count(each.name) > 1 else each
        for each, bag in zip(found, bags, strict=True)
    ]
