"""`corrected.yaml`: effects that bring the simulation closer to the robot, as people read and simulators load them.

    library: my_effects.yaml          # optional: effects beside those of the package
    line_leak_achilles:
      conductance_dm3_s_bar: 0.0021   # dm3/(s bar), 0 to 0.01, off at 0

Constants of the machine stand in it as effects do. `jammkle rig --effects` and the sim node load it through an entry
point. A live simulation and a robot go without the constants that they cannot show; they refuse such effects.
"""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from jammkle_common.command.errors import InputError
from jammkle_gap.ankle.effects import (
    ankle_library,
    apply_effects,
    apply_to_inputs,
    machine_constants,
    read_yaml,
)
from jammkle_gap.ankle.inputs import AnkleInputs, drawing_of, nominal_rig, rig_of
from jammkle_gap.core.effects import BadEffectError, Library
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.rigs.replay import CommandTrack, Timeline
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.core.effects import Effect
    from jammkle_sim.rigs.rig import AnkleInModel, Rig

_LIBRARY = "library"
_TIMING, _COMMAND_DELAY = "timing", "command_delay"
_NO_COMMANDS = CommandTrack(Timeline(np.zeros(1), np.zeros(1)), {})
_HEADER = (
    "# Effects that bring the simulation closer to the robot: for `jammkle rig ... --effects FILE` and the sim node."
)


@dataclasses.dataclass(frozen=True)
class Correction:
    """Effects and their sizes, ready to be put into any rig."""

    library: Library
    values: Mapping[str, float]
    """By `effect.parameter`."""

    def __call__(self, rig: Rig) -> Rig:
        """Return a rig with the effects in it, which its description tells."""
        changed = apply_effects(self.drawn(rig), self.library, self.values)
        return dataclasses.replace(changed, effects=dict(self.values))

    def drawn(self, rig: Rig) -> Rig:
        """Return a rig built with the constants that its drawing takes; the same where none of these differs."""
        drawn = _inputs_of(rig)
        if drawn is None:
            return rig
        changed = drawing_of(apply_to_inputs(drawn, self.library, self.values))
        return rig if changed == drawing_of(drawn) else rig_of(changed)

    def changes_commands(self, rig: Rig) -> bool:
        """Return whether an effect acts on the commands of a recording of such a rig."""
        drawn = _inputs_of(rig)
        return drawn is not None and apply_to_inputs(drawn, self.library, self.values).commands is not drawn.commands


def _inputs_of(rig: Rig) -> AnkleInputs | None:
    """Return what a rig is drawn from; None of one that is not in the catalogue."""
    if rig.name not in RIGS:
        return None
    return AnkleInputs(rig.name, tuple(sorted(dataclasses.asdict(rig.options).items())), _NO_COMMANDS)


def corrected_text(library: Library, values: Mapping[str, float], library_file: Path | None = None) -> str:
    """Return the content of the file.

    Args:
        library: Effects that the values are of.
        values: By `effect.parameter`; effects of which none is given are left out.
        library_file: Of the user's own effects, if the library has any.

    """
    lines = [_HEADER]
    if library_file is not None:
        place = {_LIBRARY: str(library_file.resolve())}
        lines.append(yaml.safe_dump(place, allow_unicode=True, width=sys.maxsize).rstrip())
    for effect in library:
        if not any(effect.key(parameter) in values for parameter in effect.parameters):
            continue
        lines += ["", f"# {effect.sentence}", f"{effect.name}:"]
        for parameter in effect.parameters:
            value = float(values.get(effect.key(parameter), parameter.null))
            unit = "" if parameter.unit == "1" else f"{parameter.unit}, "
            limits = f"{parameter.minimum:g} to {parameter.maximum:g}, off at {parameter.null:g}"
            number = yaml.safe_dump(value).split()[0]  # what YAML reads as one: 5.0e-11, and not 5e-11
            lines.append(f"  {parameter.name}: {number}  # {unit}{limits}")
    return "\n".join(lines) + "\n"


def load_correction(file: Path) -> Correction:
    """Read the file.

    Raises:
        BadEffectError: it cannot be read, or names what is not in the library, or a value is out of bounds.

    """
    table: Any = read_yaml(file, "effects file") or {}
    if not isinstance(table, dict):
        msg = f"effects file {file} must hold EFFECT: {{PARAMETER: value}}"
        raise BadEffectError(msg)
    own = table.pop(_LIBRARY, None)
    own_effects = ankle_library(None if own is None else file.parent / Path(str(own)))
    library = Library((*machine_constants(), *own_effects))
    values: dict[str, float] = {}
    for name, parameters in table.items():
        effect = library.effect(str(name))
        known = {parameter.name: parameter for parameter in effect.parameters}
        if not isinstance(parameters, dict) or not parameters:
            msg = f"effect '{name}' in {file} must have values of: {', '.join(known)}"
            raise BadEffectError(msg)
        for parameter_name, value in parameters.items():
            parameter = known.get(str(parameter_name))
            if parameter is None:
                msg = f"effect '{name}' in {file} has no parameter '{parameter_name}'; it has: {', '.join(known)}"
                raise BadEffectError(msg)
            number = value if isinstance(value, (int, float)) and not isinstance(value, bool) else float("nan")
            if not parameter.minimum <= number <= parameter.maximum:
                msg = f"{effect.key(parameter)} in {file} is {value}"
                limits = f"{parameter.minimum:g} to {parameter.maximum:g} {parameter.unit}"
                msg += f"; it must be a number from {limits}"
                raise BadEffectError(msg)
            values[effect.key(parameter)] = float(number)
    return Correction(library, values)


