"""Pacing: never ahead of real time, no drift, a bounded backlog, an honest real-time factor."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_sim.core.engine import AS_FAST_AS_POSSIBLE, MAX_BACKLOG_S, Pacer, RealTimeFactor

INTERVAL_S = 0.002
SPEEDS = st.floats(0.01, 100.0)


def drive(pacer: Pacer, delays_s: list[float]) -> tuple[float, float]:
    """Take one cycle per delay, each begun as soon as it is due and the delay is over; return both times reached."""
    now_s = simulated_s = 0.0
    pacer.restart(simulated_s, now_s)
    for index, delay_s in enumerate(delays_s):
        simulated_s = (index + 1) * INTERVAL_S
        now_s += max(pacer.wait_s(simulated_s, now_s), delay_s)
        pacer.begin(simulated_s, now_s)
    return simulated_s, now_s


@given(SPEEDS, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=50))
def test_simulated_time_never_runs_ahead(speed: float, delays_s: list[float]) -> None:
    """Whatever the delays, simulated time is at most real time x speed."""
    simulated_s, now_s = drive(Pacer(speed), delays_s)
    assert simulated_s <= now_s * speed * (1 + 1e-9)


@given(SPEEDS, st.lists(st.floats(0.0, MAX_BACKLOG_S / 60), min_size=1, max_size=50))
def test_small_delays_are_caught_up(speed: float, delays_s: list[float]) -> None:
    """While the backlog stays within its bound, the due times stay where they were: nothing is given up."""
    pacer = Pacer(speed)
    simulated_s, now_s = drive(pacer, delays_s)
    next_s = simulated_s + INTERVAL_S
    assert pacer.given_up_s == 0.0
    assert pacer.wait_s(next_s, now_s) == pytest.approx(max(0.0, next_s / speed - now_s), abs=1e-9)


@given(st.floats(0.2, 1e4))
def test_a_long_stall_is_caught_up_only_to_the_bound(stall_s: float) -> None:
    """After a stall the simulation has MAX_BACKLOG_S of work that is due at once, and not the whole stall."""
    pacer = Pacer(1.0)
    pacer.restart(0.0, 0.0)
    pacer.begin(INTERVAL_S, stall_s)
    due = 0
    while due < 1000 and pacer.wait_s((due + 2) * INTERVAL_S, stall_s) <= 0.0:
        due += 1
    assert due * INTERVAL_S == pytest.approx(MAX_BACKLOG_S, abs=1.01 * INTERVAL_S)
    assert pacer.given_up_s == pytest.approx(stall_s - INTERVAL_S - MAX_BACKLOG_S)


def test_no_drift_over_hours() -> None:
    """The cycle of hour 10 is due exactly ten hours after the start, however many cycles there were between."""
    pacer = Pacer(1.0)
    pacer.restart(0.0, 1234.5)
    for hour in range(10):
        for index in range(1000):
            simulated_s = hour * 3600 + (index + 1) * INTERVAL_S
            pacer.begin(simulated_s, 1234.5 + simulated_s)
    assert pacer.wait_s(36_000.0, 1234.5) == pytest.approx(36_000.0, abs=1e-9)
    assert pacer.given_up_s == 0.0


def test_as_fast_as_possible_never_waits_and_is_never_late() -> None:
    """Without pacing everything is due, and nothing counts as late."""
    pacer = Pacer(AS_FAST_AS_POSSIBLE)
    pacer.restart(0.0, 0.0)
    assert pacer.wait_s(1e6, 0.0) == 0.0
    pacer.begin(INTERVAL_S, 1e6)
    assert pacer.late_cycles == 0


def test_a_cycle_is_late_when_the_next_one_is_due_already() -> None:
    """A delay below one interval is jitter; beyond it the cycle counts as late."""
    pacer = Pacer(1.0)
    pacer.restart(0.0, 0.0)
    pacer.begin(INTERVAL_S, 1.9 * INTERVAL_S)
    assert pacer.late_cycles == 0
    pacer.begin(2 * INTERVAL_S, 3.1 * INTERVAL_S)
    assert pacer.late_cycles == 1


@given(SPEEDS, SPEEDS)
def test_a_new_speed_counts_from_the_change(before: float, after: float) -> None:
    """After a change of speed the first interval takes its new length, without a jump."""
    pacer = Pacer(before)
    pacer.restart(0.0, 0.0)
    pacer.restart(5.0, 7.0, after)
    assert pacer.wait_s(5.0 + INTERVAL_S, 7.0) == pytest.approx(INTERVAL_S / after, rel=1e-6)


@given(st.floats(0.05, 50.0), st.floats(0.001, 0.04))
def test_the_factor_is_the_slope(speed: float, period_s: float) -> None:
    """At a steady pace the factor is that pace."""
    factor = RealTimeFactor()
    for index in range(round(3.0 / period_s)):
        factor.note(speed * index * period_s, index * period_s)
    assert factor.value() == pytest.approx(speed, rel=1e-6)


def test_the_factor_forgets_what_is_long_past() -> None:
    """Five seconds after the pace has halved, the factor knows only the new pace."""
    factor = RealTimeFactor()
    for tenth in range(100):
        factor.note(tenth * 0.1 if tenth < 50 else 5.0 + (tenth - 50) * 0.05, tenth * 0.1)
    assert factor.value() == pytest.approx(0.5)


def test_the_factor_says_when_it_does_not_know() -> None:
    """Without a quarter of a second of measurements there is no factor; a restart forgets, and time that goes back."""
    factor = RealTimeFactor()
    factor.note(math.nan, 0.0)
    assert math.isnan(factor.value())
    for tenth in range(10):
        factor.note(tenth * 0.1, tenth * 0.1)
    assert factor.value() == pytest.approx(1.0)
    factor.note(0.0, 1.0)
    assert math.isnan(factor.value())
    factor.note(1.0, 2.0)
    assert factor.value() == pytest.approx(1.0)
    factor.restart()
    assert math.isnan(factor.value())
