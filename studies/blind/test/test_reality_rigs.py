"""The reality's drop, slip and landing: the paper's table, what a fault moves, and that a seed makes a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from studies.blind.reality.faults import FAULTS, FaultSetting
from studies.blind.reality.machine import Machine
from studies.blind.reality.run import run
from studies.blind.reality.sensors import BadPlanError, Plan, RealRun
from studies.paper.tables import DROP_ROWS, SIGNIFICANT, PaperRow

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from studies.blind.reality.sensors import Option

DAY = 11
"""Seed of the runs that are compared."""
FEET = {
    "rigid_ankle": "rigid_ankle",
    "standard_foot": "standard",
    "squash_ball": "squash_ball",
    "jammed_ankle": "jammed",
    "unjammed_ankle": "unjammed",
}
"""Foot of each row."""


def real(rig: str, options: Mapping[str, Option], seed: int = DAY, **sizes: float) -> RealRun:
    """Run the machine as drawn; `sizes` of one fault, whose name is given as `fault__size`."""
    by_fault: dict[str, dict[str, float]] = {}
    for name, value in sizes.items():
        fault, size = name.split("__")
        by_fault.setdefault(fault, {})[size] = value
    return run(Plan(rig, options), Machine(), [FaultSetting(name, values) for name, values in by_fault.items()], seed)


def column(found: RealRun, topic: str, name: str) -> NDArray[np.float64]:
    track = found.topics[topic]
    values: NDArray[np.float64] = track.values[:, track.columns.index(name)]
    return values


def peak_m_s2(found: RealRun) -> float:
    return float(column(found, names.IMU.name, "linear_acceleration_z_m_s2").max()) - STANDARD_GRAVITY_M_S2


def height_m(found: RealRun) -> NDArray[np.float64]:
    return column(found, names.JOINT_STATES.name, f"{names.CARRIAGE_JOINT}.position")


def are_same(one: RealRun, other: RealRun) -> bool:
    """Whether two runs are the same, bit for bit."""
    return one.topics.keys() == other.topics.keys() and all(
        np.array_equal(one.topics[topic].values, other.topics[topic].values)
        and np.array_equal(one.topics[topic].stamp_s, other.topics[topic].stamp_s)
        and np.array_equal(one.topics[topic].log_s, other.topics[topic].log_s)
        for topic in one.topics
    )


def moved(one: RealRun, other: RealRun) -> dict[str, float]:
    """Root mean square between two runs, by topic and column."""
    return {
        f"{topic} {name}": float(np.sqrt(((track.values - other.topics[topic].values)[:, i] ** 2).mean()))
        for topic, track in one.topics.items()
        if track.values.shape == other.topics[topic].values.shape
        for i, name in enumerate(track.columns)
    }


@pytest.fixture(scope="module")
def dropped() -> RealRun:
    """A drop of the unjammed ankle, in order."""
    return real("drop", {})


@pytest.mark.parametrize("row", DROP_ROWS, ids=lambda row: row.identifier)
def test_drops_are_within_the_papers_error_bars(row: PaperRow) -> None:
    """Five drops of each foot have the paper's mean within two standard errors; two feet clip where the paper's did."""
    plan: dict[str, Option] = {"foot": FEET[row.identifier]}
    peaks = [peak_m_s2(real("drop", plan, seed)) for seed in range(5)]
    if row.clipped:
        assert peaks == pytest.approx([row.mean] * 5, abs=0.03)
    else:
        assert np.mean(peaks) == pytest.approx(row.mean, abs=2.0 * row.standard_error)
        assert 0.2 * row.standard_error < np.std(peaks, ddof=1) / np.sqrt(5) < 2.0 * row.standard_error


def test_the_same_seed_gives_the_same_bits_and_another_does_not(dropped: RealRun) -> None:
    """A run is a function of plan, machine, faults and seed."""
    assert are_same(dropped, real("drop", {}))
    assert not are_same(dropped, real("drop", {}, DAY + 1))


def test_faults_of_no_size_change_no_bit(dropped: RealRun) -> None:
    """Every fault of the bodies, named but null, leaves the run as it was."""
    nothing = [FaultSetting(name) for name, fault in FAULTS.items() if "drop" in fault.rigs]
    assert are_same(dropped, run(Plan("drop", {}), Machine(), nothing, DAY))


def test_in_free_fall_the_imu_feels_nothing(dropped: RealRun) -> None:
    """Between release and touch the accelerometer reads noise alone, and the carriage falls by half g t squared."""
    imu, joints = dropped.topics[names.IMU.name], dropped.topics[names.JOINT_STATES.name]
    falling = (imu.stamp_s > 1.02) & (imu.stamp_s < 1.09)
    assert abs(column(dropped, names.IMU.name, "linear_acceleration_z_m_s2")[falling].mean()) < 0.02
    since_s = joints.stamp_s - 1.0
    chosen = (since_s > 0.0) & (since_s < 0.09)
    fallen_m = height_m(dropped)[joints.stamp_s < 1.0].mean() - height_m(dropped)[chosen]
    assert np.abs(fallen_m - STANDARD_GRAVITY_M_S2 * since_s[chosen] ** 2 / 2.0).max() < 4e-4


def test_the_imu_is_the_second_derivative_of_the_carriage(dropped: RealRun) -> None:
    """What the IMU felt from release to rest, integrated, is the change of the carriage's speed: momentum is kept."""
    imu = dropped.topics[names.IMU.name]
    chosen = imu.stamp_s > 1.0
    force = column(dropped, names.IMU.name, "linear_acceleration_z_m_s2")[chosen]
    gained_m_s = np.trapezoid(force - STANDARD_GRAVITY_M_S2, imu.stamp_s[chosen])
    rate = column(dropped, names.JOINT_STATES.name, f"{names.CARRIAGE_JOINT}.velocity")
    assert gained_m_s == pytest.approx(rate[-1], abs=0.05)


