"""The jamming policy, the parameter table and the watch over the IMU."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_common.names import CHANNELS
from jammkle_common.parameters import rows
from jammkle_controller.core.detector import TOUCHDOWN_M_S2
from jammkle_controller.core.events import ContactEvent, ContactKind
from jammkle_controller.core.imu import Freshness, StreamCounts
from jammkle_controller.core.landing import Evacuation, Stored
from jammkle_controller.core.policy import (
    MEANINGS,
    SET_POINTS,
    TRANSITIONS,
    JammingPolicy,
    PolicyState,
    Trigger,
)
from jammkle_controller.parameters import ControllerParameters, PolicyMode

BACK = (-1.0, 0.0, 0.0)
HOLD_PA = 40e3
FULL_PA = 60e3
SECOND_NS = 1_000_000_000
MS_NS = 1_000_000

delays = st.floats(0.0, 0.5)
steps = st.lists(
    st.tuples(st.integers(1_000_000, 100_000_000), st.sampled_from([None, *ContactKind])), min_size=1, max_size=60
)


def new_policy(jam_delay_s: float = 0.02, **changed: object) -> JammingPolicy:
    return JammingPolicy(
        ControllerParameters(jam_delay_s=jam_delay_s, hold_vacuum_pa=HOLD_PA, full_vacuum_pa=FULL_PA, **changed)
    )


def feel(policy: JammingPolicy, kind: ContactKind, time_ns: int, direction: tuple[float, float, float] = BACK) -> None:
    policy.advance(time_ns)
    policy.react(ContactEvent(kind, time_ns, 1.0, "", 0.0, direction=direction))


def everywhere(vacuum_pa: float) -> dict[str, float]:
    return dict.fromkeys(CHANNELS, vacuum_pa)


@given(steps=steps, delay_s=delays)
def test_soft_until_the_delay_after_an_impact(steps: list[tuple[int, ContactKind | None]], delay_s: float) -> None:
    """For any recording: soft in the air, soft until `jam_delay_s` after an impact, stiff then, and full after a slip.

    The expectation is worked out from the whole recording so far, not from the policy's own state.
    """
    policy = new_policy(delay_s, side_first_s=0.0)
    recording: list[tuple[int, ContactKind]] = []
    now_ns = 0
    for step_ns, kind in steps:
        now_ns += step_ns
        policy.advance(now_ns)
        if kind is not None:
            policy.react(ContactEvent(kind, now_ns, 1.0, "", 0.0))
            lifts = kind in (ContactKind.LIFTOFF, ContactKind.SWING)
            recording = [] if lifts else [*recording, (now_ns, kind)]
        impacts_ns = [at_ns for at_ns, what in recording if what is ContactKind.IMPACT]
        slips_ns = [at_ns for at_ns, what in recording if what is ContactKind.SLIP]
        if slips_ns and now_ns - slips_ns[-1] < 2.5 * SECOND_NS:
            assert policy.set_points_pa == everywhere(FULL_PA)
        elif slips_ns:
            assert set(policy.set_points_pa.values()) <= {HOLD_PA, FULL_PA}
        elif impacts_ns and now_ns - impacts_ns[0] >= round(delay_s * SECOND_NS):
            assert policy.set_points_pa == everywhere(HOLD_PA)
        else:
            assert policy.set_points_pa == everywhere(0.0)


def test_a_slip_finds_more_vacuum_and_it_ends() -> None:
    """A slip in a stance asks for full vacuum at once, through slipping and recovering, and then for the stance's."""
    policy = new_policy()
    feel(policy, ContactKind.IMPACT, SECOND_NS)
    policy.advance(SECOND_NS + 20 * MS_NS)
    assert policy.set_points_pa == everywhere(HOLD_PA)
    feel(policy, ContactKind.SLIP, 2 * SECOND_NS)
    assert (policy.state, policy.set_points_pa) == (PolicyState.SLIPPING, everywhere(FULL_PA))
    policy.advance(2 * SECOND_NS + 500 * MS_NS)
    assert (policy.state, policy.set_points_pa) == (PolicyState.RECOVERING, everywhere(FULL_PA))
    policy.advance(4 * SECOND_NS + 500 * MS_NS)
    assert (policy.state, policy.set_points_pa) == (PolicyState.STANCE, everywhere(HOLD_PA))


