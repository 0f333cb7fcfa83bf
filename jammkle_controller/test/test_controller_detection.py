"""Contact detection on synthetic IMU streams."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.detector import ContactDetector
from jammkle_controller.core.events import REASONS, ContactKind, Detection, Phase, not_felt
from jammkle_controller.core.motion import Motion
from jammkle_controller.core.stepping import SoleFilter, learned
from jammkle_controller.parameters import ControllerParameters, Mount

LANDING = [ContactKind.LIFTOFF, ContactKind.IMPACT, ContactKind.SETTLED]
GRAVITY_M_S2 = 9.80665
# Natural frequency, rad/s, and damping ratio: peaks of about 40 m/s^2 (soft) and beyond the clip (hard).
SOFT = (40.0, 0.5)
SPRINGY = (40.0, 0.15)
HARD = (150.0, 0.9)

few = settings(max_examples=30, deadline=None)
seeds = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("rate_hz", [500, 1000])
@pytest.mark.parametrize("foot", [SOFT, HARD])
def test_landing_is_one_liftoff_one_impact_one_rest(streams: Any, foot: tuple[float, float], rate_hz: int) -> None:
    """A drop gives LIFTOFF, IMPACT, SETTLED; the impact within two samples and the filter's 2 ms of the contact."""
    force, contact_s = streams.drop(*foot)
    events = streams.events_of(streams.sense(force, rate_hz))
    assert [event.kind for event in events] == LANDING
    impact = events[1]
    assert 0.0 <= impact.time_ns * 1e-9 - contact_s <= 2 / rate_hz + 0.002
    assert 0.0 <= impact.detection_delay_s <= 2 / rate_hz
    assert impact.magnitude >= 3.0
    assert impact.unit == "m/s^2"


def test_a_body_that_another_foot_has_caught_is_no_impact_of_a_foot_that_is_in_the_air(streams: Any) -> None:
    """Of a foot that hangs toe-down its ankle ends the flight, where it is read, not the landing of the body."""
    force, contact_s = streams.drop(*SOFT)
    for borne, expected in ((False, [ContactKind.LIFTOFF]), (None, LANDING), (True, LANDING)):
        detector, kinds = ContactDetector(ControllerParameters(imu_mount=Mount.BODY.value, hang_pitch_deg=30.0)), []
        for sample in streams.sense(force):
            if detector.phase is Phase.FLIGHT and sample.time_ns * 1e-9 > contact_s - 0.01:
                detector.bear(borne, sample.time_ns)
            event = detector.update(sample)
            if event is not None:
                kinds.append(event.kind)
        assert kinds[: len(expected)] == expected
        if borne is False:
            assert ContactKind.IMPACT not in kinds
            assert detector.phase is Phase.SWING
            detector.bear(True, sample.time_ns)  # noqa: FBT003 - it touches, too
            assert detector.phase is not Phase.SWING


def test_springy_landing_without_damper_is_still_caught_early(streams: Any) -> None:
    """With no step in the force at all (a spring alone), the impact is seen in under 5 ms: 4 mm of travel."""
    force, contact_s = streams.drop(40.0, 0.0)
    impact = next(event for event in streams.events_of(streams.sense(force)) if event.kind is ContactKind.IMPACT)
    assert 0.0 < impact.time_ns * 1e-9 - contact_s < 0.005


@few
@given(peak_m_s2=st.floats(18.0, 60.0), turn=seeds, rate_hz=st.sampled_from([500, 1000]))
def test_kick_on_the_ground_is_one_impact(streams: Any, peak_m_s2: float, turn: int, rate_hz: int) -> None:
    """A push of 18 m/s^2 and more within 10 ms, without any flight, is one IMPACT before its peak has passed, and rest.

    The delay it states is the time since the push rose above the noise: some ms, and not more than really passed.
    """
    events = streams.events_of(
        streams.sense(streams.kick(0.5, peak_m_s2, 0.01), rate_hz, turn=streams.any_rotation(turn))
    )
    assert [event.kind for event in events] == [ContactKind.IMPACT, ContactKind.SETTLED]
    after_s = events[0].time_ns * 1e-9 - 0.5
    assert 0.0 < after_s < 0.005 + 0.002 + 1 / rate_hz
    assert after_s - 2 / rate_hz - 0.001 <= events[0].detection_delay_s < after_s
    assert 6.0 < events[0].magnitude < peak_m_s2 + 1.0


def test_strike_after_a_dip_is_measured_from_the_dip(streams: Any) -> None:
    """A foot that is unloaded for 8 ms, too short for a flight, and then carries 20 m/s^2 has been hit."""
    force = streams.rest(1.0)
    time_s = streams.time_s(force)
    force[(time_s > 0.5) & (time_s < 0.508), 2] = 1.0
    force[(time_s > 0.508) & (time_s < 0.518), 2] = 20.0
    events = streams.events_of(streams.sense(force))
    assert [event.kind for event in events] == [ContactKind.IMPACT, ContactKind.SETTLED]
    assert events[0].magnitude > 12.0  # from the dip; 10 from the weight


