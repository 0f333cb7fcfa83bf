"""How readings count for and against hypotheses: every number of the scores, with where it is from."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_driver.core.leakage import SETTLING_S


@dataclass(frozen=True)
class Scoring:
    """What a reading may gain or cost, and when it counts.

    Attributes:
        cap: Squared normalised error beyond which a reading counts no more against a hypothesis than that, 1: one that
            is off by five deviations is as likely a broken telegram as the doing of a fault.
        grace_s: How long after a valve has moved a part is not taken anew for built otherwise, s: twice the time in
            which the air spreads, in which heat and seats that are not quite shut count most.
        debt_nats: Least score of such a hypothesis in that time: what was lost while valves moved can be gained back.
            A reading at the cap costs 12.5, so one and a half of those.
        allowance_nats: What a hypothesis must gain with every set of readings to count: Page's reference value, half
            the square of a shift by a fifth of a deviation. Without it, an ankle at rest for minutes lets the slightly
            sharper one win.
        still_pa: How far a sensor that is taken as stuck must be from what its own filter makes of the pressure, Pa:
            two deviations of an offset. That a reading stands still where nothing changes says nothing, unless it
            repeats in vacuum as it never did before.
        evacuated_pa: Vacuum beyond which a sensor reads somewhere within its range, Pa: more than offset (1 kPa) and
            weather (2 kPa) together.
        longer_run: A run of equal readings is news beyond so many times the longest one before, 1: a lively sensor's
            runs are of one or two, those of a coarse converter or of a slow sensor are as long as they are.
        more_repeats: And beyond so many more, 1.
        repeat_nats: What a stuck sensor gains by each further reading of such a run: ln(20), as a healthy one would
            have ended.
        lately: Readings that say how fast a pressure changes now, 1: a late one repeats those before it, for 50 ms.
        unknown_pa: Deviation of a pressure that no sensor has read yet, Pa. Assumed: a tenth of an atmosphere.

    """

    cap: float = 25.0
    grace_s: float = 2.0 * SETTLING_S
    debt_nats: float = -20.0
    allowance_nats: float = 0.02
    still_pa: float = 500.0
    evacuated_pa: float = 3e3
    longer_run: float = 2.0
    more_repeats: float = 5.0
    repeat_nats: float = 3.0
    lately: int = 6
    unknown_pa: float = 1e4
