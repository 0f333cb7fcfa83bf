"""Driver, controller and simulation in one process; and the same decisions with ROS."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from controller_bench import Bench
from sensor_msgs.msg import Imu

from domains import own_domain
from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_ATMOSPHERE_PA
from jammkle_controller.core.events import Contact, ContactKind, Source
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.inputs import AnkleAngles, Input
from jammkle_controller.core.landing import RATED_KG, Landing
from jammkle_controller.core.leg_contact import LegLoad, LegReading
from jammkle_controller.core.reading import Received
from jammkle_controller.parameters import ControllerParameters
from jammkle_controller.recordings import replay
from jammkle_driver.parameters import DriverParameters
from jammkle_sim.rigs.landing import LandingOptions, landing_built
from jammkle_sim.rigs.rig import FootPlan
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import RobotOptions
from studies.contact.loop import AnkleLoop
from studies.contact.robots import joined_contacts, leg_of_robot

if TYPE_CHECKING:
    from pathlib import Path

STATE_PERIOD_NS = 10_000_000
"""Joints and gait's plan of a robot are reported 100 times a second, at multiples of this."""


FLAT = {"hang_pitch_deg": 0.0, "reservoir_volume_m3": 0.0}
"""Feet and pumps as the parameters of a bare controller and driver have them."""


def land(duration_s: float = 2.5) -> tuple[AnkleLoop, list[ImuSample]]:
    """Drop the landing rig with controller and driver around it; return them and what the IMU read."""
    simulation = Simulation(landing_built(LandingOptions(release_time_s=0.5)))
    loop = AnkleLoop(simulation.ankle, ControllerParameters(), tick_rate_hz=500)
    samples = []
    for _ in range(round(duration_s * 500)):
        simulation.advance(round(0.002 / simulation.timestep_s))
        samples.append(loop.step(simulation.time_s))
    return loop, samples


def test_a_landing_in_the_loop_is_felt_and_held() -> None:
    """The landing is felt within 4 ms of the fall's end, every channel reaches the stance's vacuum, twice the same."""
    loop, samples = land()
    kinds = [event.kind for event in loop.events]
    assert kinds[:2] == [ContactKind.LIFTOFF, ContactKind.IMPACT]
    fall_s = (2.0 * 0.05 / 9.80665) ** 0.5
    assert loop.events[1].time_ns / NANOSECONDS_PER_SECOND == pytest.approx(0.5 + fall_s, abs=0.004)
    for pressure_pa in loop.ankle.channel_pressures_pa().values():
        assert STANDARD_ATMOSPHERE_PA - pressure_pa == pytest.approx(40e3, abs=2e3)
    again, same = land()
    assert same == samples
    assert again.events == loop.events


def test_ros_and_loop_decide_the_same_on_the_same_samples(tmp_path: Path) -> None:
    """The node, fed over DDS with the samples of a loop, reports its events and set points to the bit."""
    _, samples = land(1.5)
    made = replay([Received(sample.time_ns, sample) for sample in samples], ControllerParameters())
    with own_domain() as domain_id:
        bench = Bench(domain_id, tmp_path)
        try:
            bench.wait_until_up()
            for sample in samples:
                bench.imu.publish(message_of(sample))
                bench.executor.spin_once(timeout_sec=0.002)
            bench.spin_until(lambda: len(bench.events) >= len(made.events), "every event is reported")
            reported = [
                (e.header.stamp.sec * NANOSECONDS_PER_SECOND + e.header.stamp.nanosec, e.magnitude, e.probability)
                for e in bench.events
            ]
            assert reported == [(event.time_ns, event.magnitude, event.probability) for event in made.events]
            bench.spin_until(lambda: bench.set_points_pa() == made.decisions[-1].vacuum_pa, "the same is asked for")
        finally:
            bench.close()


