"""How much vacuum a landing needs, and how long the air takes to get there.

An ankle that hangs toe-down takes the blow of a landing by turning until its sole is flat. As in the spring-mass model
of running (Blickhan 1989) its stiffness must be right before the touch-down (Hurst, Chestnutt and Rizzi 2010): softer
than needed and the heel strikes, stiffer and the leg is braked harder than it had to be. It does not strike while

    m u^2 / 2 + m g s  <=  A x^2 + B P (1 - exp(-(p - p0) / P)) x

with what falls, m, its speed u, the way s by which it sinks on, the way x by which the Achilles pair is stretched until
the sole is flat, and the vacuum p. On the right is the work of the fibres as a spring and of their friction as they are
jammed. The landing asks for the least vacuum for which that holds.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA, STANDARD_GRAVITY_M_S2

ACHILLES_ARM_M = 0.0374
"""Achilles tendons behind the joint, as the simulated ankle has them."""
LEAST_TRAVEL_M = 0.002
"""A foot whose Achilles pair is stretched by less until it is flat takes no blow: it lands soft, as a flat one does."""
RATED_KG = 1.8
"""What an ankle is rated for: what falls in the paper's drop test."""


@dataclass(frozen=True)
class LandingModel:
    """Constants of the energy balance.

    Fitted by logistic regression to whether the heel strikes at more than 0.1 m/s, in 720 simulated landings of the
    leg (`python -m studies.contact.landings`): hanging by 0.35 to 0.62 rad, on level ground and 12 degrees, payloads of
    0 to 3 kg, falls of 20 to 200 mm, vacuums of 0 to 50 kPa.
    """

    stiffness_n_m: float = 5377.0
    """A: of the pair's fibres over its way."""
    friction_n_per_pa: float = 0.002626
    """B: friction of the pair's jammed fibres, per vacuum."""
    saturation_pa: float = 55.2e3
    """P: vacuum over which that friction levels off."""
    sinking_m: float = 0.0671
    """s: ankle and leg together."""
    onset_pa: float = 8e3
    """p0: vacuum below which the fibres do not touch (the tendon's law)."""

    def needed_pa(self, speed_m_s: float, mass_kg: float, travel_m: float) -> float:
        """Return the least vacuum for which the heel does not strike, Pa; 0: none is needed; inf: none suffices.

        Args:
            speed_m_s: Of the touch-down.
            mass_kg: What falls on this ankle.
            travel_m: By which the Achilles pair is stretched until the sole is flat.

        """
        if travel_m < LEAST_TRAVEL_M:
            return 0.0
        energy_j = mass_kg * (speed_m_s**2 / 2.0 + STANDARD_GRAVITY_M_S2 * self.sinking_m)
        missing_n = energy_j / travel_m - self.stiffness_n_m * travel_m
        if missing_n <= 0.0:
            return 0.0
        left = 1.0 - missing_n / (self.friction_n_per_pa * self.saturation_pa)
        return math.inf if left <= 0.0 else self.onset_pa - self.saturation_pa * math.log(left)


SLOPE_SHARE = 0.6
"""Of the way that a slope adds by geometry, what a landing may count on: feet slide, and a strike costs a peak twice as
high, too much vacuum a fifth. Chosen of 0.4, 0.6, 0.8 and 1 by the peaks of 120 landings of the leg on slopes to 25
degrees, their friction 0.2 to 1.0 above the slope's (`studies/contact`, a development seed)."""


def travel_m(hang_pitch_rad: float, slope_rad: float = 0.0) -> float:
    """By how much the Achilles pair is stretched until a hanging foot is flat on the ground, m.

    Args:
        hang_pitch_rad: How the foot hangs, toe-down.
        slope_rad: How the ground rises toward the toes; what is not known is taken for level.

    """
    return ACHILLES_ARM_M * (math.sin(hang_pitch_rad) + SLOPE_SHARE * math.sin(slope_rad))