@dataclass(frozen=True)
class RigChange:
    """Effects and constants of a file."""

    correction: Correction
    left_out: tuple[str, ...] = ()
    """Constants of the file that this change goes without, by `constant.parameter`."""

    @property
    def values(self) -> Mapping[str, float]:
        """What is changed, by `effect.parameter`."""
        return self.correction.values

    def __call__(self, rig: Rig) -> Rig:
        """Return a rig with the effects in it, and without constants that act on the commands of a recording.

        Raises:
            InputError: the rig has not what an effect changes, or an effect acts on the commands of a recording.

        """
        on_commands = [effect for effect in self._parts() if self._alone(effect).changes_commands(rig)]
        why = "acts on recorded commands, which only a replay has; take it out of the file, or use command_delay"
        shown = self._without(on_commands, why)
        try:
            return dataclasses.replace(shown.correction(rig), left_out=shown.left_out)
        except BadEffectError as error:
            raise InputError(str(error)) from error

    def live(self) -> RigChange:
        """Return what of it a live simulation can show: the stamps of one are those of its own clock.

        Raises:
            InputError: readings come late, or by another clock, as an effect.

        """
        on_stamps = [
            effect
            for effect in self._parts()
            if effect.subsystem == _TIMING and effect.name != _COMMAND_DELAY and self._is_on(effect)
        ]
        why = "acts on stamps, which a live simulation does not change"
        return self._without(on_stamps, f"{why}; take it out of the file, or run the rig with `jammkle rig`")

    def of_robots(self) -> RigChange:
        """Return what of it an ankle of a robot can have.

        Raises:
            InputError: an effect changes a body, a contact, or how the ankle is drawn.

        """
        rig = nominal_rig(AnkleInputs("landing", (), _NO_COMMANDS))
        of_bodies = [effect for effect in self._parts() if not _keeps_bodies(rig, self._alone(effect))]
        why = "changes a body, a contact or the drawing, which a robot has as built"
        way_out = "take it out of the file, or simulate an ankle on its rig (`jammkle up` without --robot)"
        return self._without(of_bodies, f"{why}; {way_out}")

    def on_ankle(self, ankle: AnkleInModel, timestep_s: float) -> AnkleInModel:
        """Return an ankle of a robot with the effects in its laws and its wiring.

        A rig with this ankle's laws is changed, and has them back. What changes the rig itself is refused.

        Args:
            ankle: As it is.
            timestep_s: Of the robot's model, s.

        Raises:
            InputError: an effect changes a body, a contact, or how the ankle is drawn.

        """
        laws = ankle.laws
        rig = dataclasses.replace(
            nominal_rig(AnkleInputs("landing", (("timestep_s", timestep_s),), _NO_COMMANDS)),
            tendon_laws=laws.tendons,
            pneumatic_law=laws.pneumatics,
            imu_law=laws.imu,
            joint_law=laws.joint,
            wiring=ankle.wiring,
        )
        changed = self.of_robots()(rig)
        return dataclasses.replace(ankle, laws=laws_of(changed), wiring=changed.wiring)

    def _parts(self) -> list[Effect]:
        """Return the effects and constants that the file has values of."""
        return [each for each in self.correction.library if self._alone(each).values]

    def _alone(self, effect: Effect) -> Correction:
        own = {key: value for key, value in self.values.items() if key.rpartition(".")[0] == effect.name}
        return dataclasses.replace(self.correction, values=own)

    def _is_on(self, effect: Effect) -> bool:
        return any(self.values.get(effect.key(each), each.null) != each.null for each in effect.parameters)

    def _without(self, effects: Sequence[Effect], why: str) -> RigChange:
        """Return the change without some constants: `gap diagnose` writes all of them, wanted or not.

        Raises:
            InputError: one of these is an effect, which somebody wants to see.

        """
        constants = {constant.name for constant in machine_constants()}
        for effect in effects:
            if effect.name not in constants:
                msg = f"effect '{effect.name}' {why}"
                raise InputError(msg)
        out = [key for effect in effects for key in self._alone(effect).values]
        values = {key: value for key, value in self.values.items() if key not in out}
        return RigChange(dataclasses.replace(self.correction, values=values), (*self.left_out, *out))


def _keeps_bodies(rig: Rig, correction: Correction) -> bool:
    """Return whether effects leave a rig's drawing and its model as they are, to the byte."""
    if correction.drawn(rig) is not rig:
        return False
    changed = correction(rig)
    if changed.model is rig.model:
        return True
    before, after = (np.zeros(mujoco.mj_sizeModel(rig.model), np.uint8) for _ in range(2))
    mujoco.mj_saveModel(rig.model, None, before)
    mujoco.mj_saveModel(changed.model, None, after)
    return bool(np.array_equal(before, after))


def load_change(file: Path) -> RigChange:
    """Read the file.

    Raises:
        InputError: it cannot be used.

    """
    try:
        return RigChange(load_correction(file))
    except BadEffectError as error:
        raise InputError(str(error)) from error