def test_slow_heave_is_no_impact(streams: Any) -> None:
    """A body pushed up by 18 m/s^2 over half a second is not hit: the level follows."""
    assert ContactKind.IMPACT not in streams.kinds_of(streams.sense(streams.kick(0.4, 18.0, 0.5)))


def test_bounces_alternate_between_flight_and_impact(streams: Any) -> None:
    """A bouncing leg gives LIFTOFF and IMPACT in turn, more than once, and ends with an impact and rest."""
    kinds = streams.kinds_of(streams.sense(streams.drop(*SPRINGY)[0]))
    assert kinds.count(ContactKind.IMPACT) >= 2
    assert kinds[:-1] == [ContactKind.LIFTOFF, ContactKind.IMPACT] * (len(kinds) // 2)
    assert kinds[-1] is ContactKind.SETTLED


@few
@given(seed=seeds)
def test_tilt_of_the_imu_does_not_matter(streams: Any, seed: int) -> None:
    """Mounted in any rotation, the IMU reports the same events within two samples."""
    force, _ = streams.drop(*HARD)
    upright = streams.events_of(streams.sense(force, 500))
    tilted = streams.events_of(streams.sense(force, 500, turn=streams.any_rotation(seed)))
    assert [event.kind for event in tilted] == [event.kind for event in upright]
    for one, other in zip(tilted[:2], upright[:2], strict=True):
        assert abs(one.time_ns - other.time_ns) <= 4_000_000


@few
@given(shift_ns=st.integers(0, 2**62))
def test_origin_of_the_clock_does_not_matter(streams: Any, shift_ns: int) -> None:
    """Stamps shifted by any time shift the events by just that, to the nanosecond, and nothing else."""
    samples = streams.sense(streams.drop(*SOFT)[0], 500)
    shifted = [sample._replace(time_ns=sample.time_ns + shift_ns) for sample in samples]
    for one, other in zip(streams.events_of(samples), streams.events_of(shifted), strict=True):
        assert other.time_ns - one.time_ns == shift_ns
        assert (other.kind, other.magnitude, other.detection_delay_s) == (
            one.kind,
            one.magnitude,
            one.detection_delay_s,
        )


@pytest.mark.parametrize("foot", [SOFT, SPRINGY, HARD])
def test_rate_does_not_matter(streams: Any, foot: tuple[float, float]) -> None:
    """500 Hz and 1 kHz report the same events, flights and impacts within two samples of the slower one."""
    force, _ = streams.drop(*foot)
    slow, fast = streams.events_of(streams.sense(force, 500)), streams.events_of(streams.sense(force, 1000))
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
    force += shake[:, None] * streams.any_direction(way)
    assert streams.events_of(streams.sense(force, rate_hz, turn=streams.any_rotation(turn))) == []


@few
@given(amplitude_m_s2=st.floats(0.0, 5.8), frequency_hz=st.floats(0.5, 30.0), way=seeds)
def test_slow_strong_motion_is_no_impact_and_no_flight(
    streams: Any, amplitude_m_s2: float, frequency_hz: float, way: int
) -> None:
    """At any frequency, |specific force| within g +- 6 m/s^2 is neither an impact nor a lift-off."""
    force = streams.rest(2.0)
    shake = amplitude_m_s2 * np.sin(2.0 * math.pi * frequency_hz * streams.time_s(force))
    force += shake[:, None] * streams.any_direction(way)
    assert not {ContactKind.IMPACT, ContactKind.LIFTOFF} & set(streams.kinds_of(streams.sense(force, 500)))


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
    force += (amplitude_m_s2 * np.sin(2.0 * math.pi * frequency_hz * moving_s))[:, None] * streams.any_direction(way)
    angle = tilt_rad_s * moving_s
    # The body turns about x by +angle, so the fixed world turns about x by -angle in its frame.
    y, z = force[:, 1].copy(), force[:, 2].copy()
    force[:, 1], force[:, 2] = np.cos(angle) * y + np.sin(angle) * z, np.cos(angle) * z - np.sin(angle) * y
    gyro = np.zeros_like(force)
    gyro[:, 0] = np.where(time_s > 0.5, tilt_rad_s, 0.0)
    assert streams.events_of(streams.sense(force, 500, gyro=gyro)) == []


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [500, 1000])
def test_noise_alone_is_silent_for_minutes(streams: Any, rate_hz: int) -> None:
    """Three minutes of sensor noise at rest give no event at all."""
    controller = streams.new_controller()
    assert streams.events_of(streams.sense(streams.rest(180.0), rate_hz), controller) == []
    assert controller.detector.phase is Phase.PLANTED


