"""Landings: the vacuum that a fall needs, when evacuation begins, and what is done where too little is known."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_common.names import ACHILLES, CHANNELS
from jammkle_controller.core.events import ContactEvent, ContactKind
from jammkle_controller.core.landing import RATED_KG, Evacuation, LandingModel, Stored, travel_m
from jammkle_controller.core.policy import JammingPolicy, PolicyState
from jammkle_controller.parameters import ControllerParameters, PolicyMode

HANG_RAD = 0.52
MS_NS = 1_000_000
FULL = Stored(60e3, 1e-4)
"""A reservoir that is evacuated."""
EMPTY = Stored()

speeds = st.floats(0.0, 3.0)
masses = st.floats(0.5, 20.0)


def landed(height_m: float, stored: Stored = FULL, shown_kg: float = 0.0, **changed: object) -> JammingPolicy:
    """A policy whose body fell from a height, seen as a controller sees it, at the sample of its impact."""
    policy = JammingPolicy(ControllerParameters(**{"hang_pitch_deg": math.degrees(HANG_RAD), **changed}))
    policy.stored = stored
    policy.borne_kg = shown_kg
    lasts_ms = round(1e3 * math.sqrt(2.0 * height_m / 9.80665))
    for ms in range(lasts_ms):
        policy.advance(ms * MS_NS)
        if ms == 30:
            policy.react(ContactEvent(ContactKind.LIFTOFF, ms * MS_NS, 0.0, "", 0.03))
        if ms >= 30:
            policy.fall(0)
    policy.advance(lasts_ms * MS_NS)
    policy.react(ContactEvent(ContactKind.IMPACT, lasts_ms * MS_NS, 1.0, "", 0.0))
    return policy


@given(speed=speeds, mass=masses, more=st.floats(0.0, 2.0))
def test_more_energy_never_asks_for_less_vacuum(speed: float, mass: float, more: float) -> None:
    """Faster, heavier, and with less way to give."""
    model, way_m = LandingModel(), travel_m(HANG_RAD)
    needed_pa = model.needed_pa(speed, mass, way_m)
    assert model.needed_pa(speed + more, mass, way_m) >= needed_pa
    assert model.needed_pa(speed, mass + more, way_m) >= needed_pa
    assert model.needed_pa(speed, mass, way_m * (1.0 + more)) <= needed_pa


def test_the_vacuum_that_is_needed_is_where_the_energies_meet() -> None:
    """What it returns, put into the balance of the module's docstring, makes both sides equal."""
    model, way_m, mass_kg, speed_m_s = LandingModel(), travel_m(HANG_RAD), 2.0, 1.2
    vacuum_pa = model.needed_pa(speed_m_s, mass_kg, way_m)
    assert model.onset_pa < vacuum_pa < 60e3
    jammed_n = 1.0 - math.exp(-(vacuum_pa - model.onset_pa) / model.saturation_pa)
    jammed_n *= model.friction_n_per_pa * model.saturation_pa
    work_j = model.stiffness_n_m * way_m**2 + jammed_n * way_m
    energy_j = mass_kg * (speed_m_s**2 / 2.0 + 9.80665 * model.sinking_m)
    assert work_j == pytest.approx(energy_j)


def test_what_is_stored_comes_in_the_time_of_the_valves() -> None:
    """All three channels to 40 kPa as the driver's law has it: 73 ms with 100 mL at 60 kPa, 0.29 s without."""
    with_it, without = (Evacuation.of(each, achilles_alone=False) for each in (FULL, EMPTY))
    assert with_it.until_s(40e3) == pytest.approx(0.073, abs=0.01)
    assert without.until_s(40e3) == pytest.approx(0.288, abs=0.02)
    assert Evacuation.of(FULL, achilles_alone=True).until_s(40e3) < with_it.until_s(40e3)


def test_a_small_fall_is_met_softer_than_a_great_one() -> None:
    """20 mm need nothing, 100 mm nearly what the stance holds; that is reached half-way through the blow."""
    small, great = landed(0.02).landing, landed(0.1).landing
    assert small.chosen_pa < 20e3 < great.chosen_pa
    assert small.reached_pa < great.reached_pa
    assert great.reached_pa >= great.chosen_pa - 2.5e3


def test_a_slope_that_is_known_is_met_softer() -> None:
    """It rises toward the toes, and gives more way; one that is not known is level."""
    level, slope = landed(0.1).landing, landed(0.1, slope_deg=12.0).landing
    assert slope.chosen_pa < 0.8 * level.chosen_pa


def test_the_load_that_was_measured_counts_if_it_is_more() -> None:
    """What load cell or efforts have shown of a stance, and not less than the ankle is rated for."""
    rated, light, heavy = (landed(0.06, shown_kg=shown_kg).landing for shown_kg in (0.0, 0.9, 2.5))
    assert light == rated
    assert heavy.chosen_pa > 1.5 * rated.chosen_pa
    assert "with 2.5 kg" in heavy.why


def test_with_vacuum_in_store_the_achilles_pair_is_evacuated_alone() -> None:
    """It bears a landing on toes; without a store all are, as those that come later would draw from it."""
    wanted_pa = landed(0.1).set_points_pa
    assert wanted_pa[ACHILLES] > 0.0
    assert {wanted_pa[channel] for channel in CHANNELS if channel != ACHILLES} == {0.0}
    assert len(set(landed(0.1, EMPTY).set_points_pa.values())) == 1


