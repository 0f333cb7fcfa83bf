"""Inputs beside the IMU that are wrong, stand still or go on alone: none is believed for ever, or the end of it all."""

from __future__ import annotations

import dataclasses
import math
import random
from typing import TYPE_CHECKING

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool

from jammkle_common.names import CHANNELS, FOOT_CONTACT
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.events import ContactEvent, ContactKind
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.inputs import AnkleAngles, ContactInputs, GaitPhase, Input
from jammkle_controller.core.landing import Stored
from jammkle_controller.core.leg_contact import AnkleReading
from jammkle_controller.core.policy import JammingPolicy, PolicyState
from jammkle_controller.core.reading import DriverReport, Received
from jammkle_controller.parameters import ControllerParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from controller_bench import Bench

MS = 1_000_000
CHANCE = random.Random(1)  # noqa: S311 - noise


def at_rest(time_ns: int) -> ImuSample:
    """Return a sample of an IMU that lies still."""
    noise = [CHANCE.gauss(0.0, 0.02 if axis < 3 else 0.002) for axis in range(6)]
    return ImuSample(time_ns, noise[0], noise[1], 9.80665 + noise[2], *noise[3:])


def every_10_ms(begin_s: float, end_s: float) -> Iterator[int]:
    """Give times, ns."""
    return iter(range(round(begin_s * 1e9), round(end_s * 1e9), 10 * MS))


@pytest.mark.parametrize("stands_at", [0.3, 0.9])
def test_a_gait_phase_that_stands_still_plans_nothing(stands_at: float) -> None:
    """However long it stands, and with what is read of it; as it goes on, touch-downs are foreseen again."""
    controller = AnkleController(ControllerParameters())
    for time_ns in every_10_ms(0.0, 3.0):
        controller.take(Received(time_ns, Input.GAIT_PHASE, time_ns * 1e-9 % 1.0))
        controller.update(at_rest(time_ns + 1))
    for time_ns in every_10_ms(3.0, 65.0):
        jitter = CHANCE.uniform(-1e-4, 1e-4)
        controller.take(Received(time_ns, Input.GAIT_PHASE, stands_at + jitter))
        controller.inputs.gait.feel(time_ns)
        controller.update(at_rest(time_ns + 1))
    assert controller.inputs.gait.touchdown_ns(65_000 * MS) is None
    for time_ns in every_10_ms(65.0, 66.0):
        controller.take(Received(time_ns, Input.GAIT_PHASE, (stands_at + time_ns * 1e-9) % 1.0))
    phase = (stands_at + 65.99) % 1.0
    assert controller.inputs.gait.touchdown_ns(65_990 * MS) == pytest.approx(65_990 * MS + (1.0 - phase) * 1e9, abs=5e7)