def sliding(streams: Any, slope_rad: float, friction: float, slides_s: float = 0.3) -> Any:
    """Stand on a slope for 0.5 s, then slide down it with Coulomb friction; the leg stays upright."""
    force = streams.rest(0.5 + slides_s)
    downhill = GRAVITY_M_S2 * (math.sin(slope_rad) - friction * math.cos(slope_rad))
    force[streams.time_s(force) >= 0.5] += downhill * np.array([math.cos(slope_rad), 0.0, -math.sin(slope_rad)])
    return force


@few
@given(friction=st.floats(0.2, 0.6), turn=seeds, rate_hz=st.sampled_from([500, 1000]))
def test_sliding_down_a_slope_is_one_slip(streams: Any, friction: float, turn: int, rate_hz: int) -> None:
    """Sliding down 40 deg is reported as one SLIP within 0.1 s and 10 mm of its beginning, and as nothing else."""
    slope = math.radians(40.0)
    events = streams.events_of(
        streams.sense(sliding(streams, slope, friction), rate_hz, turn=streams.any_rotation(turn))
    )
    assert [event.kind for event in events] == [ContactKind.SLIP]
    after_s = events[0].time_ns * 1e-9 - 0.5
    assert 0.0 < after_s < 0.1
    assert 0.5 * GRAVITY_M_S2 * (math.sin(slope) - friction * math.cos(slope)) * after_s**2 < 0.01
    assert events[0].magnitude > 0.025
    assert 0.0 < events[0].detection_delay_s <= after_s + 0.002
    assert events[0].unit == "m/s"


@pytest.mark.parametrize(("upward", "slips"), [(0.98, False), (0.3, True), (-0.6, True)])
def test_a_sole_that_goes_up_does_not_slide(
    streams: Any, monkeypatch: pytest.MonkeyPatch, upward: float, *, slips: bool
) -> None:
    """Before a hind foot is lifted its sole comes up at 0.13 m/s, which looks like sliding; who slides goes along."""

    def follow(sole: SoleFilter, *_: object) -> None:
        sole.speed_m_s, sole.upward, sole.direction = 0.13, upward, (math.sqrt(1.0 - upward**2), 0.0, upward)

    monkeypatch.setattr(SoleFilter, "follow", follow)
    monkeypatch.setattr(SoleFilter, "update", lambda *_: 0.9)
    controller = AnkleController(ControllerParameters(imu_mount="shank"))
    kinds = [event.kind for event in streams.events_of(streams.sense(streams.rest(0.5), 500), controller)]
    assert (ContactKind.SLIP in kinds) is slips


@pytest.mark.parametrize("gives", [False, True])
def test_where_the_ankle_gives_the_speed_of_the_sole_is_known_from_a_rest_on(streams: Any, *, gives: bool) -> None:
    """A shank goes on as its toe touches down: known is its speed again after a rest, or when that is forgotten."""
    sole = SoleFilter(learned("shank").slide, gives=gives)
    assert sole.knows_speed(0) is not gives
    sole.land(1_000_000_000)
    assert [sole.knows_speed(each) for each in (1_500_000_000, 1_700_000_000)] == [not gives, True]
    sole.land(2_000_000_000)
    (sample,) = streams.sense(streams.rest(0.002), 500)
    sole.follow(sample._replace(time_ns=2_100_000_000), 0.002, Motion((0.0, 0.0, GRAVITY_M_S2)))
    assert sole.knows_speed(2_100_000_000)


def test_pushing_off_is_no_slip(streams: Any) -> None:
    """A leg at rest that pushes itself up at 5 m/s^2 does not slide."""
    force = streams.rest(0.7)
    force[streams.time_s(force) >= 0.5, 2] += 5.0
    assert streams.events_of(streams.sense(force)) == []


def test_what_is_not_offered_on_a_mount_is_never_reported(streams: Any) -> None:
    """A body that is hit at every step reports its impacts, and neither steps nor slips; a foot may report all."""
    assert all(set(reasons) == set(Detection) and all(reasons.values()) for reasons in REASONS.values())
    assert not not_felt(Mount.FOOT)
    unfelt = (Detection.STEP, Detection.SWING, Detection.SLIP_STEPPING)
    assert set(not_felt(Mount.BODY)) == {each.value for each in unfelt}
    force = streams.rest(5.0)
    time_s = streams.time_s(force)
    for begin_s in np.arange(1.0, 4.5, 0.7):
        force[(time_s > begin_s) & (time_s < begin_s + 0.02), 2] += 15.0
        force[(time_s > begin_s + 0.45) & (time_s < begin_s + 0.55), 0] += 2.0  # it speeds up, as a slip does
        force[(time_s > begin_s + 0.55) & (time_s < begin_s + 0.65), 2] -= 6.0
    reported = [kind for kind in streams.kinds_of(streams.sense(force)) if kind is not ContactKind.SETTLED]
    assert reported == [ContactKind.IMPACT] * 5