@pytest.mark.parametrize(
    ("direction", "first"),
    [(BACK, "achilles"), ((0.1, 0.9, 0.0), "peroneal_left"), ((0.1, -0.9, 0.0), "peroneal_right")],
)
def test_the_side_that_slips_jams_first(direction: tuple[float, float, float], first: str) -> None:
    """From soft, the tendon that friction stretches is jammed alone for side_first_s, and the others follow."""
    policy = new_policy(0.5)
    feel(policy, ContactKind.IMPACT, SECOND_NS)
    feel(policy, ContactKind.SLIP, SECOND_NS + 1, direction)
    assert policy.set_points_pa == {**everywhere(0.0), first: FULL_PA}
    policy.advance(SECOND_NS + 100 * MS_NS + 1)
    assert policy.set_points_pa == everywhere(FULL_PA)


def test_a_foreseen_touch_down_is_prepared_and_given_up() -> None:
    """Evacuation begins so that fibres grip as it touches, and holds from there on; if none comes, it is soft again."""
    policy = new_policy()
    lead_ns = round(Evacuation.of(Stored(), achilles_alone=False).until_s(8e3) * SECOND_NS)
    policy.advance(0)
    policy.foresee(SECOND_NS)
    policy.advance(SECOND_NS - lead_ns - MS_NS)
    assert policy.set_points_pa == everywhere(0.0)
    policy.advance(SECOND_NS - lead_ns)
    assert (policy.state, policy.set_points_pa) == (PolicyState.PREPARING, everywhere(HOLD_PA))
    policy.advance(SECOND_NS + 151 * MS_NS)
    assert (policy.state, policy.set_points_pa) == (PolicyState.SWING, everywhere(0.0))
    policy.foresee(2 * SECOND_NS)
    policy.advance(2 * SECOND_NS)
    feel(policy, ContactKind.IMPACT, 2 * SECOND_NS + 5 * MS_NS)
    assert (policy.state, policy.set_points_pa) == (PolicyState.LANDING, everywhere(HOLD_PA))
    policy.advance(2 * SECOND_NS + 25 * MS_NS)
    assert (policy.state, policy.set_points_pa) == (PolicyState.STANCE, everywhere(HOLD_PA))


@given(steps=steps, baseline=st.sampled_from([(PolicyMode.ALWAYS_SOFT, 0.0), (PolicyMode.ALWAYS_JAMMED, HOLD_PA)]))
def test_the_baselines_feel_nothing(
    steps: list[tuple[int, ContactKind | None]], baseline: tuple[PolicyMode, float]
) -> None:
    """Always soft is soft, and always jammed is jammed, whatever is felt."""
    mode, vacuum_pa = baseline
    policy = new_policy(policy=mode.value)
    now_ns = 0
    for step_ns, kind in steps:
        now_ns += step_ns
        policy.advance(now_ns)
        if kind is not None:
            policy.react(ContactEvent(kind, now_ns, 1.0, "", 0.0))
        assert policy.set_points_pa == everywhere(vacuum_pa)


def test_every_state_can_be_left_and_the_table_is_whole() -> None:
    """Each state wants something, is explained, is reached, and leads to SWING or STANCE; a lift-off always vents."""
    assert set(SET_POINTS) == set(MEANINGS) == set(PolicyState)
    assert {state for state, _ in TRANSITIONS} == set(PolicyState)
    assert set(TRANSITIONS.values()) == set(PolicyState)
    for state in set(PolicyState) - {PolicyState.SWING, PolicyState.FAULT}:
        assert TRANSITIONS[state, Trigger.LIFTOFF] is PolicyState.SWING
        assert TRANSITIONS[state, Trigger.LOST] is PolicyState.FAULT


