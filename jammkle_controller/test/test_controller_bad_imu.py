"""An IMU that cannot be believed: reported, detection unavailable, and a robot that stands is not vented."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from jammkle_common.names import CHANNELS
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.events import ContactKind, Source
from jammkle_controller.core.imu import ImuTrouble
from jammkle_controller.core.inputs import PLAN_SILENT_S, Input
from jammkle_controller.core.landing import Evacuation, Stored
from jammkle_controller.core.policy import PolicyState
from jammkle_controller.core.reading import Received
from jammkle_controller.parameters import ControllerParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from conftest import Streams
    from jammkle_controller.core.imu import ImuSample

HELD = dict.fromkeys(CHANNELS, ControllerParameters().hold_vacuum_pa)
SOFT = dict.fromkeys(CHANNELS, 0.0)
KICK = (150.0, 0.9)


def scaled(force: float = 1.0, rate: float = 1.0) -> Callable[[ImuSample], ImuSample]:
    def change(sample: ImuSample) -> ImuSample:
        time_ns, x, y, z, p, q, r = sample
        return type(sample)(time_ns, force * x, force * y, force * z, rate * p, rate * q, rate * r)

    return change


def standing(streams: Any) -> tuple[AnkleController, int]:
    """Return a controller that has landed and holds the stance, and the stamp of its last sample."""
    controller = streams.new_controller()
    samples = streams.sense(streams.drop(*KICK)[0], 500)
    streams.events_of(samples, controller)
    assert controller.set_points_pa == HELD
    return controller, samples[-1].time_ns


def later(samples: list[ImuSample], after_ns: int) -> list[ImuSample]:
    return [sample._replace(time_ns=sample.time_ns + after_ns + 2_000_000) for sample in samples]


def turning(streams: Any) -> list[ImuSample]:
    """A body that rolls to and fro by 0.5 rad at 1 Hz, standing."""
    force = streams.rest(4.0)
    time_s = streams.time_s(force)
    angle = 0.5 * np.sin(2.0 * math.pi * time_s)
    force[:, 1], force[:, 2] = 9.80665 * np.sin(angle), 9.80665 * np.cos(angle)
    gyro = np.zeros_like(force)
    gyro[:, 0] = math.pi * np.cos(2.0 * math.pi * time_s)
    return list(streams.sense(force, 500, gyro=gyro))


def dead(sample: ImuSample) -> ImuSample:
    return type(sample)(sample.time_ns, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def frozen(sample: ImuSample) -> ImuSample:
    return type(sample)(sample.time_ns, 0.1, 0.0, 9.8, 0.0, 0.0, 0.01)


@pytest.mark.parametrize(
    ("change", "trouble"),
    [
        (dead, ImuTrouble.DEAD),
        (frozen, ImuTrouble.FROZEN),
        (scaled(force=1e3), ImuTrouble.BAD_SAMPLES),
        (scaled(force=100.0), ImuTrouble.TOO_LARGE),
        (scaled(force=math.nan), ImuTrouble.BAD_SAMPLES),
        (scaled(force=1e200), ImuTrouble.BAD_SAMPLES),
    ],
)
def test_a_broken_imu_does_not_vent_a_robot_that_stands(
    streams: Any, change: Callable[[ImuSample], ImuSample], trouble: ImuTrouble
) -> None:
    """Whatever breaks, it is named, no event is made up, and the stance is held; it is believed again."""
    controller, last_ns = standing(streams)
    broken = [change(sample) for sample in later(streams.sense(streams.rest(1.0), 500), last_ns)]
    events = streams.events_of(broken, controller)
    assert [event for event in events if event.kind is ContactKind.LIFTOFF] == []
    assert all(math.isfinite(event.magnitude) for event in events)
    assert controller.watch.trouble is trouble
    assert controller.policy.state is PolicyState.FAULT
    assert controller.set_points_pa == HELD
    streams.events_of(later(streams.sense(streams.rest(6.0), 500), broken[-1].time_ns), controller)
    assert controller.watch.trouble is None
    assert controller.set_points_pa == HELD


def without_gravity(sample: ImuSample) -> ImuSample:
    return sample._replace(force_z=sample.force_z - 9.80665)


@pytest.mark.parametrize("rate_hz", [100, 250, 1000])
@pytest.mark.parametrize("change", [scaled(force=1.0 / 9.80665), without_gravity], ids=["in g", "without gravity"])
def test_an_imu_that_loses_gravity_in_a_stance_is_refused_at_once(
    streams: Any, change: Callable[[ImuSample], ImuSample], rate_hz: int
) -> None:
    """Within two samples, before it looks like a flight: nothing is vented; it is believed again after 0.5 s."""
    controller, last_ns = standing(streams)
    rest = later(streams.sense(streams.rest(1.0), rate_hz), last_ns)
    streams.events_of(rest, controller)
    broken = [change(sample) for sample in later(streams.sense(streams.rest(3.0), rate_hz), rest[-1].time_ns)]
    assert streams.events_of(broken[:2], controller) == []
    assert controller.watch.trouble is ImuTrouble.TOO_SMALL
    assert streams.events_of(broken[2:], controller) == []
    assert controller.watch.trouble is ImuTrouble.TOO_SMALL
    assert (controller.policy.state, controller.set_points_pa) == (PolicyState.FAULT, HELD)
    whole = later(streams.sense(streams.rest(0.6), rate_hz), broken[-1].time_ns)
    streams.events_of(whole, controller)
    assert controller.watch.trouble is None
    assert (controller.policy.state, controller.set_points_pa) == (PolicyState.STANCE, HELD)


@pytest.mark.parametrize("rate_hz", [100, 250, 1000])
def test_an_imu_that_comes_back_in_g_and_turned_does_not_vent(streams: Any, rate_hz: int) -> None:
    """A driver that was started anew publishes in another frame and unit, while nobody knows that the foot stands."""
    controller = streams.new_controller()
    rest = streams.sense(streams.rest(3.0), rate_hz)
    streams.events_of(rest, controller)
    assert controller.set_points_pa == HELD
    in_g = [scaled(force=-1.0 / 9.80665)(sample) for sample in streams.sense(streams.rest(3.0), rate_hz)]
    events = streams.events_of(later(in_g, rest[-1].time_ns + 300_000_000), controller)
    assert [event for event in events if event.kind is ContactKind.LIFTOFF] == []
    assert controller.watch.trouble is ImuTrouble.TOO_SMALL
    assert controller.set_points_pa == HELD


@pytest.mark.parametrize("rate_hz", [100, 250, 1000])
def test_a_standing_body_whose_ground_gives_way_is_vented_as_it_falls(streams: Any, rate_hz: int) -> None:
    """It is let down over 20 ms, as no support vanishes between two samples: a flight, and no fault of the IMU."""
    controller, last_ns = standing(streams)
    force = streams.rest(1.0)
    force[:, 2] *= np.interp(streams.time_s(force), [0.5, 0.52], [1.0, 0.0])
    events = streams.events_of(later(streams.sense(force, rate_hz), last_ns), controller)
    assert [event.kind for event in events] == [ContactKind.LIFTOFF]
    assert controller.set_points_pa == SOFT


@pytest.mark.parametrize(("bad_share", "believed"), [(0.3, True), (0.7, False)])
@pytest.mark.parametrize("rate_hz", [100, 1000])
def test_more_than_half_of_the_samples_must_be_bad(
    streams: Any, rate_hz: int, bad_share: float, *, believed: bool
) -> None:
    """NaN at random: detection goes on with the rest, at any rate, as the page says."""
    draw = random.Random(1)  # noqa: S311
    controller, last_ns = standing(streams)
    nothing = scaled(force=math.nan)
    samples = later(streams.sense(streams.rest(5.0), rate_hz), last_ns)
    streams.events_of(samples[: rate_hz // 2], controller)
    doubted = set()
    for sample in samples[rate_hz // 2 :]:
        controller.update(nothing(sample) if draw.random() < bad_share else sample)
        doubted.add(controller.watch.trouble)
    assert (ImuTrouble.BAD_SAMPLES not in doubted) is believed
    assert controller.set_points_pa == HELD


@pytest.mark.parametrize("rate_hz", [250, 1000])
def test_readings_in_g_are_refused_from_the_start(streams: Any, rate_hz: int) -> None:
    """An IMU in g looks like free fall; it is named after 0.1 s, a whole landing gives no event, and nothing moves."""
    controller = streams.new_controller()
    samples = [scaled(force=1.0 / 9.80665)(sample) for sample in streams.sense(streams.drop(*KICK)[0], rate_hz)]
    assert streams.events_of(samples, controller) == []
    assert controller.watch.trouble is ImuTrouble.TOO_SMALL
    assert (controller.policy.state, controller.set_points_pa) == (PolicyState.FAULT, SOFT)


@pytest.mark.parametrize("stood_s", [0.03, 0.09])
def test_an_imu_that_is_received_just_before_a_fall_is_believed(streams: Any, stood_s: float) -> None:
    """A controller that joins late, a moment before the release, reports the whole landing."""
    samples = streams.sense(streams.drop(*KICK)[0], 500)
    lifted = next(event for event in streams.events_of(samples) if event.kind is ContactKind.LIFTOFF)
    begin_ns = lifted.time_ns - round((stood_s + 0.03) * 1e9)
    kinds = streams.kinds_of([sample for sample in samples if sample.time_ns >= begin_ns])
    assert kinds == [ContactKind.LIFTOFF, ContactKind.IMPACT, ContactKind.SETTLED]


def test_a_gyro_that_fits_the_turning_of_gravity_is_believed(streams: Any) -> None:
    controller = streams.new_controller()
    streams.events_of(turning(streams), controller)
    assert controller.watch.trouble is None


@pytest.mark.parametrize(
    ("rate", "trouble"), [(math.degrees(1.0), ImuTrouble.TURNING), (-1.0, ImuTrouble.FRAME)], ids=["deg/s", "frame"]
)
def test_degrees_per_second_are_reported_and_believed_after_half_a_second_at_rest(
    streams: Any, rate: float, trouble: ImuTrouble
) -> None:
    """A gyro in deg/s, or one turned the wrong way, does not fit the turning of gravity.

    What it claimed while it was wrong is not held against it once it claims nothing, however much that was.
    """
    controller = streams.new_controller()
    wrong = [scaled(rate=rate)(sample) for sample in turning(streams)]
    streams.events_of(wrong, controller)
    assert controller.watch.trouble is trouble
    streams.events_of(later(streams.sense(streams.rest(1.0), 500), wrong[-1].time_ns), controller)
    assert controller.watch.trouble is None
    streams.events_of(later(turning(streams), wrong[-1].time_ns + 1_000_000_000), controller)
    assert controller.watch.trouble is None


def test_a_sensor_at_the_end_of_its_range_is_reported(streams: Any) -> None:
    """An accelerometer that reads the end of its range all the time measures nothing."""
    controller, last_ns = standing(streams)
    samples = later(streams.sense(streams.rest(1.0), 500), last_ns)
    clipped = [sample._replace(force_z=80.83 if i % 8 else 80.8, force_x=0.01 * i) for i, sample in enumerate(samples)]
    streams.events_of(clipped, controller)
    assert controller.watch.trouble is ImuTrouble.CLIPPED
    assert controller.set_points_pa == HELD


def test_readings_that_are_held_are_no_fault(streams: Any) -> None:
    """An IMU of 125 Hz that is read at 500 Hz repeats every reading; the landing is reported as ever."""
    samples = streams.sense(streams.drop(*KICK)[0], 500)
    held = [samples[i - i % 4]._replace(time_ns=sample.time_ns) for i, sample in enumerate(samples)]
    controller = streams.new_controller()
    kinds = [event.kind for event in streams.events_of(held, controller)]
    assert kinds == [ContactKind.LIFTOFF, ContactKind.IMPACT, ContactKind.SETTLED]
    assert controller.gate.counts.held > 0.7 * len(held)


def test_a_body_that_sways_does_not_slip(streams: Any) -> None:
    """A minute of swaying by 10 mm at 3 Hz, which was 180 slips a minute, is none."""
    force = streams.rest(60.0)
    time_s = streams.time_s(force)
    force[:, 0] += np.clip(time_s - 0.5, 0.0, 1.0) * 0.01 * (6.0 * math.pi) ** 2 * np.sin(6.0 * math.pi * time_s)
    assert [event.kind for event in streams.events_of(streams.sense(force, 500))] == []


def test_a_contact_switch_goes_on_where_the_imu_is_broken(streams: Any) -> None:
    """With a switch the policy needs no IMU: it vents on lift-off and jams after the delay, and says by what."""
    controller, last_ns = standing(streams)
    samples = iter([dead(s) for s in later(streams.sense(streams.rest(2.0), 500), last_ns)])

    def go_on(count: int) -> int:
        for _ in range(count):
            controller.update(next(samples))
        return controller.gate.last_ns or 0

    controller.take(Received(go_on(100), Input.CONTACT_SWITCH, 1.0))
    assert controller.set_points_pa == HELD
    reaction = controller.take(Received(go_on(100), Input.CONTACT_SWITCH, 0.0))
    assert [(event.kind, event.source) for event in reaction.events] == [(ContactKind.LIFTOFF, Source.CONTACT_SWITCH)]
    assert controller.set_points_pa == SOFT
    assert Input.CONTACT_SWITCH in controller.inputs.received(go_on(1))
    reaction = controller.take(Received(go_on(100), Input.CONTACT_SWITCH, 1.0))
    assert [event.kind for event in reaction.events] == [ContactKind.IMPACT]
    go_on(20)
    assert controller.set_points_pa == HELD


@pytest.mark.parametrize("planned_share", [None, 0.7])
def test_a_gait_phase_vents_in_time_and_jams_ahead(streams: Any, planned_share: float | None) -> None:
    """The swing is soft from its start on, and evacuated so that it grips at the planned touch-down, on an IMU at rest.

    Where the gait says itself when it plans contact, that counts and not stance_share.
    """
    controller, last_ns = standing(streams)
    stride_s, asked_s, vented_s = 0.5, [], []
    lead_s = Evacuation.of(Stored(), achilles_alone=False).until_s(8e3)
    for sample in later(streams.sense(streams.rest(2.0), 500), last_ns):
        since_s = (sample.time_ns - last_ns) * 1e-9
        phase = (since_s / stride_s) % 1.0
        before = controller.set_points_pa
        if planned_share is not None:
            controller.take(Received(sample.time_ns, Input.PLANNED_CONTACT, phase < planned_share))
        controller.take(Received(sample.time_ns, Input.GAIT_PHASE, phase))
        controller.update(sample)
        if controller.set_points_pa == HELD and before == SOFT:
            asked_s.append(since_s % stride_s)
        elif controller.set_points_pa == SOFT and before == HELD:
            vented_s.append(since_s % stride_s)
    assert len(asked_s) >= 3
    assert all(abs(stride_s - lead_s - at_s) < 0.006 for at_s in asked_s[1:])
    assert vented_s == pytest.approx([(planned_share or 0.5) * stride_s] * len(vented_s), abs=0.006)


def test_a_plan_that_fell_silent_leaves_the_swings_to_the_phase(streams: Any) -> None:
    """Two seconds after the last gait/contact stance_share counts again, and the plan is not named as received."""
    controller, last_ns = standing(streams)
    stride_s, reported_s, vented_s = 0.5, 1.0, []
    for sample in later(streams.sense(streams.rest(5.0), 500), last_ns):
        since_s = (sample.time_ns - last_ns) * 1e-9
        phase = (since_s / stride_s) % 1.0
        before = controller.set_points_pa
        if since_s < reported_s:
            controller.take(Received(sample.time_ns, Input.PLANNED_CONTACT, phase < 0.7))
        controller.take(Received(sample.time_ns, Input.GAIT_PHASE, phase))
        controller.update(sample)
        if controller.set_points_pa == SOFT and before == HELD:
            vented_s.append(since_s)
        told_lately = Input.PLANNED_CONTACT in controller.inputs.received(sample.time_ns)
        assert told_lately is (since_s < reported_s + PLAN_SILENT_S - 0.002)
    by_plan = [at_s for at_s in vented_s if at_s < reported_s]
    by_phase = [at_s for at_s in vented_s if at_s > reported_s + PLAN_SILENT_S]
    assert [at_s % stride_s for at_s in by_plan] == pytest.approx([0.35] * 2, abs=0.006)
    assert [at_s % stride_s for at_s in by_phase] == pytest.approx([0.25] * 4, abs=0.006)


def test_a_load_that_goes_vents_and_jams_again_as_it_comes(streams: Any) -> None:
    """Unloading is reported within 40 ms of a cell at 100 Hz, on an IMU at rest; a foot half relieved stands."""
    controller = AnkleController(ControllerParameters(use_load=True))
    streams.events_of(streams.sense(streams.drop(*KICK)[0], 500), controller)
    last_ns = controller.gate.last_ns or 0
    set_points_pa = {}
    for number, sample in enumerate(later(streams.sense(streams.rest(2.0), 500), last_ns)):
        since_s = 0.002 * number
        load_n = 40.0 if since_s < 0.5 else 12.0 if since_s < 0.8 else 2.0 if since_s < 1.2 else 40.0
        if number % 5 == 0:
            controller.take(Received(sample.time_ns, Input.LOAD, load_n))
        controller.update(sample)
        set_points_pa[number * 2] = controller.set_points_pa
    assert set_points_pa[798] == HELD
    assert set_points_pa[840] == SOFT
    assert set_points_pa[1198] == SOFT
    assert set_points_pa[1270] == HELD


def test_a_rate_that_is_not_the_configured_one_is_named_with_both_numbers(streams: Streams) -> None:
    """An IMU that is published at its configured rate and repeats readings is believed; others name both rates.

    Half or twice the configured rate is another sensor; without a configured rate any from 50 Hz will do.
    """
    fresh = streams.sense(streams.rest(3.0), 500)
    repeated = [sample._replace(time_ns=sample.time_ns + 2_000_000) for sample in fresh[::4]]  # 125 readings a second
    published = [
        reading._replace(time_ns=reading.time_ns + copy * 2_000_000) for reading in repeated for copy in range(4)
    ]
    slow = streams.sense(streams.rest(3.0), 100)
    for samples, rate_hz, named_hz in (
        (fresh, 500.0, ()),
        (slow, 500.0, (500, 100)),
        (slow, 0.0, ()),
        (published, 500.0, ()),
        (published, 125.0, ()),
        (published, 0.0, ()),
        (published, 2000.0, (2000, 125, 500)),
        (published, 40.0, (40, 125, 500)),
    ):
        controller = AnkleController(ControllerParameters(imu_rate_hz=rate_hz))
        streams.events_of(samples, controller)
        assert controller.watch.trouble is (ImuTrouble.RATE if named_hz else None), rate_hz
        assert all(f"{each} Hz" in controller.watch.reason for each in named_hz)
