"""Cases from the live graph: simulation, driver and controller in processes of their own, landing and recorded."""

from __future__ import annotations

import random
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jammkle_common.command import LANDING, provided
from jammkle_gap.ankle.corrected import corrected_text
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.landing import HiddenEffect
from studies.blind.files import BAGS, CaseNote
from studies.blind.key import Kind, Rung, TrueEffect, Truth
from studies.blind.redacted import redacted
from studies.blind.regimes import settings_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jammkle_common.parameters import Value


_RIG, _NAMESPACE = "landing", "/"
_RUNS, _REFERENCES = 2, 2
_CALM_EVERY = 3
"""Every third case has nothing wrong."""
_LARGEST_SEED = 2**31 - 1


@dataclass(frozen=True)
class LiveCase:
    """One case from the graph: every third has no effect, the others one that a landing can show."""

    trial_seed: int
    number: int

    @property
    def name(self) -> str:
        """Name of the case."""
        return f"live_{self.number + 1:02d}"

    def make(self, place: Path, asked_to_stop: Callable[[], bool]) -> tuple[CaseNote, Truth]:
        """Land and record as often as it takes.

        Args:
            place: Folder of the case.
            asked_to_stop: Ends it early.

        Raises:
            InputError: a graph is already up.
            GraphError: the graph did not start, or not stop, as it should.
            Interrupted: asked to stop.

        """
        generator = random.Random(self.trial_seed * 1000 + self.number)  # noqa: S311 - to be drawn the same again
        calm = self.number % _CALM_EVERY == 0
        values = {} if calm else HiddenEffect.drawn(None, generator.randrange(_LARGEST_SEED)).values
        settings = settings_of(self.trial_seed, _RIG)
        chosen = settings[self.number % len(settings)]
        bags = []
        for kind, count, put_in in (("run", _RUNS, values), ("healthy", _REFERENCES, {})):
            for k in range(count):
                bags.append(f"{BAGS}/{kind}_{k + 1}")
                of_sim: dict[str, Value] = {**chosen, "seed": generator.randrange(_LARGEST_SEED)}
                _record(of_sim, put_in, place / bags[-1], asked_to_stop)
        effects = tuple(
            TrueEffect(key.partition(".")[0], {key.partition(".")[2]: value}) for key, value in values.items()
        )
        subsystems = tuple(ankle_library().effect(effect.name).subsystem for effect in effects)
        truth = Truth(
            Kind.SINGLE if effects else Kind.NONE,
            effects,
            Rung.LIVE,
            " + ".join(f"{key} {value:.4g}" for key, value in values.items()),
            subsystems,
            rigs=(_RIG,),
        )
        return CaseNote(tuple(bags[:_RUNS]), tuple(bags[_RUNS:])), truth


def _record(
    of_sim: Mapping[str, Value],
    effects: Mapping[str, float],
    bag: Path,
    asked_to_stop: Callable[[], bool],
) -> None:
    """Land once, and keep what sensors and commands said."""
    with tempfile.TemporaryDirectory() as hidden:
        whole = Path(hidden) / "bag"
        text = corrected_text(ankle_library(), effects) if effects else ""
        provided(LANDING, "record", "jammkle_bringup")(of_sim, text, whole, asked_to_stop)
        redacted(whole, bag, _NAMESPACE)