def test_the_load_cell_bears_what_the_carriage_lacks(dropped: RealRun) -> None:
    """In the impact the carriage's mass times what the IMU feels is what the load cell pushes."""
    imu, cell = dropped.topics[names.IMU.name], dropped.topics[names.LOAD_CELL.name]
    force = np.interp(cell.stamp_s, imu.stamp_s, column(dropped, names.IMU.name, "linear_acceleration_z_m_s2"))
    pushing = (cell.stamp_s > 1.115) & (cell.stamp_s < 1.3)
    carriage_kg = 1.8 - 0.352
    left_n = column(dropped, names.LOAD_CELL.name, "force_z_n") + carriage_kg * force
    assert np.sqrt((left_n[pushing] ** 2).mean()) < 2.0


@pytest.mark.parametrize(
    ("fault", "moves"),
    [
        ({"payload__more_kg": 0.8}, "tendon_states achilles_left.extension_m"),
        ({"gritty_joint__dry_n_m": 0.1}, "joint_states ankle_pitch.position"),
        ({"gritty_joint__viscous_n_m_s": 0.02}, "joint_states ankle_pitch.velocity"),
        ({"floor_grip__grip": 1.8}, "load_cell/wrench force_x_n"),
        ({"mat_on_floor__give_m_n": 1e-4}, "joint_states carriage.position"),
        ({"worn_pins__play_m": 0.001}, "tendon_states achilles_left.extension_m"),
        ({"loose_foot_plate__gap_m": 0.002}, "imu/data linear_acceleration_z_m_s2"),
        ({"rail_rubs__rub_n": 2.0}, "imu/data linear_acceleration_z_m_s2"),
        ({"dented_rail__rub_n": 10.0, "dented_rail__at_m": 0.07}, "imu/data linear_acceleration_z_m_s2"),
        ({"cable_pulls__pull_n": 2.0}, "joint_states carriage.position"),
        ({"soft_imu_mount__softness_s2": 6e-6}, "imu/data linear_acceleration_z_m_s2"),
        ({"bent_toe__bent_rad": 0.05}, "joint_states carriage.position"),
        ({"twisted_foot__twisted_rad": 0.05}, "joint_states ankle_roll.position"),
        ({"crooked_floor__steeper_rad": 0.05}, "load_cell/wrench force_x_n"),
        ({"other_sole__stiffer": 2.0}, "imu/data linear_acceleration_z_m_s2"),
    ],
    ids=lambda value: value if isinstance(value, str) else "+".join(value),
)
def test_each_fault_moves_what_it_should(dropped: RealRun, fault: Mapping[str, float], moves: str) -> None:
    """A fault shows, far above the noise, in the signal it acts on, and leaves the pressures alone."""
    noise = {"extension_m": 5e-6, "position": 4e-4, "velocity": 0.05, "force": 0.06, "linear": 0.02}
    level = next(value for word, value in noise.items() if word in moves)
    differs = moved(dropped, real("drop", {}, **fault))
    assert differs[moves] > 3.0 * level
    assert all(value == 0.0 for name, value in differs.items() if "pressure" in name)


