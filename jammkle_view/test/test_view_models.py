"""What is drawn, and that it moves as the robot says."""

from __future__ import annotations

import numpy as np
import pytest

from jammkle_common.names import QUADRUPED_ANKLES, TENDONS
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import ROBOTS, RobotOptions
from jammkle_view.core.figure import figure_of
from jammkle_view.core.models import HANGING, Kinematics, along, setting_of
from jammkle_view.core.samples import Base

DESCRIPTIONS = [*(f"rig: {name}" for name in RIGS), *(f"robot: {name}" for name in ROBOTS)]


@pytest.mark.parametrize("description", DESCRIPTIONS)
def test_everything_that_can_be_simulated_can_be_drawn(description: str) -> None:
    """Solids hang on bodies that the model has, and their corners are finite."""
    model = setting_of(description).model
    known = {"", *Kinematics(model).bodies}
    solids = figure_of(model)
    assert len({solid.name for solid in solids}) == len(solids)
    for solid in solids:
        assert solid.body in known
        assert np.isfinite(solid.vertices_m).all()
        assert solid.faces.max() < len(solid.vertices_m)


@pytest.mark.parametrize("description", ["", "rig: of another version", "nonsense: [", "robot: dog", "rig: {}"])
def test_what_nobody_knows_is_an_ankle_in_the_air(description: str) -> None:
    """The page comes up whatever is published."""
    assert setting_of(description).rig == HANGING


def test_a_tendon_is_drawn_from_plate_to_plate() -> None:
    """Pitched toe-down, the Achilles tendons get shorter by what the lever says, the foot stays under the leg."""
    setting = setting_of("rig: landing")
    kinematics = Kinematics(setting.model)
    before_m = dict(zip(kinematics.segments, along(*kinematics.segment_ends_m)[1], strict=True))
    kinematics.move({"ankle_pitch": 0.1, "carriage": 0.2, "not a joint": 1.0})
    after_m = dict(zip(kinematics.segments, along(*kinematics.segment_ends_m)[1], strict=True))
    assert after_m["achilles_left"] - before_m["achilles_left"] == pytest.approx(-0.0374 * np.sin(0.1), abs=3e-4)
    assert kinematics.positions_m[kinematics.bodies.index("foot"), 2] == pytest.approx(0.2)


def test_a_cylinder_lies_where_it_is_asked_to() -> None:
    """Its axis, z, is turned onto the way from begin to end, straight down too."""
    ways_m = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.3, -0.4, 0.5]])
    turns, lengths_m = along(np.zeros((4, 3)), ways_m)
    for (w, x, y, z), length_m, way_m in zip(turns, lengths_m, ways_m, strict=True):
        axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        assert length_m * axis == pytest.approx(way_m, abs=1e-12)


def test_each_ankle_of_a_quadruped_moves_its_own_foot() -> None:
    """Topics call all ankles' joints alike; the model does not."""
    setting = setting_of("robot: quadruped\noptions: {behaviour: walk}")
    assert set(setting.ankles) == set(QUADRUPED_ANKLES)
    kinematics = Kinematics(setting.model)
    assert set(kinematics.segments) == {naming[each] for naming in setting.ankles.values() for each in TENDONS}
    start = kinematics.rotations.copy()
    kinematics.move({setting.ankles["lh_ankle"]["ankle_pitch"]: 0.3})
    turned = np.abs(kinematics.rotations - start).max(axis=1) > 1e-6
    assert [name for name, moved in zip(kinematics.bodies, turned, strict=True) if moved] == ["lh_ankle/foot"]


def test_a_robot_stands_on_the_ground_that_it_is_drawn_on() -> None:
    """Bent knees lift the feet, as nothing says where the trunk is; by that much it is drawn lower."""
    setting = setting_of("robot: leg\noptions: {slope_deg: 10.0}")
    kinematics = Kinematics(setting.model)
    assert kinematics.clearance_m == pytest.approx(0.0, abs=2e-3)
    kinematics.move({"hip": 1.2, "knee": -2.4})
    assert kinematics.clearance_m > 0.05


def test_a_robot_is_drawn_where_it_says_that_it_is() -> None:
    """A walking quadruped, from its topics: every body is where the simulation has it, the ground below."""
    simulation = robot_simulation("quadruped", RobotOptions(behaviour="walk", slope_deg=8.0))
    setting = setting_of("robot: quadruped\noptions: {behaviour: walk, slope_deg: 8.0}")
    kinematics = Kinematics(setting.model)
    (*_, sample) = simulation.samples(3.0, 100)
    joints = {
        setting.ankles[name][joint]: value
        for name, ankle in sample.ankles.items()
        for joint, value in ankle.positions.items()
    }
    kinematics.move(joints, Base(0.0, sample.base.position_m, sample.base.rotation))
    assert kinematics.positions_m == pytest.approx(simulation.data.xpos[1:], abs=1e-3)
    assert np.abs((kinematics.rotations * simulation.data.xquat[1:]).sum(axis=1)) == pytest.approx(1.0, abs=1e-4)
    travel_m = kinematics.travel_m
    assert travel_m[0] > 0.005
    assert travel_m[2] == pytest.approx(travel_m[0] * np.tan(np.radians(8.0)))  # along the ground
    assert kinematics.clearance_m == pytest.approx(0.0, abs=2e-3)