def test_after_the_shock_it_holds_and_a_lift_off_vents() -> None:
    """All channels, with no less than was chosen; in the air all are soft again."""
    policy = landed(0.1)
    now_ns = 1000 * MS_NS
    policy.advance(now_ns)
    assert policy.state is PolicyState.STANCE
    assert set(policy.set_points_pa.values()) == {max(policy.parameters.hold_vacuum_pa, *policy.set_points_pa.values())}
    policy.react(ContactEvent(ContactKind.LIFTOFF, now_ns, 0.0, "", 0.0))
    assert set(policy.set_points_pa.values()) == {0.0}


def test_a_pump_that_is_late_says_what_was_reached_and_goes_on_with_full_vacuum() -> None:
    """Nothing in store, and 100 mm: less than was chosen, and full vacuum from the blow on."""
    policy = landed(0.1, EMPTY)
    assert policy.landing.reached_pa < policy.landing.chosen_pa
    assert "too short a time" in policy.landing.why
    assert set(policy.set_points_pa.values()) == {policy.parameters.full_vacuum_pa}


def test_ten_times_the_rated_payload_is_as_stiff_as_it_gets() -> None:
    """And it says that the heel may strike."""
    policy = landed(0.05, load_kg=10.0 * RATED_KG)
    assert policy.landing.chosen_pa == policy.parameters.full_vacuum_pa
    assert "more than the ankle takes" in policy.landing.why


def test_a_blow_that_nothing_foresaw_jams_at_once() -> None:
    """Toes were hit and no fall was seen: it does not wait for the shock to pass, and says so."""
    policy = JammingPolicy(ControllerParameters(hang_pitch_deg=math.degrees(HANG_RAD)))
    policy.advance(0)
    policy.react(ContactEvent(ContactKind.IMPACT, 0, 1.0, "", 0.0))
    assert policy.state is PolicyState.STANCE
    assert policy.landing.surprised
    assert policy.landing.why == "nothing foresaw it: met as it was, and jammed at once"
    flat = JammingPolicy(ControllerParameters())
    flat.advance(0)
    flat.react(ContactEvent(ContactKind.IMPACT, 0, 1.0, "", 0.0))
    assert flat.landing.why == "a foot that hangs flat has no way to give: met as it was"  # a fall may have been seen
    assert flat.state is PolicyState.LANDING  # a flat foot has no way to lose: it waits, as ever


def test_a_fall_counts_more_than_a_plan() -> None:
    """A gait that plans the foot in the air for another second does not keep a fall from being met."""
    policy = JammingPolicy(ControllerParameters(hang_pitch_deg=math.degrees(HANG_RAD)))
    policy.stored = FULL
    for ms in range(140):
        policy.foresee(1_000 * MS_NS)
        policy.advance(ms * MS_NS)
        if ms >= 30:
            policy.fall(0)
    assert policy.state is PolicyState.PREPARING


@pytest.mark.parametrize(("planned_ms", "said"), [(600, "300 ms earlier than"), (100, "200 ms later than")])
def test_a_plan_that_lies_is_a_surprise_and_named(planned_ms: int, said: str) -> None:
    """A foot that hits while its plan has it in the air, or long after it was to touch down, is jammed at once."""
    policy = JammingPolicy(ControllerParameters(hang_pitch_deg=math.degrees(HANG_RAD)))
    policy.stored = FULL
    soft_ms = 0
    for ms in range(300):
        if ms < planned_ms:
            policy.foresee(planned_ms * MS_NS)
        policy.advance(ms * MS_NS)
        soft_ms += not any(policy.set_points_pa.values())
    assert policy.state is PolicyState.SWING  # not yet prepared, or given up
    assert soft_ms > 100
    policy.react(ContactEvent(ContactKind.IMPACT, 300 * MS_NS, 1.0, "", 0.0))
    assert policy.state is PolicyState.STANCE
    assert set(policy.set_points_pa.values()) == {policy.parameters.hold_vacuum_pa}
    assert policy.landing.surprised
    assert said in policy.landing.why
    assert policy.landing.time_ns == 300 * MS_NS


def test_a_fixed_policy_meets_every_landing_with_one_vacuum() -> None:
    """In the air and at the blow; the stance is held with no less than ever."""
    policy = landed(0.1, policy=PolicyMode.FIXED.value, landing_vacuum_pa=20e3)
    assert set(policy.set_points_pa.values()) == {20e3}
    policy.advance(1000 * MS_NS)
    assert set(policy.set_points_pa.values()) == {policy.parameters.hold_vacuum_pa}


@pytest.mark.parametrize(
    ("mode", "vacuum_pa"), [(PolicyMode.FIXED, 20e3), (PolicyMode.ALWAYS_SOFT, 0.0), (PolicyMode.ALWAYS_JAMMED, 40e3)]
)
def test_a_baseline_says_what_it_meets_a_landing_with(mode: PolicyMode, vacuum_pa: float) -> None:
    """Not what the policy would have chosen, and that it came too late for it: nothing was evacuated for this fall."""
    landing = landed(0.1, policy=mode.value, landing_vacuum_pa=20e3).landing
    assert (landing.chosen_pa, landing.reached_pa) == (vacuum_pa, vacuum_pa)
    assert landing.why == f"policy is {mode.value}: the vacuum is the same for every landing"