def message_of(sample: ImuSample) -> Imu:
    message = Imu()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(sample.time_ns, NANOSECONDS_PER_SECOND)
    force, rate = message.linear_acceleration, message.angular_velocity
    force.x, force.y, force.z = sample.force_x, sample.force_y, sample.force_z
    rate.x, rate.y, rate.z = sample.rate_x, sample.rate_y, sample.rate_z
    return message


HEIGHT_M = 0.1
FILLED_S, EMPTY_S = 2.5, 0.05
"""Into a simulation: when its reservoir has been evacuated, and when it has hardly begun to be."""


def fall(
    release_s: float = FILLED_S, imu: str = "body", plan: FootPlan | None = None, **controller: float
) -> tuple[AnkleLoop, Landing]:
    """Let a leg that has hung fall by 0.1 m; return the loop when it stands, and what was chosen for the landing."""
    options = RobotOptions(behaviour="drop", imu=imu, drop_height_m=HEIGHT_M, release_time_s=release_s)
    simulation = robot_simulation("leg", options)
    if plan is not None:
        simulation.ankle.plan = lambda: plan  # type: ignore[method-assign]
    parameters = ControllerParameters(imu_mount=imu, hang_pitch_deg=options.hang_pitch_deg, **controller)
    loop = AnkleLoop(simulation.ankle, parameters, DriverParameters(reservoir_volume_m3=options.reservoir_volume_m3))
    landings: list[Landing] = []
    for sample in simulation.samples(release_s + 0.3, 500):
        loop.step(sample.time_s)
        landing = loop.controller.policy.landing
        if landing is not None and landing not in landings:
            landings.append(landing)
    return loop, landings[0]


@pytest.mark.parametrize(
    "plan",
    [None, FootPlan(bears=True, phase=0.25), FootPlan(bears=False, phase=0.75)],
    ids=["no gait", "stands", "air"],
)
def test_a_fall_counts_from_its_begin_whatever_a_gait_plans(plan: FootPlan | None) -> None:
    """A leg that hung is met for its speed, sqrt(2 g h), with the vacuum for that: what the gait says is a lie."""
    loop, landing = fall(plan=plan)
    assert landing.speed_m_s == pytest.approx(math.sqrt(2.0 * 9.80665 * HEIGHT_M), abs=0.06)
    assert landing.reached_pa > landing.chosen_pa > 30e3
    assert not landing.surprised
    braced_s = min(time_ns for time_ns, asked_pa in loop.commands if asked_pa["achilles"] > 0.0) * 1e-9
    assert FILLED_S < braced_s < landing.time_ns * 1e-9


def test_a_late_pump_and_ten_times_the_load_end_in_full_vacuum() -> None:
    """What was chosen and what was reached are said; the safer thing is as stiff as it gets."""
    late, heavy = fall(EMPTY_S), fall(load_kg=10.0 * RATED_KG)
    for (loop, landing), said in ((late, "too short a time"), (heavy, "the heel may strike")):
        assert said in landing.why
        asked_pa = next(asked_pa for time_ns, asked_pa in loop.commands if time_ns >= landing.time_ns)
        assert max(asked_pa.values()) == ControllerParameters().full_vacuum_pa
    assert late[1].reached_pa < late[1].chosen_pa


def test_a_fall_that_is_not_seen_ends_in_a_jam_at_once() -> None:
    """A shank that swings is as light as one that falls, so that an IMU there sees no fall of a leg that hung."""
    loop, landing = fall(imu="shank")
    assert landing.surprised
    assert "nothing foresaw it" in landing.why
    jammed_ns = min(time_ns for time_ns, asked_pa in loop.commands if any(asked_pa.values()))
    assert 0 <= jammed_ns - landing.time_ns <= 8_000_000  # two ticks: jam_delay_s is not waited for


