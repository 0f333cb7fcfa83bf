"""The leg: stands where friction holds it, slides as gravity and friction say, creates no energy, repeats itself."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import ACHILLES, CHANNELS, PERONEAL_LEFT, PUMP_DUTY, SOLENOIDS
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.run import run_robot
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.catalogue import robot, robot_simulation
from jammkle_sim.robots.limb import HIP, KNEE, LimbParameters
from jammkle_sim.robots.options import RobotOptions

ANKLE = "ankle"
SETTLED_S = 0.5
WEIGHT_N = 1.8 * STANDARD_GRAVITY_M_S2


def test_a_foot_stays_below_the_angle_of_friction() -> None:
    """On 20 degrees with a friction of 0.5 (27 degrees) it moves by less than half a millimetre in two seconds."""
    simulation = robot_simulation("leg", RobotOptions(slope_deg=20.0, friction=0.5))
    *_, settled = simulation.samples(SETTLED_S, 50)
    *_, last = simulation.samples(2.0, 50)
    slid_m = last.ankles[ANKLE].foot.sliding_distance_m - settled.ankles[ANKLE].foot.sliding_distance_m
    assert slid_m < 0.0005
    assert last.ankles[ANKLE].foot.stands


def test_above_it_the_foot_slides_as_far_as_it_moves() -> None:
    """The ground turns slippery: the true sliding is the toe's own way, and the base goes by g (sin - mu cos).

    To 3 %: the toe's ball rolls a little as the foot is unloaded, and the base comes down by as much.
    """
    slope_rad, friction = math.radians(25.0), 0.2
    options = RobotOptions(behaviour="slip", slope_deg=25.0, slip_friction=friction, slip_time_s=1.0, imu="body")
    simulation = robot_simulation("leg", options)
    *_, before = simulation.samples(1.0, 100)
    toe_m = simulation.data.geom("ankle/toe_left").xpos.copy()
    *_, after = simulation.samples(0.4, 100)
    slid_m = after.ankles[ANKLE].foot.sliding_distance_m - before.ankles[ANKLE].foot.sliding_distance_m
    assert slid_m == pytest.approx(math.dist(simulation.data.geom("ankle/toe_left").xpos, toe_m), rel=0.03)
    moved_m = math.dist(after.base_position_m, before.base_position_m)
    acceleration_m_s2 = STANDARD_GRAVITY_M_S2 * (math.sin(slope_rad) - friction * math.cos(slope_rad))
    assert moved_m == pytest.approx(acceleration_m_s2 * 0.4**2 / 2.0, rel=0.03)
    assert after.ankles[ANKLE].foot.sliding_speed_m_s == pytest.approx(acceleration_m_s2 * 0.4, rel=0.03)
    # a body that really slips feels along the slope no more than friction: its IMU sees it
    x, _, z = after.ankles[ANKLE].imu.specific_force_m_s2
    along_m_s2 = x * math.cos(slope_rad) + z * math.sin(slope_rad)
    assert along_m_s2 == pytest.approx(friction * STANDARD_GRAVITY_M_S2 * math.cos(slope_rad), rel=0.1)


def test_truth_tells_flight_blow_and_weight_of_a_drop() -> None:
    """Nothing touches before; the blow is several weights; then it bears all of it."""
    simulation = robot_simulation("leg", RobotOptions(behaviour="drop", release_time_s=0.2))
    samples = list(simulation.samples(1.2, 500))
    falling = [each for each in samples if each.time_s < 0.29]
    assert not any(each.ankles[ANKLE].foot.stands for each in falling)
    assert max(each.ankles[ANKLE].foot.normal_force_n for each in samples) > 3.0 * WEIGHT_N
    assert samples[-1].ankles[ANKLE].foot.normal_force_n == pytest.approx(WEIGHT_N, rel=0.05)


def test_a_landing_creates_no_energy() -> None:
    """Gravity, motion, servos' springs and what the tendons took up, together, never rise by 1 % of the fall's energy.

    The servos hold their targets, so each is a spring and a damper. What the tendons took up counts as kept: that a
    tendon never gives back more is tested on the tendon.
    """
    options = RobotOptions(behaviour="drop", release_time_s=0.0, drop_height_m=0.1)
    simulation = robot_simulation("leg", options)
    model, limb = simulation.model, LimbParameters()
    probe = mujoco.MjData(model)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    servos = [(model.joint(name).qposadr[0], model.actuator(name).id) for name in (HIP, KNEE)]
    taken_j, energies_j = 0.0, []
    before = simulation.ankles[ANKLE].tendons()
    simulation.advance(1)
    for _ in range(1000):
        simulation.advance(1)
        probe.qpos[:], probe.qvel[:] = simulation.data.qpos, simulation.data.qvel
        mujoco.mj_forward(model, probe)
        after = simulation.ankles[ANKLE].tendons()
        taken_j += sum(
            old.tension_n * (new.extension_m - old.extension_m) for old, new in zip(before, after, strict=True)
        )
        before = after
        bent_rad = [probe.qpos[place] - simulation.data.ctrl[control] for place, control in servos]
        springs_j = sum(limb.stiffness_n_m * each**2 / 2.0 for each in bent_rad)
        energies_j.append(float(probe.energy.sum()) + springs_j + taken_j)
    fall_j = WEIGHT_N * options.drop_height_m
    lowest_j = np.minimum.accumulate(energies_j)
    assert np.max(energies_j - lowest_j) < 0.01 * fall_j
    assert energies_j[0] - energies_j[-1] > 0.5 * fall_j  # and the landing did take place


def test_jamming_holds_the_foot_in_its_place() -> None:
    """Jammed on the level, the toe bears more than soft when the ground is left: the ankle is stiffer."""
    pitches_rad = []
    for vacuum_pa in (0.0, 50e3):
        simulation = robot_simulation("leg", RobotOptions(slope_deg=30.0))
        simulation.ankles[ANKLE].hold_vacuum(dict.fromkeys(CHANNELS, vacuum_pa))
        simulation.advance(0)
        *_, last = simulation.samples(1.0, 100)
        pitches_rad.append(last.ankles[ANKLE].positions["ankle_pitch"])
    soft, jammed = pitches_rad
    assert soft < jammed - 0.03  # the slope presses the toe up, less so when jammed
    assert jammed < math.radians(RobotOptions().hang_pitch_deg)  # and no lock holds it: jammed tendons give, too


def test_the_achilles_pair_bears_a_stance_on_toes() -> None:
    """The toes bear all of the weight, and their moment about the joint is that of the tendons: nothing else holds."""
    simulation = robot_simulation("leg", RobotOptions())
    simulation.ankles[ANKLE].hold_vacuum(dict.fromkeys(CHANNELS, 40e3))
    *_, last = simulation.samples(2.0, 50)
    ankle, parameters = last.ankles[ANKLE], AnkleParameters()
    lowest_m = {corner: simulation.data.geom(f"ankle/{corner}").xpos[2] for corner in ("toe_left", "heel_left")}
    assert lowest_m["heel_left"] > lowest_m["toe_left"] + 0.01
    toe_arm_m = simulation.data.geom("ankle/toe_left").xpos[0] - simulation.data.body("ankle/foot").xpos[0]
    peroneals_n = sum(tendon.tension_n for tendon in ankle.tendons[:2])
    achilles_n = sum(tendon.tension_n for tendon in ankle.tendons[2:])
    pulled_n_m = achilles_n * parameters.achilles_arm_m - peroneals_n * parameters.peroneal_forward_m
    cosine = math.cos(ankle.positions["ankle_pitch"])
    assert pulled_n_m * cosine == pytest.approx(ankle.foot.normal_force_n * toe_arm_m, rel=0.1)


@pytest.mark.parametrize("height_m", [0.03, 0.1])
def test_toes_take_the_blow_that_a_flat_foot_hands_on(height_m: float) -> None:
    """At 40 kPa the base is braked by less than half of what a flat foot, or the same foot on a locked joint, makes."""
    peaks_m_s2 = {}
    for name, made in {
        "toes": RobotOptions(),
        "flat": RobotOptions(hang_pitch_deg=0.0),
        "locked": RobotOptions(ankle="rigid"),
    }.items():
        simulation = robot_simulation(
            "leg", dataclasses.replace(made, behaviour="drop", drop_height_m=height_m, release_time_s=0.8)
        )
        simulation.ankles[ANKLE].hold_vacuum(dict.fromkeys(CHANNELS, 40e3))
        up_m_s = np.array([each.base_velocity_m_s[2] for each in simulation.samples(1.2, 1000)])
        peaks_m_s2[name] = (up_m_s[5:] - up_m_s[:-5]).max() / 0.005
    assert 2.0 * peaks_m_s2["toes"] < min(peaks_m_s2["flat"], peaks_m_s2["locked"])


def test_it_steps_and_says_when_it_means_to() -> None:
    """While it walks the foot leaves the ground and comes back as planned, and the base goes on."""
    simulation = robot_simulation("leg", RobotOptions(behaviour="walk", speed_m_s=0.15))
    samples = list(simulation.samples(3.0, 100))[100:]
    stands = [each.ankles[ANKLE].foot.stands for each in samples]
    touch_downs = sum(not before and after for before, after in pairwise(stands))
    assert touch_downs in (4, 5)  # one each half second
    agree = sum(each.ankles[ANKLE].plan.bears == each.ankles[ANKLE].foot.stands for each in samples)
    assert agree > 0.85 * len(samples)
    advanced_m = samples[-1].base_position_m[0] - samples[0].base_position_m[0]
    assert advanced_m == pytest.approx(0.15 * 2.0, rel=0.1)


def test_the_same_seed_and_commands_give_the_same_samples() -> None:
    """Bit by bit, whatever the portions, and again after a reset."""
    options = RobotOptions(behaviour="walk", roughness_m=0.01, seed=3)
    first, second = robot_simulation("leg", options), robot_simulation("leg", options)
    *_, last = first.samples(0.8, 500)
    for steps in (1, 7, 1000, 0, 592):
        second.advance(steps)
    assert second.sample() == last
    first.reset()
    *_, again = first.samples(0.8, 100)
    assert again == last


def test_commands_are_recorded_when_they_are_given() -> None:
    """Whatever the rate of the recording: a command that is stamped a row late looks like valves that act too soon."""

    def commanded_s(rate_hz: int) -> dict[str, list[float]]:
        simulation = robot_simulation("leg", RobotOptions())
        simulation.ankles[ANKLE].hold_vacuum(dict.fromkeys(CHANNELS, 40e3))
        run = run_robot(simulation, 0.3, rate_hz, lambda _: None, lambda: False)[ANKLE]
        return {topic.name: run.topics[topic.name].time_s.tolist() for topic in (PUMP_DUTY, *SOLENOIDS.values())}

    slow, fast = commanded_s(100), commanded_s(1000)
    assert slow == {topic: pytest.approx(time_s) for topic, time_s in fast.items()}
    assert slow[PUMP_DUTY.name][0] == 0.0


def test_a_set_point_from_before_a_release_by_hand_is_forgotten() -> None:
    """Everything was vented since; what is held next is what is named then."""
    simulation = robot_simulation("leg", RobotOptions())
    ankle = simulation.ankles[ANKLE]
    ankle.hold_vacuum({ACHILLES: 50e3})
    list(simulation.samples(1.0, 50))
    ankle.set_pump_duty(0.0)
    for channel in CHANNELS:
        ankle.set_solenoid(channel, energised=False)
    list(simulation.samples(1.0, 50))
    ankle.hold_vacuum({PERONEAL_LEFT: 30e3})
    *_, last = simulation.samples(2.0, 50)
    vacuum_pa = {name: 101325.0 - pa for name, pa in last.ankles[ANKLE].channel_pressures_pa.items()}
    assert vacuum_pa.pop(PERONEAL_LEFT) == pytest.approx(38e3, abs=8e3)  # the manifold had kept more than is asked for
    assert vacuum_pa == pytest.approx(dict.fromkeys(vacuum_pa, 0.0), abs=3e3)


def test_bumps_come_from_the_seed() -> None:
    """Rough ground is as high as asked for, and another seed makes another."""
    heights = [robot("leg", RobotOptions(roughness_m=0.02, seed=seed)).model.hfield_data for seed in (1, 1, 2)]
    assert np.array_equal(heights[0], heights[1])
    assert not np.array_equal(heights[0], heights[2])


def test_a_locked_ankle_does_not_turn() -> None:
    """The baseline without an ankle gives by less than ten milliradians under a landing, however its foot hangs."""
    simulation = robot_simulation("leg", RobotOptions(ankle="rigid", behaviour="drop", release_time_s=0.0))
    pitches_rad = [each.ankles[ANKLE].positions["ankle_pitch"] for each in simulation.samples(0.4, 500)]
    assert pitches_rad == pytest.approx([math.radians(RobotOptions().hang_pitch_deg)] * len(pitches_rad), abs=0.01)


def test_bad_input_is_refused_in_one_line() -> None:
    """Unknown robots, options out of range, rates that do not fit, commands that nobody can follow."""
    with pytest.raises(ParameterError, match="robot 'hexapod' does not exist; known are: leg, quadruped"):
        robot("hexapod", RobotOptions())
    with pytest.raises(ParameterError, match="'slope_deg' is 50"):
        robot("leg", RobotOptions(slope_deg=50.0))
    simulation = Simulation(robot("leg", RobotOptions()))
    with pytest.raises(ValueError, match="rate of 300 Hz does not fit"):
        next(simulation.samples(1.0, 300))
    with pytest.raises(ValueError, match="vacuum of achilles is -1"):
        simulation.ankles[ANKLE].hold_vacuum({"achilles": -1.0})
    with pytest.raises(ValueError, match="pump duty is nan"):
        simulation.ankles[ANKLE].set_pump_duty(math.nan)


def test_efforts_are_what_the_servos_gave_in_the_mean() -> None:
    """Of a leg that walks, over each control step: within a twentieth of what they change by in it.

    The damper acts with the new speed, as MuJoCo's implicit integrator has it.

    The ankle has no servo, and gives nothing.
    """
    simulation = robot_simulation("leg", RobotOptions(behaviour="walk", speed_m_s=0.3, step_period_s=0.4))
    (view,) = simulation.ankles.values()
    knee, target, limb = simulation.data.joint(KNEE), simulation.model.actuator(KNEE).id, LimbParameters()
    simulation.advance(round(0.7 / simulation.timestep_s))
    errors, last = [], []
    for _ in range(200):
        applied = []
        for _ in range(round(0.002 / simulation.timestep_s)):
            at_rad = float(knee.qpos[0])
            simulation.advance(1)
            spring_n_m = limb.stiffness_n_m * (float(simulation.data.ctrl[target]) - at_rad)
            applied.append(spring_n_m - limb.damping_n_m_s * float(knee.qvel[0]))
        efforts = view.joint_efforts()
        errors.append(abs(efforts["knee"] - np.mean(applied)))
        last.append(abs(applied[-1] - np.mean(applied)))
    assert np.median(errors) < 0.05 * np.median(last)
    assert efforts["ankle_pitch"] == 0.0


def test_another_ground_is_put_under_it() -> None:
    """What is exchanged starts as if it had been there from the beginning; only time goes on."""
    steep = RobotOptions(slope_deg=12.0, friction=0.5)
    simulation = robot_simulation("leg", RobotOptions(friction=0.5))
    simulation.advance(300)
    simulation.exchange(robot("leg", steep))
    assert simulation.elapsed_s == 0.0
    fresh = robot_simulation("leg", steep)
    simulation.advance(700)
    fresh.advance(700)
    assert simulation.sample() == fresh.sample()
    assert simulation.time_s == pytest.approx(fresh.time_s + 300 * fresh.timestep_s)
    with pytest.raises(ValueError, match="time step"):
        simulation.exchange(robot("leg", RobotOptions(timestep_s=0.001)))
