"""Contact detection on synthetic IMU streams."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.detector import Phase
from jammkle_controller.core.events import ContactEvent, ContactKind
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.parameters import ControllerParameters, detector_settings, policy_settings

LANDING = [ContactKind.LIFTOFF, ContactKind.IMPACT, ContactKind.SETTLED]
GRAVITY_M_S2 = 9.80665
# Natural frequency, rad/s, and damping ratio: peaks of about 40 m/s^2 (soft) and beyond the clip (hard).
SOFT = (40.0, 0.5)
SPRINGY = (40.0, 0.15)
HARD = (150.0, 0.9)

few = settings(max_examples=30, deadline=None)
seeds = st.integers(0, 2**32 - 1)


def new_controller() -> AnkleController:
    values = ControllerParameters()
    return AnkleController(detector_settings(values), policy_settings(values))


def events_of(samples: list[ImuSample], controller: AnkleController | None = None) -> list[ContactEvent]:
    controller = controller or new_controller()
    return [event for sample in samples for event in controller.update(sample).events]


def kinds_of(samples: list[ImuSample]) -> list[ContactKind]:
    return [event.kind for event in events_of(samples)]


def any_rotation(seed: int) -> Any:
    """Return a rotation matrix, uniform over all rotations (QR of a Gaussian matrix)."""
    turn, upper = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return turn * np.sign(np.diag(upper))


def any_direction(seed: int) -> Any:
    direction = np.random.default_rng(seed).normal(size=3)
    return direction / np.linalg.norm(direction)


@pytest.mark.parametrize("rate_hz", [500, 1000])
@pytest.mark.parametrize("foot", [SOFT, HARD])
def test_landing_is_one_liftoff_one_impact_one_rest(streams: Any, foot: tuple[float, float], rate_hz: int) -> None:
    """A drop gives LIFTOFF, IMPACT, SETTLED; the impact within two samples and the filter's 2 ms of the contact."""
    force, contact_s = streams.drop(*foot)
    events = events_of(streams.sense(force, rate_hz))
    assert [event.kind for event in events] == LANDING
    impact = events[1]
    assert 0.0 <= impact.time_ns * 1e-9 - contact_s <= 2 / rate_hz + 0.002
    assert 0.0 <= impact.detection_delay_s <= 2 / rate_hz
    assert impact.magnitude >= 3.0
    assert impact.unit == "m/s^2"


def test_springy_landing_without_damper_is_still_caught_early(streams: Any) -> None:
    """With no step in the force at all (a spring alone), the impact is seen in under 5 ms: 4 mm of travel."""
    force, contact_s = streams.drop(40.0, 0.0)
    impact = next(event for event in events_of(streams.sense(force)) if event.kind is ContactKind.IMPACT)
    assert 0.0 < impact.time_ns * 1e-9 - contact_s < 0.005