HALF_WAY_S = 0.06
"""From the touch-down until the pair has taken up most of a blow, s, while the vacuum still rises: that of this moment
is what counts. Chosen of 0, 0.04, 0.06 and 0.08 by the peaks of 24 landings of the leg."""

MANIFOLD_M3, CHANNEL_M3 = 15e-6, 12e-6
PUMP_M3_S, PUMP_END_PA = 1e-4, 80e3
VALVE_M3_S_PA, DEAD_TIME_S = 1e-9, 0.010
"""The ankle as built: defaults of the driver's parameters. A channel is the Achilles pair, or both peroneal ones."""
_CRITICAL_RATIO, _REFERENCE_PA = 0.5, 1e5
"""Of ISO 6358, as there."""
_STEP_S, _LONGEST_S = 5e-4, 1.0
LEVEL_PA = 2.5e3
"""Distance of the vacuums whose times are known."""
STORED_STEP_PA = 5e3
"""What is stored counts down to a whole number of these."""


@functools.lru_cache(maxsize=256)
def times_to_s(stored_pa: float, reservoir_m3: float, *, achilles_alone: bool) -> tuple[float, ...]:
    """Return from the command on when the Achilles pair is at LEVEL_PA, twice that and so on, s, as far as in a second.

    Mass balances of manifold and channels, isothermal, valves by ISO 6358, the pump at full duty from a linear curve:
    the law that the driver judges by.

    Args:
        stored_pa: Vacuum in manifold and reservoir before.
        reservoir_m3: Volume of the reservoir; 0: none.
        achilles_alone: Whether the peroneal channels stay vented.

    """
    ambient_pa = STANDARD_ATMOSPHERE_PA
    manifold_m3 = MANIFOLD_M3 + reservoir_m3
    manifold_pa, channels_pa = ambient_pa - stored_pa, [ambient_pa] * (1 if achilles_alone else 2)
    times_s: list[float] = []
    time_s = DEAD_TIME_S
    while time_s < _LONGEST_S:
        curve = max(1.0 - (ambient_pa - manifold_pa) / PUMP_END_PA, 0.0)
        into_manifold = -PUMP_M3_S * curve * manifold_pa
        for index, pressure_pa in enumerate(channels_pa):
            valves = VALVE_M3_S_PA * (1 + index)  # the peroneal channels have one each
            drawn = valves * _REFERENCE_PA * _orifice(pressure_pa, manifold_pa)
            channels_pa[index] = pressure_pa - _STEP_S * drawn / CHANNEL_M3
            into_manifold += drawn
        manifold_pa += _STEP_S * into_manifold / manifold_m3
        time_s += _STEP_S
        while ambient_pa - channels_pa[0] >= LEVEL_PA * (len(times_s) + 1):
            times_s.append(time_s)
    return tuple(times_s)


def _orifice(from_pa: float, to_pa: float) -> float:
    """Return the flow of an orifice over its conductance and the reference pressure, Pa; back where `to_pa` is more."""
    if to_pa > from_pa:
        return -_orifice(to_pa, from_pa)
    bend = max(to_pa / from_pa - _CRITICAL_RATIO, 0.0) / (1.0 - _CRITICAL_RATIO)
    return from_pa * math.sqrt(max(1.0 - bend * bend, 0.0))


@dataclass(frozen=True)
class Stored:
    """What the driver says of manifold and reservoir."""

    vacuum_pa: float = 0.0
    """Measured in both, at least, while nothing is jammed."""
    reservoir_m3: float = 0.0


@dataclass(frozen=True)
class Evacuation:
    """What pump and reservoir can do from now on."""

    times_s: tuple[float, ...]
    """From the command to LEVEL_PA, twice that and so on."""

    @staticmethod
    def of(stored: Stored, *, achilles_alone: bool) -> Evacuation:
        """Return it by what is stored now."""
        stored_pa = STORED_STEP_PA * max(math.floor(stored.vacuum_pa / STORED_STEP_PA), 0)
        return Evacuation(times_to_s(stored_pa, stored.reservoir_m3, achilles_alone=achilles_alone))

    def until_s(self, vacuum_pa: float) -> float:
        """How long from the command to a vacuum, s; inf: more than a second."""
        index = math.ceil(vacuum_pa / LEVEL_PA) - 1
        return 0.0 if index < 0 else self.times_s[index] if index < len(self.times_s) else math.inf

    def after_pa(self, time_s: float) -> float:
        """Vacuum a time after the command, Pa."""
        return LEVEL_PA * sum(each <= time_s for each in self.times_s)


