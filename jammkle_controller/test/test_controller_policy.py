"""The jamming policy, the parameter table and the watch over the IMU."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_controller.core.events import ContactEvent, ContactKind
from jammkle_controller.core.freshness import Freshness
from jammkle_controller.core.policy import JammingPolicy, JamMode, PolicySettings
from jammkle_controller.parameters import ControllerParameters
from jammkle_graph.parameters import rows

HOLD_PA = 40e3
FULL_PA = 60e3
SECOND_NS = 1_000_000_000

delays = st.floats(0.0, 0.5)
steps = st.lists(
    st.tuples(st.integers(1_000_000, 100_000_000), st.sampled_from([None, *ContactKind])), min_size=1, max_size=60
)


def new_policy(jam_delay_s: float = 0.02) -> JammingPolicy:
    return JammingPolicy(PolicySettings(jam_delay_s, HOLD_PA, FULL_PA))


def feel(policy: JammingPolicy, kind: ContactKind, time_ns: int) -> None:
    policy.advance(time_ns)
    policy.react(ContactEvent(kind, time_ns, 1.0, "", 0.0))


@given(steps=steps, delay_s=delays)
def test_soft_until_the_delay_after_an_impact(steps: list[tuple[int, ContactKind | None]], delay_s: float) -> None:
    """For any story: soft after a lift-off, soft until `jam_delay_s` after an impact, stiff from then on, full on slip.

    The expectation is worked out from the whole story so far, not from the policy's own state.
    """
    policy = new_policy(delay_s)
    story: list[tuple[int, ContactKind]] = []
    now_ns = 0
    for step_ns, kind in steps:
        now_ns += step_ns
        policy.advance(now_ns)
        if kind is not None:
            policy.react(ContactEvent(kind, now_ns, 1.0, "", 0.0))
            story = [] if kind is ContactKind.LIFTOFF else [*story, (now_ns, kind)]
        impacts_ns = [at_ns for at_ns, what in story if what is ContactKind.IMPACT]
        if any(what is ContactKind.SLIP for _, what in story):
            assert policy.vacuum_pa == FULL_PA
        elif impacts_ns and now_ns - impacts_ns[0] >= round(delay_s * SECOND_NS):
            assert policy.vacuum_pa == HOLD_PA
        else:
            assert policy.vacuum_pa == 0.0


def test_without_a_delay_the_impact_itself_jams() -> None:
    """With jam_delay_s of zero the sample that carries the impact asks for vacuum."""
    policy = new_policy(0.0)
    feel(policy, ContactKind.IMPACT, SECOND_NS)
    assert policy.vacuum_pa == HOLD_PA


def test_slip_does_not_wait() -> None:
    """A slip while the delay after an impact is still running jams at once, at full vacuum."""
    policy = new_policy(0.5)
    feel(policy, ContactKind.IMPACT, SECOND_NS)
    feel(policy, ContactKind.SLIP, SECOND_NS + 1)
    assert policy.vacuum_pa == FULL_PA


@given(delay_s=delays, back_ns=st.integers(1, 10 * SECOND_NS), waited=st.floats(0.0, 0.99))
def test_clock_set_back_keeps_the_wish_and_the_rest_of_the_delay(delay_s: float, back_ns: int, waited: float) -> None:
    """A clock that is set back neither releases what is held nor changes how long is still to wait."""
    policy = new_policy(delay_s)
    start_ns = 20 * SECOND_NS
    delay_ns = round(delay_s * SECOND_NS)
    waited_ns = int(delay_ns * waited)
    feel(policy, ContactKind.IMPACT, start_ns)
    policy.advance(start_ns + waited_ns)
    before_pa = policy.vacuum_pa
    new_ns = start_ns + waited_ns - back_ns
    policy.advance(new_ns)
    assert policy.vacuum_pa == before_pa
    policy.advance(new_ns + delay_ns - waited_ns)
    assert policy.vacuum_pa == HOLD_PA
    policy.advance(new_ns - 5 * SECOND_NS)
    assert policy.mode is JamMode.HOLDING


def test_silence_counts_only_when_both_clocks_run() -> None:
    """The IMU is missed when both clocks advance without samples; a paused simulation is no fault."""
    freshness = Freshness(0.2, steady_s=100.0, graph_s=5.0)
    freshness.observe(10, 100.1, 5.1)
    freshness.observe(10, 103.1, 5.1)
    assert (freshness.stale, freshness.paused) == (False, True)
    freshness.observe(10, 103.2, 5.4)
    assert (freshness.stale, freshness.paused) == (True, False)
    assert freshness.silent_s == pytest.approx(3.1)
    freshness.observe(11, 103.3, 5.5)
    assert (freshness.stale, freshness.paused) == (False, False)


def test_first_reading_of_a_simulated_clock_is_no_silence() -> None:
    """A clock that jumps from zero to its first value has not run, so nothing is stale yet; later it is."""
    freshness = Freshness(0.2, steady_s=100.0, graph_s=0.0)
    freshness.observe(0, 105.0, 0.0)
    assert (freshness.stale, freshness.paused) == (False, True)
    freshness.observe(0, 105.1, 42.0)
    assert not freshness.stale
    freshness.observe(0, 105.5, 42.4)
    assert freshness.stale


def test_parameters_have_units_and_cannot_contradict() -> None:
    """Every number has a unit and a range with its default inside, and no flight threshold exceeds a touchdown one."""
    table = {row.name: row for row in rows(ControllerParameters)}
    for row in table.values():
        if isinstance(row.default, float):
            assert row.unit, row.name
            assert row.minimum is not None, row.name
            row.check(row.default)
    flight, touchdown = table["flight_threshold_m_s2"], table["touchdown_threshold_m_s2"]
    assert flight.maximum is not None
    assert touchdown.minimum is not None
    assert flight.maximum < touchdown.minimum
