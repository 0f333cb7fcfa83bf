"""What was found, in words and numbers for people: a hypothesis that has won, or readings that cannot be."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_driver.core.faults import Finding, Reason, finding
from jammkle_driver.core.hardware import MANIFOLD

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_driver.core.bank import Estimate
    from jammkle_driver.core.hypotheses import Hypothesis


def describe(hypothesis: Hypothesis, places: Sequence[str], estimate: Estimate, gained: float) -> Finding:
    """Return what has failed by a hypothesis, as a finding.

    Args:
        hypothesis: What has failed, and where.
        places: Names of the volumes, the manifold first.
        estimate: What the hypothesis makes of the ankle.
        gained: What it has gained over the healthy ankle, nats.

    """
    place, index = places[hypothesis.place], hypothesis.place
    values = {"log-likelihood gained (nats)": f"{gained:.0f}"}
    reason = hypothesis.reason
    if reason is Reason.LEAK:
        leak = estimate.leaks_m3_s_pa[index]
        values["leak conductance (m^3/(s Pa))"] = f"{leak:.2e}"
        return finding(reason, place, f"leaks with a conductance of {leak * 1e8:.3f} dm^3/(s bar)", values)
    if reason is Reason.BLOCKED_LINE:
        share = estimate.line_shares[index - 1]
        values["line conductance (share of declared)"] = f"{share:.3f}"
        return finding(reason, place, f"line lets through {100.0 * share:.0f} % of what it should", values)
    if reason in {Reason.PUMP_WEAK, Reason.PUMP_DEAD}:
        share = estimate.pump_share
        values["pump flow (share of declared)"] = f"{share:.2f}"
        return finding(reason, MANIFOLD, f"pump draws {100.0 * share:.0f} % of its flow", values)
    if reason is Reason.SENSOR_DRIFTING:
        offset_pa = estimate.offsets_pa[index]
        values["sensor offset (Pa)"] = f"{offset_pa:.0f}"
        return finding(reason, place, f"sensor reads {offset_pa:+.0f} Pa off", values)
    must_pa, manifold_pa = estimate.pressures_pa[index], estimate.pressures_pa[0]
    values["pressure that must be (Pa)"] = f"{must_pa:.0f}"
    if reason is Reason.SENSOR_STUCK:
        seen = f"sensor's reading stands still where the pressure must be {must_pa:.0f} Pa absolute"
        return finding(reason, place, seen, values)
    values["pressure of the manifold (Pa)"] = f"{manifold_pa:.0f}"
    stays = "at the manifold" if reason is Reason.VALVE_STUCK_OPEN else "at the vent, or its line is shut"
    seen = f"valve stays {stays}: {must_pa:.0f} Pa absolute, the manifold {manifold_pa:.0f}"
    return finding(reason, place, seen, values)


def describe_stand_still(duration_s: float, sets: int) -> Finding:
    """Return as a finding that all sensors have repeated one reading, so many times and for so long, s."""
    seen = f"and all other sensors repeat one reading to the digit for {duration_s:.1f} s"
    return finding(Reason.SENSOR_STUCK, MANIFOLD, seen, {"repeated sets (1)": str(sets)})


def describe_out_of_range(
    place: str, reading_pa: float, least_pa: float, most_pa: float, *, atmosphere_measured: bool
) -> Finding:
    """Return as a finding that a sensor reads what no pressure can be, Pa absolute.

    Where vented channels have not told the atmosphere yet, the range is that of a parameter, which may be wrong.
    """
    values = {
        "reading (Pa)": f"{reading_pa:.0f}",
        "least that can be (Pa)": f"{least_pa:.0f}",
        "most that can be (Pa)": f"{most_pa:.0f}",
    }
    seen = f"reads {reading_pa:.0f} Pa absolute, and only {least_pa:.0f} to {most_pa:.0f} Pa can be"
    if not atmosphere_measured:
        seen += " if ambient_pressure_pa is right, which no vented channel has told yet"
    return finding(Reason.SENSOR_OUT_OF_RANGE, place, seen, values)
