"""What may be wrong with the simulated ankle of the demo: effects that one landing can show, and what came of it."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.command.errors import InputError
from jammkle_gap.core.result import Verdict

if TYPE_CHECKING:
    import random

    from jammkle_gap.core.effects import Library
    from jammkle_gap.core.result import Diagnosis


@dataclass(frozen=True)
class DemoEffect:
    """One effect of the library with the sizes that it may have."""

    name: str
    parameter: str
    smallest: float
    largest: float
    """In the parameter's unit; within them, a landing still jams every channel."""


EFFECTS: tuple[DemoEffect, ...] = (
    DemoEffect("tendon_stiffness", "scale", 1.2, 1.6),
    DemoEffect("jamming_friction", "scale", 0.3, 0.7),
    DemoEffect("fibre_loss_achilles_left", "lost", 0.2, 0.5),
    DemoEffect("fibre_loss_achilles_right", "lost", 0.2, 0.5),
    DemoEffect("imu_offset", "z_m_s2", 0.15, 0.5),
    DemoEffect("line_leak_achilles", "conductance_dm3_s_bar", 0.001, 0.003),
    DemoEffect("pump_wear", "flow_scale", 0.6, 0.85),
    DemoEffect("valve_dead_time", "extra_s", 0.006, 0.02),
)
"""Of air, tendons and IMU. At rest an IMU that sits crooked reads as one with an offset along the floor, and so only
that upwards is among these. Where its foot sticks and slips, a landing tells nothing of mass and friction: such effects
are not among these."""


class Outcome(enum.Enum):
    """How the diagnosis did."""

    RIGHT = "right"
    AMONG_SEVERAL = "among several"
    MISSED = "missed"
    WRONG = "wrong"


@dataclass(frozen=True)
class Secret:
    """What the demo puts into the simulation, and does not tell."""

    values: dict[str, float]
    """By `effect.parameter`; empty: nothing."""

    @property
    def name(self) -> str:
        """Name of the effect; empty without one."""
        return next(iter(self.values), "").partition(".")[0]

    def text(self, library: Library) -> str:
        """Say what it was, with value and unit."""
        if not self.values:
            return "nothing: the simulated ankle was as its simulator has it"
        key, value = next(iter(self.values.items()))
        parameter = next(each for each in library.effect(self.name).parameters if key.endswith(f".{each.name}"))
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        return f"{self.name}, {parameter.name} {value:.3g}{unit} (null at {parameter.null:g})"


def draw(generator: random.Random, name: str | None) -> Secret:
    """Return an effect of a size within its range.

    Args:
        generator: Of the draw.
        name: Of the effect; None draws one.

    Raises:
        InputError: no effect of the demo has this name.

    """
    known = {each.name: each for each in EFFECTS}
    if name is not None and name not in known:
        msg = f"--effect '{name}' is none that a landing can show; choose one of: {', '.join(known)}"
        raise InputError(msg)
    effect = generator.choice(EFFECTS) if name is None else known[name]
    return Secret({f"{effect.name}.{effect.parameter}": generator.uniform(effect.smallest, effect.largest)})


def outcome(secret: Secret, diagnosis: Diagnosis) -> Outcome:
    """Judge a diagnosis; an equivalence class that the truth is in is named with it.

    Args:
        secret: What was there.
        diagnosis: What was said.

    """
    if diagnosis.verdict is Verdict.NO_GAP:
        return Outcome.MISSED if secret.values else Outcome.RIGHT
    if diagnosis.verdict is Verdict.UNKNOWN:
        return Outcome.MISSED if secret.values else Outcome.WRONG
    if not secret.values:
        return Outcome.WRONG
    named = [(each.names, *((other,) for other in each.equivalents)) for each in diagnosis.candidates]
    if diagnosis.verdict is Verdict.EFFECTS:
        if named[0] == ((secret.name,),):
            return Outcome.RIGHT
        return Outcome.AMONG_SEVERAL if len(named[0][0]) == 1 and (secret.name,) in named[0] else Outcome.WRONG
    return Outcome.AMONG_SEVERAL if any((secret.name,) in each for each in named) else Outcome.WRONG
