"""Changes to what a rig is given: commands, how it was set, the atmosphere, constants of its ankle."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

from jammkle_common.names import CHANNELS
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_sim.rigs.catalogue import rig_kind
from jammkle_sim.rigs.replay import is_driven

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_gap.ankle.inputs import AnkleInputs

_PUMP = "pump"
_CONSTANTS = {
    "toe": "toe_m",
    "heel": "heel_m",
    "achilles": "achilles_arm_m",
    "peroneal": "peroneal_forward_m",
    "peroneal_side": "peroneal_spread_m",
    "sole": "sole_m",
    "foot": "foot_mass_kg",
}
"""Constants of the ankle by place."""
_PITCH_OPTION = "pitch_deg"
"""Option of a rig that sets the pose; the others let the foot hang level."""


def shift_commands(inputs: AnkleInputs, values: Mapping[str, float], place: str) -> AnkleInputs:
    """Let what pump or solenoids were told come `late_s` later. A place is `pump` or a channel; none is all."""
    commands, late_s = inputs.commands, values["late_s"]
    chosen = (place,) if place else (_PUMP, *CHANNELS)
    solenoids = {
        channel: line.later(late_s) if channel in chosen else line for channel, line in commands.solenoids.items()
    }
    duty = commands.duty.later(late_s) if _PUMP in chosen else commands.duty
    return dataclasses.replace(inputs, commands=dataclasses.replace(commands, duty=duty, solenoids=solenoids))


def hasten_commands(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Let all commands come `late_s` sooner: on the clock of a rig that moves so much later. See `move_later`.

    A release that was seen is then read so much later. A drive has no start that scatters, as its course is measured.
    """
    rig = nominal_rig(inputs)
    if not rig.events or is_driven(rig):
        return inputs
    if inputs.release_s is not None and inputs.release_seen_by:
        inputs = dataclasses.replace(inputs, release_s=inputs.release_s + values["late_s"])
    return shift_commands(inputs, {"late_s": -values["late_s"]}, "")


def change_weather(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Raise the pressure of the atmosphere by `extra_pa`."""
    ambient_pa = nominal_rig(inputs).pneumatics.ambient_pa + values["extra_pa"]
    return dataclasses.replace(inputs, ambient_pa=ambient_pa)


def scale_ankle(inputs: AnkleInputs, values: Mapping[str, float], place: str) -> AnkleInputs:
    """Scale one constant of the ankle by `scale`: free lengths and start follow, as on a rig that is set up by them."""
    return _with_ankle(inputs, _CONSTANTS[place], lambda constant: constant * values["scale"])


def pitch_foot(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Let the foot hang `extra_deg` further toe-down."""
    extra_deg = values["extra_deg"]
    if _PITCH_OPTION in dict(inputs.options):
        return _with_option(inputs, _PITCH_OPTION, lambda pitch_deg: pitch_deg + extra_deg)
    return _with_ankle(inputs, "hang_pitch_rad", lambda pitch_rad: pitch_rad + math.radians(extra_deg))


def tilt_slope(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Make the slope steeper by `extra_deg`."""
    return _with_option(inputs, "slope_deg", lambda slope_deg: slope_deg + values["extra_deg"])


def raise_drop(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Let it fall from `extra_m` higher, if it falls at all."""
    return _with_option(inputs, "drop_height_m", lambda height_m: max(height_m + values["extra_m"], 0.0))


def scale_travel(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Scale the way of a driven carriage by `scale`, from where it starts."""
    course = inputs.course
    if course is None:
        for option in ("extension_m", "descent_m"):
            inputs = _with_option(inputs, option, lambda way_m: way_m * values["scale"])
        return inputs
    scaled_m = course.start_m + values["scale"] * (course.position_m - course.start_m)
    return dataclasses.replace(inputs, course=dataclasses.replace(course, position_m=scaled_m))


def _with_option(inputs: AnkleInputs, option: str, change: Any) -> AnkleInputs:
    """Change an option of the rig; a rig that does not have it stays as it is."""
    options = dict(inputs.options)
    if option not in options:
        return inputs
    options[option] = change(options[option])
    return dataclasses.replace(inputs, options=tuple(sorted(options.items())))


def _with_ankle(inputs: AnkleInputs, constant: str, change: Any) -> AnkleInputs:
    """Change a constant of the ankle; a rig without one stays as it is."""
    ankle = rig_kind(inputs.rig).ankle
    if ankle is None:
        return inputs
    constants = {constant: getattr(ankle, constant), **dict(inputs.ankle)}
    constants[constant] = change(constants[constant])
    return dataclasses.replace(inputs, ankle=tuple(sorted(constants.items())))