def walk(imu: str, duration_s: float) -> tuple[AnkleLoop, list[Received], list[bool]]:
    """Walk a leg in the loop; return it, what a bag of the graph would hold, and whether each true swing was held."""
    simulation = robot_simulation("leg", RobotOptions(behaviour="walk", imu=imu, **FLAT))
    loop = AnkleLoop(simulation.ankles["ankle"], ControllerParameters(imu_mount=imu))
    received: list[Received] = []
    held: list[bool] = []
    for sample in simulation.samples(duration_s, 500):
        (ankle,) = sample.ankles.values()
        time_ns = round(sample.time_s * NANOSECONDS_PER_SECOND)
        if time_ns % STATE_PERIOD_NS == 0:
            angles = AnkleAngles(ankle.positions["ankle_roll"], ankle.positions["ankle_pitch"])
            received.append(Received(time_ns, angles))
            if ankle.plan is not None:
                received.append(Received(time_ns, Input.PLANNED_CONTACT, float(ankle.plan.bears)))
                if ankle.plan.phase is not None:
                    received.append(Received(time_ns, Input.GAIT_PHASE, float(np.float32(ankle.plan.phase))))
        received.append(Received(time_ns, loop.step(sample.time_s)))
        if sample.time_s > 1.5 and not ankle.foot.stands:
            held.append(loop.controller.vacuum_pa > 0.0)
    return loop, received, held


def test_the_plan_of_a_gait_vents_the_swings_that_a_body_does_not_show() -> None:
    """On the body no step is felt: by the IMU alone a leg that walks stays jammed, in the loop most swings are soft.

    The loop receives the plan as often and in the order in which the graph has it, so that it decides as a controller
    that receives the same recording.
    """
    loop, received, held = walk("body", 4.0)
    assert sum(held) / len(held) < 0.65  # evacuation begins 50 ms ahead of the touch, of a swing of 0.15 s
    made = replay(received, loop_parameters := ControllerParameters(imu_mount="body"))
    assert made.events == loop.events
    assert made.decisions[-1].vacuum_pa == loop.controller.set_points_pa
    alone = replay([each for each in received if isinstance(each.what, ImuSample)], loop_parameters)
    after = [each for each in alone.decisions if each.time_ns > NANOSECONDS_PER_SECOND]
    assert all(any(each.vacuum_pa.values()) for each in after)


def test_efforts_report_every_step_of_a_leg_on_any_mount() -> None:
    """With the IMU on the body, which feels no step, each true change of a walk is reported once, within 30 ms of it.

    The load comes out to 5 N in the median of a stance of some 16 N. The loop receives the efforts as often as on the
    graph, so that it decides as a controller that receives the same recording.
    """
    parameters = ControllerParameters(imu_mount="body", use_efforts=True)
    simulation = robot_simulation("leg", RobotOptions(behaviour="walk", imu="body"))
    loop = AnkleLoop(simulation.ankles["ankle"], parameters, leg=leg_of_robot("leg"))
    load = LegLoad(leg_of_robot("leg"), parameters.armature_kg_m2)
    received: list[Received] = []
    stands: list[bool] = []
    errors_n: list[float] = []
    for sample in simulation.samples(4.0, 500):
        (ankle,) = sample.ankles.values()
        time_ns = round(sample.time_s * NANOSECONDS_PER_SECOND)
        if time_ns % STATE_PERIOD_NS == 0:
            columns = (ankle.positions, ankle.velocities, ankle.efforts)
            reading = LegReading(*(column[joint] for column in columns for joint in ("hip", "knee")))
            load_n = load.update(reading, time_ns)
            if load_n is not None and ankle.foot.stands:
                errors_n.append(abs(load_n - ankle.foot.normal_force_n))
            received.append(Received(time_ns, reading))
            angles = AnkleAngles(ankle.positions["ankle_roll"], ankle.positions["ankle_pitch"])
            received.append(Received(time_ns, angles))
        received.append(Received(time_ns, loop.step(sample.time_s)))
        stands.append(ankle.foot.stands)
    received_again = [each for each in received if not isinstance(each.what, AnkleAngles)]
    again = replay(received_again, parameters, leg_of_robot("leg"))
    assert [event for event in again.events if event.source is Source.EFFORTS] == [
        event for event in loop.events if event.source is Source.EFFORTS
    ]
    assert np.median(errors_n) < 5.0
    contacts = joined_contacts(np.array(stands), 500.0)
    lifted_s = [end / 500.0 for _, end in contacts if 0.3 < end / 500.0 < 3.9]
    landed_s = [begin / 500.0 for begin, _ in contacts if 0.3 < begin / 500.0 < 3.9]
    assert len(landed_s) >= 5
    reported = [event for event in loop.events if event.source is Source.EFFORTS and 0.3e9 < event.time_ns < 3.95e9]
    for kind, true_s in ((ContactKind.LIFTOFF, lifted_s), (ContactKind.IMPACT, landed_s)):
        reported_s = [event.time_ns / NANOSECONDS_PER_SECOND for event in reported if event.kind is kind]
        assert len(reported_s) == len(true_s)
        assert reported_s == pytest.approx([at_s + 0.015 for at_s in true_s], abs=0.03)


