"""Changes to the tendons. A place is a tendon or a channel; without one they change all."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import TENDONS_OF_CHANNEL
from jammkle_sim.physics import records

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import Rig

_GROUPS = {
    "achilles_pair": TENDONS_OF_CHANNEL["achilles"],
    "peroneal_pair": (*TENDONS_OF_CHANNEL["peroneal_left"], *TENDONS_OF_CHANNEL["peroneal_right"]),
}
"""Places that are more than one tendon."""


def relax(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale gains and times of the viscoelastic branches, by `gain_scale` and `time_scale`."""
    step_s = float(rig.model.opt.timestep)

    def change(law: Any) -> None:
        times_s = branch_times_s(law, step_s)
        gains = law["gain"] / (times_s / step_s * (1.0 - law["decay"]))
        times_s = times_s * values["time_scale"]
        law["decay"] = np.exp(-step_s / times_s)
        law["gain"] = gains * values["gain_scale"] * times_s / step_s * (1.0 - law["decay"])

    return with_tendons(rig, "", change)


def relax_times(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Scale the times of the viscoelastic branches alone, by `time_scale`."""
    return relax(rig, {"gain_scale": 1.0, **values}, place)


def scale_friction(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale the force at which jammed fibres slide, by `scale`."""

    def change(law: Any) -> None:
        law["friction_yield_n_per_pa"] *= values["scale"]

    return with_tendons(rig, "", change)


def scale_stiffness(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale the elastic force by `scale`."""

    def change(law: Any) -> None:
        law["static_force_n"] *= values["scale"]

    return with_tendons(rig, "", change)


def stiffen_membrane(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Put a spring of `stiffness_n_m` beside the fibres."""
    places = np.arange(records.TABLE_POINTS)

    def change(law: Any) -> None:
        law["static_force_n"] += values["stiffness_n_m"] * places * law["table_step_m"]

    return with_tendons(rig, "", change)


def pretension(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Shorten the tendons by `extension_m`; below 0 they are slack. Their extension is still read from as drawn."""

    def change(law: Any) -> None:
        law["shorter_m"] += values["extension_m"]

    return with_tendons(rig, place, change)


def soften(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let the elastic force fall by up to `loss` as `travel_m` of stretching has been done since the start.

    A tendon that softens already does so further: in the end as one after the other, on the way as one with the mean
    of both travels, by loss. Assumed: the law has one travel.
    """

    def change(law: Any) -> None:
        loss, before = values["loss"], law["softening"]
        if loss > 0.0:
            travelled_m = before * law["softening_travel_m"] + loss * values["travel_m"]
            law["softening_travel_m"] = travelled_m / (before + loss)
            law["softening"] = 1.0 - (1.0 - before) * (1.0 - loss)

    return with_tendons(rig, "", change)


def lose_fibres(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Take the share `lost` of the fibres out: elastic force and friction fall, the membrane still grips."""
    left = 1.0 - values["lost"]

    def change(law: Any) -> None:
        law["static_force_n"] *= left
        law["friction_yield_n_per_pa"] *= left
        law["friction_stiffness_n_m"] *= max(left, 1e-6)

    return with_tendons(rig, place, change)


def scale_tendon(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Scale everything that a tendon pulls with, by `scale`."""
    return fail(rig, {"remaining": values["scale"]}, place)


def fail(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Leave the share `remaining` of everything that a tendon pulls with."""
    left = values["remaining"]

    def change(law: Any) -> None:
        law["static_force_n"] *= left
        law["friction_yield_n_per_pa"] *= left
        law["friction_stiffness_n_m"] *= max(left, 1e-6)
        law["grip_n_per_pa"] *= left

    return with_tendons(rig, place, change)


def branch_times_s(law: Any, step_s: float) -> NDArray[np.float64]:
    """Return the time constants of a tendon's viscoelastic branches, s."""
    times_s: NDArray[np.float64] = -step_s / np.log(law["decay"])
    return times_s


def with_tendons(rig: Rig, place: str, change: Callable[[Any], None]) -> Rig:
    """Return the rig with other laws of some tendons.

    Args:
        rig: Not touched.
        place: A tendon, or a pair; empty: all.
        change: Changes a record of TENDON_LAW in place.

    """
    laws = rig.tendon_laws.copy()
    chosen = _GROUPS.get(place, (place,)) if place else rig.tendon_names
    for i, name in enumerate(rig.tendon_names):
        if name in chosen:
            change(laws[i])
    return dataclasses.replace(rig, tendon_laws=laws)