@pytest.mark.parametrize("stands", [True, False])
def test_in_a_fault_the_set_points_is_kept(stands: bool) -> None:  # noqa: FBT001
    """Where nothing shows contact, what is jammed stays jammed and what is soft stays soft; events are void."""
    policy = new_policy(0.0)
    if stands:
        feel(policy, ContactKind.IMPACT, SECOND_NS)
    before = dict(policy.set_points_pa)
    policy.lose()
    assert policy.state is PolicyState.FAULT
    for kind in ContactKind:
        feel(policy, kind, 2 * SECOND_NS)
        assert policy.set_points_pa == before
    policy.regain()
    assert policy.state is (PolicyState.STANCE if stands else PolicyState.SWING)


@given(delay_s=delays, back_ns=st.integers(1, 10 * SECOND_NS), waited=st.floats(0.0, 0.99))
def test_clock_set_back_keeps_the_set_points_and_the_rest_of_the_delay(
    delay_s: float, back_ns: int, waited: float
) -> None:
    """A clock that is set back neither releases what is held nor changes how long is still to wait."""
    policy = new_policy(delay_s)
    start_ns = 20 * SECOND_NS
    delay_ns = round(delay_s * SECOND_NS)
    waited_ns = int(delay_ns * waited)
    feel(policy, ContactKind.IMPACT, start_ns)
    policy.advance(start_ns + waited_ns)
    before = dict(policy.set_points_pa)
    new_ns = start_ns + waited_ns - back_ns
    policy.advance(new_ns)
    assert policy.set_points_pa == before
    policy.advance(new_ns + delay_ns - waited_ns)
    assert policy.set_points_pa == everywhere(HOLD_PA)
    policy.advance(new_ns - 5 * SECOND_NS)
    assert policy.state is PolicyState.STANCE


def test_clock_set_back_gives_up_what_is_prepared() -> None:
    """A touch-down that was foreseen by the clock of before is not waited for in the air; the next one is foreseen."""
    policy = new_policy()
    policy.advance(20 * SECOND_NS)
    policy.foresee(20 * SECOND_NS + MS_NS)
    policy.advance(20 * SECOND_NS + MS_NS)
    assert (policy.state, policy.set_points_pa) == (PolicyState.PREPARING, everywhere(HOLD_PA))
    policy.advance(20 * SECOND_NS - 20 * MS_NS)  # an IMU that comes some ms late, after the node's own clock
    assert policy.state is PolicyState.PREPARING
    policy.advance(SECOND_NS)
    assert (policy.state, policy.set_points_pa) == (PolicyState.SWING, everywhere(0.0))
    policy.foresee(2 * SECOND_NS)
    policy.advance(2 * SECOND_NS)
    assert policy.state is PolicyState.PREPARING


@pytest.mark.parametrize(
    ("begin_s", "seen"),
    [
        (5.0, [(10, 5.1, False), (10, 5.1, False), (10, 5.4, True), (11, 5.5, False)]),
        (0.0, [(0, 0.0, False), (0, 42.0, False), (0, 42.4, True)]),
    ],
    ids=["a clock that runs", "a simulated one that begins"],
)
def test_silence_counts_in_the_time_that_the_ankle_lives_in(
    begin_s: float, seen: list[tuple[int, float, bool]]
) -> None:
    """The IMU is missed when time goes on without samples; not where time stands, or jumps from zero to its start."""
    freshness = Freshness(0.2, now_s=begin_s)
    for usable, now_s, stale in seen:
        freshness.observe(StreamCounts(usable=usable), now_s)
        assert freshness.stale is stale
        assert not stale or freshness.silent_s == pytest.approx(now_s - seen[1][1])


def test_parameters_have_units_and_cannot_contradict() -> None:
    """Every number has a unit and a range with its default inside, and no flight threshold exceeds a touchdown one."""
    table = {row.name: row for row in rows(ControllerParameters)}
    for row in table.values():
        if isinstance(row.default, float):
            assert row.unit, row.name
            assert row.minimum is not None, row.name
            row.check(row.default)
    assert (table["flight_threshold_m_s2"].maximum or 0.0) < TOUCHDOWN_M_S2
    assert len(table) <= 35