@dataclass(frozen=True)
class Landing:
    """What was chosen for a landing, and what came of it."""

    speed_m_s: float
    """Expected at the touch-down; 0: no fall was seen."""
    chosen_pa: float
    """Least vacuum with which the heel does not strike, at most the fullest; 0: soft."""
    reached_pa: float
    """That the Achilles pair has in the blow, HALF_WAY_S after the touch-down, by the model."""
    why: str
    """In plain English: what the choice stands on, and what was done where it could not be carried out."""
    surprised: bool = False
    """Whether nothing foresaw it."""
    time_ns: int = 0
    """Of the touch-down as it was felt."""


class Fall:
    """A free fall so far: when evacuation must begin, and to what.

    How long it will last is not known, so that each moment may be the landing: the vacuum shall be enough for the speed
    of that moment, and not before. A body that was thrown up falls by half of what its flight makes it seem: the ankle
    is stiffer then than it need be, which is the safer error.
    """

    def __init__(self, begin_ns: int, mass_kg: float, travel: float, full_pa: float, air: Evacuation) -> None:
        """Begin.

        Args:
            begin_ns: Stamp at which the free fall began.
            mass_kg: What falls on this ankle.
            travel: Of the Achilles pair, m.
            full_pa: Most vacuum that is asked for.
            air: What pump and reservoir can do.

        """
        self.begin_ns = begin_ns
        self.air = air
        self.model = LandingModel()
        self._mass_kg, self._travel_m, self._full_pa = mass_kg, travel, full_pa

    def speed_m_s(self, time_ns: int) -> float:
        """Return the speed at a time, m/s."""
        return STANDARD_GRAVITY_M_S2 * max(time_ns - self.begin_ns, 0) * 1e-9

    def needed_pa(self, time_ns: int) -> float:
        """Return the vacuum that a landing at a time needs, Pa; inf: none suffices."""
        return self.model.needed_pa(self.speed_m_s(time_ns), self._mass_kg, self._travel_m)

    def must_begin(self, time_ns: int) -> bool:
        """Whether a later start would come short of what some landing from now on needs, up to the fullest vacuum."""
        least_pa = self.model.onset_pa
        for index, after_s in enumerate(self.air.times_s):
            level_pa = LEVEL_PA * (index + 1)
            if level_pa > self._full_pa:
                break
            if level_pa >= least_pa and self.needed_pa(time_ns + round((after_s - HALF_WAY_S) * 1e9)) >= level_pa:
                return True
        return False

    def landing(self, time_ns: int, begun_ns: int | None) -> Landing:
        """Return what a touch-down at a time finds.

        Args:
            time_ns: Of the touch-down.
            begun_ns: When evacuation began; None: it did not.

        """
        needed_pa = self.needed_pa(time_ns)
        chosen_pa = min(needed_pa, self._full_pa)
        reached_pa = 0.0 if begun_ns is None else self.air.after_pa((time_ns - begun_ns) * 1e-9 + HALF_WAY_S)
        why = f"a fall seen for {(time_ns - self.begin_ns) * 1e-6:.0f} ms with {self._mass_kg:.1f} kg"
        if needed_pa > self._full_pa:
            why += "; more than the ankle takes: as stiff as it gets, and the heel may strike"
        elif reached_pa < chosen_pa - LEVEL_PA:
            why += "; too short a time: what could be reached, and full vacuum from here on"
        return Landing(self.speed_m_s(time_ns), chosen_pa, reached_pa, why, time_ns=time_ns)
