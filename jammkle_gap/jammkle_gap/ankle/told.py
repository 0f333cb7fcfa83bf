"""What a bag and its user tell of the rig: which one, and how it was set."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_common import names
from jammkle_gap.ankle.inputs import known_options
from jammkle_gap.core.data import BadRecordingError
from jammkle_sim.rigs.catalogue import RIGS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_gap.ankle.bag import Bag
    from jammkle_gap.ankle.inputs import Options

_SCATTERED = ("seed",)
"""Options that say nothing of what a machine was made to do."""


@dataclass(frozen=True)
class Told:
    """Rig and options of a recording, as far as they are known."""

    rig: str
    given: Mapping[str, Any]
    """Options that bag, user or measurements give; the others are the rig's defaults."""
    firm: frozenset[str] = frozenset()
    """Options that the user gave: no measurement overrules them."""
    measured: frozenset[str] = frozenset()
    """Options that are as the recording shows them."""
    shown: Mapping[str, float] = field(default_factory=dict)
    """What the recording shows of options, whether it is taken or what was told."""

    @property
    def options(self) -> Options:
        """All options of the rig.

        Raises:
            BadRecordingError: one is out of range.

        """
        return known_options(self.rig, self.given)

    @property
    def known(self) -> frozenset[str]:
        """Options that are not merely defaults."""
        return frozenset(self.given) & {name for name, _ in self.options}

    def with_measured(self, name: str, value: Any) -> Told:
        """Return the same with one more option known, by the recording."""
        return dataclasses.replace(self, given={**self.given, name: value}, measured=self.measured | {name})

    def with_shown(self, name: str, value: float) -> Told:
        """Return the same with what the recording shows of an option, which stays as it was told."""
        return dataclasses.replace(self, shown={**self.shown, name: value})


def told_by(bag: Bag, rig: str | None, options: Mapping[str, Any]) -> Told:
    """Return what is known of the rig before anything measured is looked at.

    Args:
        bag: May describe its rig.
        rig: As the user says; None: the bag tells.
        options: As the user says; they go before what the bag tells.

    Raises:
        BadRecordingError: neither tells which rig it is, they contradict each other, or the description is not YAML.

    """
    try:
        described: Any = yaml.safe_load(bag.description) if bag.description else {}
    except yaml.YAMLError as error:
        msg = f"bag {bag.name} has {names.SIM_PARAMETERS.name} that are not YAML: {' '.join(str(error).split())}"
        raise BadRecordingError(msg) from error
    described = described if isinstance(described, dict) else {}
    name = str(described.get("rig", ""))
    if rig is None and not name:
        msg = f"bag {bag.name} does not tell what it was recorded on"
        msg += f"; name it with --rig, one of: {', '.join(RIGS)}"
        raise BadRecordingError(msg)
    if rig is not None and name and rig != name:
        msg = f"bag {bag.name} was recorded on rig '{name}', not '{rig}'"
        msg += "; leave --rig out, or give the right bag"
        raise BadRecordingError(msg)
    given = {**dict(described.get("options") or {}), **options}
    kept = {option: value for option, value in given.items() if option not in _SCATTERED}
    return Told(name or str(rig), kept, frozenset(options))