def test_bounces_alternate_between_flight_and_impact(streams: Any) -> None:
    """A bouncing leg gives LIFTOFF and IMPACT in turn, more than once, and ends with an impact and rest."""
    kinds = kinds_of(streams.sense(streams.drop(*SPRINGY)[0]))
    assert kinds.count(ContactKind.IMPACT) >= 2
    assert kinds[:-1] == [ContactKind.LIFTOFF, ContactKind.IMPACT] * (len(kinds) // 2)
    assert kinds[-1] is ContactKind.SETTLED


@few
@given(seed=seeds)
def test_tilt_of_the_imu_does_not_matter(streams: Any, seed: int) -> None:
    """Mounted in any rotation, the IMU tells the same events within two samples."""
    force, _ = streams.drop(*HARD)
    upright = events_of(streams.sense(force, 500))
    tilted = events_of(streams.sense(force, 500, turn=any_rotation(seed)))
    assert [event.kind for event in tilted] == [event.kind for event in upright]
    for one, other in zip(tilted[:2], upright[:2], strict=True):
        assert abs(one.time_ns - other.time_ns) <= 4_000_000


@few
@given(shift_ns=st.integers(0, 2**62))
def test_origin_of_the_clock_does_not_matter(streams: Any, shift_ns: int) -> None:
    """Stamps shifted by any time shift the events by just that, to the nanosecond, and nothing else."""
    samples = streams.sense(streams.drop(*SOFT)[0], 500)
    shifted = [sample._replace(time_ns=sample.time_ns + shift_ns) for sample in samples]
    for one, other in zip(events_of(samples), events_of(shifted), strict=True):
        assert other.time_ns - one.time_ns == shift_ns
        assert (other.kind, other.magnitude, other.detection_delay_s) == (
            one.kind,
            one.magnitude,
            one.detection_delay_s,
        )


@pytest.mark.parametrize("foot", [SOFT, SPRINGY, HARD])
def test_rate_does_not_matter(streams: Any, foot: tuple[float, float]) -> None:
    """500 Hz and 1 kHz tell the same events, flights and impacts within two samples of the slower one."""
    force, _ = streams.drop(*foot)
    slow, fast = events_of(streams.sense(force, 500)), events_of(streams.sense(force, 1000))
    assert [event.kind for event in slow] == [event.kind for event in fast]
    for one, other in zip(slow[:-1], fast[:-1], strict=True):
        assert abs(one.time_ns - other.time_ns) <= 4_000_000


@few
@given(
    amplitude_m_s2=st.floats(0.0, 5.8),
    frequency_hz=st.floats(30.0, 200.0),
    turn=seeds,
    way=seeds,
    rate_hz=st.sampled_from([500, 1000]),
)
def test_walking_vibration_raises_no_alarm(
    streams: Any, amplitude_m_s2: float, frequency_hz: float, turn: int, way: int, rate_hz: int
) -> None:
    """From rest, vibration of up to 6 m/s^2 at 30 Hz and above, in any direction and tilt, is no event."""
    force = streams.rest(1.3)
    time_s = streams.time_s(force)
    shake = np.where(time_s > 0.3, amplitude_m_s2 * np.sin(2.0 * math.pi * frequency_hz * (time_s - 0.3)), 0.0)
    force += shake[:, None] * any_direction(way)
    assert events_of(streams.sense(force, rate_hz, turn=any_rotation(turn))) == []


@few
@given(amplitude_m_s2=st.floats(0.0, 5.8), frequency_hz=st.floats(0.5, 30.0), way=seeds)
def test_slow_strong_motion_is_no_impact_and_no_flight(
    streams: Any, amplitude_m_s2: float, frequency_hz: float, way: int
) -> None:
    """At any frequency, |specific force| within g +- 6 m/s^2 is neither an impact nor a lift-off."""
    force = streams.rest(2.0)
    shake = amplitude_m_s2 * np.sin(2.0 * math.pi * frequency_hz * streams.time_s(force))
    force += shake[:, None] * any_direction(way)
    assert not {ContactKind.IMPACT, ContactKind.LIFTOFF} & set(kinds_of(streams.sense(force, 500)))


@few
@given(
    amplitude_m_s2=st.floats(0.0, 0.55), frequency_hz=st.floats(0.2, 30.0), tilt_rad_s=st.floats(-0.3, 0.3), way=seeds
)
def test_gentle_motion_raises_no_alarm(
    streams: Any, amplitude_m_s2: float, frequency_hz: float, tilt_rad_s: float, way: int
) -> None:
    """Swaying by up to 0.55 m/s^2 at any frequency while tilting at up to 0.3 rad/s is no event."""
    force = streams.rest(2.0)
    time_s = streams.time_s(force)
    moving_s = np.maximum(time_s - 0.5, 0.0)
    force += (amplitude_m_s2 * np.sin(2.0 * math.pi * frequency_hz * moving_s))[:, None] * any_direction(way)
    angle = tilt_rad_s * moving_s
    # The body turns about x by +angle, so the fixed world turns about x by -angle in its frame.
    y, z = force[:, 1].copy(), force[:, 2].copy()
    force[:, 1], force[:, 2] = np.cos(angle) * y + np.sin(angle) * z, np.cos(angle) * z - np.sin(angle) * y
    gyro = np.zeros_like(force)
    gyro[:, 0] = np.where(time_s > 0.5, tilt_rad_s, 0.0)
    assert events_of(streams.sense(force, 500, gyro=gyro)) == []


@pytest.mark.parametrize("rate_hz", [500, 1000])
def test_noise_alone_is_silent_for_minutes(streams: Any, rate_hz: int) -> None:
    """Three minutes of sensor noise at rest give no event at all."""
    controller = new_controller()
    assert events_of(streams.sense(streams.rest(180.0), rate_hz), controller) == []
    assert controller.phase is Phase.PLANTED


def sliding(streams: Any, slope_rad: float, friction: float, slides_s: float = 0.3) -> Any:
    """Stand on a slope for 0.5 s, then slide down it with Coulomb friction; the leg stays upright."""
    force = streams.rest(0.5 + slides_s)
    downhill = GRAVITY_M_S2 * (math.sin(slope_rad) - friction * math.cos(slope_rad))
    force[streams.time_s(force) >= 0.5] += downhill * np.array([math.cos(slope_rad), 0.0, -math.sin(slope_rad)])
    return force


@few
@given(friction=st.floats(0.2, 0.6), turn=seeds, rate_hz=st.sampled_from([500, 1000]))
def test_sliding_down_a_slope_is_one_slip(streams: Any, friction: float, turn: int, rate_hz: int) -> None:
    """Sliding down 40 deg is told as one SLIP within 0.1 s and 10 mm of its beginning, and as nothing else."""
    slope = math.radians(40.0)
    events = events_of(streams.sense(sliding(streams, slope, friction), rate_hz, turn=any_rotation(turn)))
    assert [event.kind for event in events] == [ContactKind.SLIP]
    after_s = events[0].time_ns * 1e-9 - 0.5
    assert 0.0 < after_s < 0.1
    assert 0.5 * GRAVITY_M_S2 * (math.sin(slope) - friction * math.cos(slope)) * after_s**2 < 0.01
    assert events[0].magnitude > 0.06
    assert 0.0 < events[0].detection_delay_s <= after_s + 0.002
    assert events[0].unit == "m/s"


def test_pushing_off_is_no_slip(streams: Any) -> None:
    """A leg at rest that pushes itself up at 5 m/s^2 does not slide."""
    force = streams.rest(0.7)
    force[streams.time_s(force) >= 0.5, 2] += 5.0
    assert events_of(streams.sense(force)) == []


@few
@given(data=st.data())
def test_bad_samples_change_nothing_but_the_counts(streams: Any, data: st.DataObject) -> None:
    """NaN, infinite, repeated and late samples strewn into a landing are counted and decide nothing."""
    samples = streams.sense(streams.drop(*HARD)[0], 500)
    places = data.draw(st.lists(st.integers(10, len(samples) - 1), max_size=20, unique=True))
    spoilt = list(samples)
    for place in sorted(places, reverse=True):
        good = samples[place]
        bad = data.draw(
            st.sampled_from(
                [
                    good._replace(time_ns=good.time_ns + 1, force_x=math.nan),
                    good._replace(time_ns=good.time_ns + 1, rate_z=math.inf),
                    good._replace(force_z=400.0),
                    good._replace(time_ns=good.time_ns - 5_000_000, force_z=400.0),
                ]
            )
        )
        spoilt.insert(place + 1, bad)
    controller = new_controller()
    assert events_of(spoilt, controller) == events_of(samples)
    assert controller.gate.counts.ignored == len(places)
    assert controller.gate.counts.usable == len(samples)


@few
@given(seed=seeds, loss=st.floats(0.0, 0.3), jitter_s=st.floats(0.0, 0.0009))
def test_dropped_and_jittered_samples_tell_the_same_story(
    streams: Any, seed: int, loss: float, jitter_s: float
) -> None:
    """With up to 30 % of the samples lost and stamps off by up to 0.9 ms, a landing is still the same three events."""
    chance = np.random.default_rng(seed)
    force, contact_s = streams.drop(*SOFT)
    samples = [
        sample._replace(time_ns=sample.time_ns + 1_000_000 + round(chance.uniform(-jitter_s, jitter_s) * 1e9))
        for sample in streams.sense(force, 500)
        if chance.uniform() >= loss
    ]
    events = events_of(samples)
    assert [event.kind for event in events] == LANDING
    assert -0.001 <= events[1].time_ns * 1e-9 - contact_s < 0.02


def test_restarted_clock_starts_a_new_story(streams: Any) -> None:
    """When the stamps jump back to zero in mid-air, the landing that follows is told like the first one."""
    samples = streams.sense(streams.drop(*SOFT)[0], 500)
    controller = new_controller()
    in_the_air = next(i for i, sample in enumerate(samples) if sample.time_ns >= 380_000_000)
    assert [event.kind for event in events_of(samples[:in_the_air], controller)] == [ContactKind.LIFTOFF]
    assert events_of(samples, controller) == events_of(samples)
    assert controller.gate.counts.restarts == 1


def test_landing_lost_in_a_gap_is_still_told(streams: Any) -> None:
    """If the stream breaks off in mid-air and comes back on the ground, its first sample is the impact."""
    samples = streams.sense(streams.drop(*SOFT)[0], 500)
    broken = [sample for sample in samples if not 0.39 < sample.time_ns * 1e-9 < 0.7]
    impact = events_of(broken)[1]
    assert impact.kind is ContactKind.IMPACT
    assert impact.time_ns == next(sample.time_ns for sample in broken if sample.time_ns > 600_000_000)


def test_gap_at_rest_is_no_event(streams: Any) -> None:
    """Half a second without samples while the body is tilted by 40 deg is neither slip nor impact."""
    before = streams.sense(streams.rest(0.5), 500)
    turn = np.array([[math.cos(0.7), 0.0, math.sin(0.7)], [0.0, 1.0, 0.0], [-math.sin(0.7), 0.0, math.cos(0.7)]])
    after = streams.sense(streams.rest(0.5), 500, turn=turn)
    assert events_of(before + [sample._replace(time_ns=sample.time_ns + 1_000_000_000) for sample in after]) == []


@few
@given(force=st.lists(st.floats(-90.0, 90.0), min_size=1, max_size=300), step_ns=st.integers(200_000, 20_000_000))
def test_every_flight_ends_with_an_impact(force: list[float], step_ns: int) -> None:
    """On any stream at all, two lift-offs have an impact between them, and ground impacts keep the refractory time."""
    events = events_of([ImuSample(i * step_ns, 0.0, 0.0, value, 0.0, 0.0, 0.0) for i, value in enumerate(force)])
    flying = False
    last_ns = -(10**12)
    for event in events:
        if event.kind is ContactKind.LIFTOFF:
            assert not flying
            flying = True
        elif event.kind is ContactKind.IMPACT:
            assert flying or event.time_ns - last_ns >= 150_000_000
            flying = False
            last_ns = event.time_ns