def test_a_slip_is_reported_by_odometry_in_the_loop() -> None:
    """Ground that turns slippery under a leg: the loop reports it before 20 mm, as a controller on the graph."""
    parameters = ControllerParameters(imu_mount="body", use_efforts=True, use_odometry=True)
    options = RobotOptions(behaviour="slip", imu="body", slope_deg=15.0, slip_friction=0.1, slip_time_s=1.0)
    simulation = robot_simulation("leg", options)
    loop = AnkleLoop(simulation.ankles["ankle"], parameters, body=simulation.base, leg=leg_of_robot("leg"))
    slid_m = []
    for sample in simulation.samples(1.5, 500):
        loop.step(sample.time_s)
        slid_m.append(sample.ankles["ankle"].foot.sliding_distance_m)
    reported = [event for event in loop.events if event.source is Source.ODOMETRY and event.time_ns > 0.5e9]
    assert [event.kind for event in reported] == [ContactKind.SLIP]
    when = round(reported[0].time_ns / NANOSECONDS_PER_SECOND * 500.0)
    assert 0.0 < slid_m[when] - slid_m[499] < 0.02
    without = AnkleLoop(simulation.ankles["ankle"], parameters, leg=leg_of_robot("leg"))
    simulation.reset()
    for number, _ in enumerate(simulation.samples(1.5, 500)):
        without.step((number + 1) / 500.0)
    assert not any(event.source is Source.ODOMETRY for event in without.events)


@pytest.mark.parametrize("use_efforts", [False, True])
@pytest.mark.parametrize("imu", ["foot", "shank", "body"])
@pytest.mark.parametrize("slope_deg", [0.0, 5.0, 15.0])
def test_a_leg_that_is_put_on_a_slope_is_held(slope_deg: float, imu: str, use_efforts: bool) -> None:  # noqa: FBT001
    """Whatever of its set-down was felt, it is held within 2.5 s; efforts show contact, rest alone does not.

    On level ground nothing slides, and no slip is what holds it: the sole comes up against the foot as it is set down.
    """
    simulation = robot_simulation("leg", RobotOptions(behaviour="stand", imu=imu, slope_deg=slope_deg, **FLAT))
    loop = AnkleLoop(
        simulation.ankles["ankle"],
        ControllerParameters(imu_mount=imu, use_efforts=use_efforts),
        leg=leg_of_robot("leg"),
    )
    stands = False
    for sample in simulation.samples(2.5, 500):
        loop.step(sample.time_s)
        stands = sample.ankles["ankle"].foot.stands
    assert stands
    for pressure_pa in loop.ankle.channel_pressures_pa().values():
        assert STANDARD_ATMOSPHERE_PA - pressure_pa > 30e3
    assert slope_deg > 0.0 or all(event.kind is not ContactKind.SLIP for event in loop.events)
    report = loop.controller.contact
    assert report.bears
    assert report.contact is Contact.CONTACT or not use_efforts