def test_a_soft_mount_changes_the_imu_alone(dropped: RealRun) -> None:
    """What the IMU's mount does is seen by no other sensor."""
    differs = moved(dropped, real("drop", {}, soft_imu_mount__softness_s2=6e-6))
    assert all(value == 0.0 for name, value in differs.items() if "imu" not in name)


def test_the_lighter_foot_falls_no_slower_and_rests_higher(dropped: RealRun) -> None:
    """Mass does not change the fall; more of it presses the ankle deeper."""
    heavy = real("drop", {"mass_kg": 2.5})
    falling = dropped.topics[names.JOINT_STATES.name].stamp_s < 1.09
    assert np.abs(height_m(heavy)[falling] - height_m(dropped)[falling]).max() < 1e-4
    assert height_m(heavy).min() < height_m(dropped).min() - 1e-3


@pytest.fixture(scope="module")
def pushed() -> dict[str, RealRun]:
    """Short slips: the foot touches, stands and bears."""
    return {foot: real("slip", {"foot": foot, "speed_m_s": 0.02}) for foot in ("unjammed", "jammed", "rigid_ankle")}


def push_n(found: RealRun) -> NDArray[np.float64]:
    """Push on the slope: load cell less what hangs on it."""
    force = column(found, names.LOAD_CELL.name, "force_z_n")
    return force[found.topics[names.LOAD_CELL.name].stamp_s < 1.0].mean() - force


def test_a_jammed_ankle_bears_more_on_a_slope(pushed: Mapping[str, RealRun]) -> None:
    """Jammed, peak and work over the descent are significantly larger than unjammed, as the paper claims."""
    jammed, unjammed = push_n(pushed["jammed"]), push_n(pushed["unjammed"])
    assert jammed.max() > SIGNIFICANT * unjammed.max()
    assert jammed.mean() > SIGNIFICANT * unjammed.mean()


def test_a_leg_hangs_still_until_it_is_pushed(pushed: Mapping[str, RealRun]) -> None:
    """Before the push the load cell bears cell, leg and foot, and the carriage does not move."""
    found = pushed["rigid_ankle"]
    before = found.topics[names.LOAD_CELL.name].stamp_s < 0.99
    assert column(found, names.LOAD_CELL.name, "force_z_n")[before].mean() == pytest.approx(
        (0.352 + 0.2) * STANDARD_GRAVITY_M_S2, abs=0.05
    )
    still = found.topics[names.JOINT_STATES.name].stamp_s < 0.99
    assert np.ptp(height_m(found)[still]) < 5e-5


def test_the_carriage_comes_down_as_far_as_set(pushed: Mapping[str, RealRun]) -> None:
    """From start to halt it goes the descent and the clearance, whatever the foot pushes back."""
    for found in pushed.values():
        assert height_m(found)[0] - height_m(found)[-1] == pytest.approx(0.111, abs=4e-4)


def test_a_slippery_slope_bears_less(pushed: Mapping[str, RealRun]) -> None:
    """With half the grip the ankle slides sooner: less work."""
    slippery = real("slip", {"foot": "unjammed", "speed_m_s": 0.02}, floor_grip__grip=0.5)
    assert push_n(slippery).mean() < 0.7 * push_n(pushed["unjammed"]).mean()


def test_a_landing_caught_jammed_ends_higher() -> None:
    """Jammed before, the ankle holds the leg up; never jammed, it gives way; both come to rest on the slope."""
    ends = {}
    for jam in ("never", "before"):
        found = real("landing", {"jam": jam})
        assert np.ptp(height_m(found)[-50:]) < 1e-3
        ends[jam] = height_m(found)[-1]
    assert ends["before"] > ends["never"] + 0.01


@pytest.mark.parametrize(
    ("rig", "options", "names_it"),
    [
        ("drop", {"foot": "clog"}, "clog"),
        ("slip", {"foot": "standard"}, "standard"),
        ("landing", {"jam": "maybe"}, "maybe"),
        ("drop", {"slope_deg": 3.0}, "slope_deg"),
    ],
)
def test_a_plan_that_nobody_could_carry_out_is_refused(rig: str, options: dict[str, Option], names_it: str) -> None:
    """The message names what was set."""
    with pytest.raises(BadPlanError, match=names_it):
        real(rig, options)