def test_a_phase_that_comes_oftener_than_the_clock_ticks_is_followed() -> None:
    """Two messages at one reading of a simulated clock are no standstill."""
    gait = GaitPhase()
    for k in range(1000):
        gait.on_phase((2e-3 * k) % 1.0, 4 * MS * (k // 2))
    assert gait.phase(4 * MS * 499) == pytest.approx(2e-3 * 998 % 1.0, abs=0.01)


@pytest.mark.parametrize("late_ms", [0, 2, 10, 20, -10])
def test_an_imu_that_comes_late_knows_the_phase(late_ms: int) -> None:
    """Stamped some ms off its arrival: another's blow in mid-swing jams nothing, each touch-down is prepared once."""
    controller, stride_ms = AnkleController(ControllerParameters()), 500
    prepared_at: list[float] = []
    for time_ms in range(0, 8 * stride_ms, 2):
        phase = time_ms / stride_ms % 1.0
        before = controller.policy.state
        if time_ms % 10 == 0:
            controller.take(Received(time_ms * MS, Input.GAIT_PHASE, phase))
        sample = at_rest((time_ms - late_ms) * MS)
        blown = time_ms > 2 * stride_ms and 0.6 <= phase < 0.63
        controller.update(sample._replace(force_z=sample.force_z + 25.0) if blown else sample)
        if time_ms > stride_ms and controller.policy.state is not before:
            assert not 0.55 < phase < 0.8, controller.policy.state
            if controller.policy.state is PolicyState.PREPARING:
                prepared_at.append(phase)
    assert len(prepared_at) == 7
    assert all(0.8 < phase < 0.97 for phase in prepared_at)


def test_an_empty_reservoir_of_litres_is_no_reason_to_end() -> None:
    """A vacuum that would take for ever is begun with as one that takes long."""
    controller = AnkleController(ControllerParameters())
    controller.on_driver(DriverReport(Stored(0.0, 2e-3), by_stream=False))
    for time_ns in every_10_ms(0.0, 5.0):
        controller.take(Received(time_ns, Input.GAIT_PHASE, time_ns * 1e-9 % 1.0))
        controller.update(at_rest(time_ns + 1))
    assert controller.policy.state is not PolicyState.FAULT


@pytest.mark.parametrize(("begins_n", "glitch_n"), [(200.0, 20.0), (20.0, 1e5)])
def test_a_wrong_load_does_not_vent_what_stands(begins_n: float, glitch_n: float) -> None:
    """A first reading ten times too large, or one of a broken cell in a stance: 20 N go on to be a stance."""
    controller = AnkleController(ControllerParameters(use_load=True))
    for time_ns in every_10_ms(0.0, 20.0):
        load_n = begins_n if time_ns == 0 else glitch_n if time_ns == 5000 * MS else 20.0
        controller.take(Received(time_ns, Input.LOAD, load_n))
        controller.update(at_rest(time_ns + 1))
    assert controller.inputs.measured_contact(20_000 * MS)
    assert controller.policy.state is PolicyState.STANCE


def test_a_load_that_was_wrong_for_long_is_forgotten() -> None:
    """Within half a minute a tenth of it is a stance; a foot that hangs for minutes does not stand by noise."""
    inputs = ContactInputs(ControllerParameters(use_load=True))
    for time_ns in every_10_ms(0.0, 40.0):
        inputs.on_input(Input.LOAD, 200.0 if time_ns < 1000 * MS else 20.0, time_ns)
    assert inputs.measured_contact(40_000 * MS)
    for time_ns in every_10_ms(40.0, 340.0):
        inputs.on_input(Input.LOAD, CHANCE.uniform(-0.5, 0.5), time_ns)
        assert time_ns < 40_100 * MS or not inputs.measured_contact(time_ns)


def test_angles_that_are_no_numbers_are_not_received() -> None:
    """What the ankle's angles said last counts for half a second, not for as long as NaN comes in."""
    parameters = ControllerParameters(hang_pitch_deg=28.6)
    controller = AnkleController(parameters)

    def follow(begin_s: float, end_s: float, pitch_rad: float) -> None:
        for time_ns in every_10_ms(begin_s, end_s):
            rates = [CHANCE.gauss(0.0, 0.01) for _ in range(4)]
            pitched = pitch_rad + CHANCE.gauss(0.0, 0.002)
            controller.take(Received(time_ns, AnkleReading(pitched, 0.0, *rates)))
            for k in range(5):
                controller.update(at_rest(time_ns + 2 * MS * k))

    follow(0.0, 1.0, parameters.hang_pitch_rad)
    follow(1.0, 2.0, 0.0)
    assert controller.inputs.measured_contact(2000 * MS)
    follow(2.0, 3.0, math.nan)
    assert controller.inputs.measured_contact(3000 * MS) is None


def test_a_clock_that_was_set_back_finds_nothing_of_the_old_run() -> None:
    """An input of before does not count again as the new run comes to its time; nor does an old roll lean a slip."""
    controller = AnkleController(ControllerParameters())
    for time_ns in every_10_ms(97.0, 100.0):
        controller.take(Received(time_ns, Input.PLANNED_CONTACT, 0.0))
        controller.take(Received(time_ns, Input.GAIT_PHASE, time_ns * 1e-9 % 1.0))
        controller.take(Received(time_ns, AnkleAngles(0.2, 0.0)))
        controller.update(at_rest(time_ns + 1))
    for time_ns in every_10_ms(0.0, 101.0):
        controller.update(at_rest(time_ns))
        assert controller.inputs.planned_contact(time_ns) is None
        assert controller.inputs.gait.phase(time_ns) is None
    assert not controller.inputs.shows_angles(100_000 * MS)


def test_a_set_point_that_is_lowered_in_a_stance_counts_at_once() -> None:
    """Also in one whose touch-down was foreseen, so that its vacuum was chosen before."""
    parameters = ControllerParameters()
    policy = JammingPolicy(parameters)
    policy.advance(1000 * MS)
    policy.foresee(1050 * MS)
    policy.advance(1040 * MS)
    policy.react(ContactEvent(ContactKind.IMPACT, 1050 * MS, 10.0, "m/s^2", 0.0))
    policy.advance(1200 * MS)
    assert policy.state is PolicyState.STANCE
    assert set(policy.set_points_pa.values()) == {parameters.hold_vacuum_pa}
    policy.parameters = dataclasses.replace(parameters, hold_vacuum_pa=20e3)
    assert set(policy.set_points_pa.values()) == {20e3}


def test_a_switch_alone_holds_every_stance(make_bench: Callable[..., Bench]) -> None:
    """No IMU at all, and a switch that publishes on change, latched, from before: it stands, steps and stands."""
    bench = make_bench()
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    switch = bench.node.create_publisher(Bool, FOOT_CONTACT.name, latched)
    switch.publish(Bool(data=True))
    held, soft = dict.fromkeys(CHANNELS, 40e3), dict.fromkeys(CHANNELS, 0.0)
    bench.spin_until(lambda: bench.commands != [] and bench.set_points_pa() == held, "the stance from before is held")
    for _ in range(2):
        switch.publish(Bool(data=False))
        bench.spin_until(lambda: bench.set_points_pa() == soft, "the swing is soft")
        switch.publish(Bool(data=True))
        bench.spin_until(lambda: bench.set_points_pa() == held, "the stance is held")
