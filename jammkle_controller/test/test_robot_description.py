"""What a leg is, read from a URDF written by hand; that of the simulated robots is read in the tests of the graph."""

from __future__ import annotations

import dataclasses

import pytest
from controller_bench import LEG, LEG_URDF

from jammkle_common.parameters import ParameterError
from jammkle_controller.core.leg import leg_of
from jammkle_controller.parameters import ControllerParameters


def approximately(leg: object) -> dict[str, object]:
    """Return the figures of a leg for a comparison to rounding."""
    values = dataclasses.asdict(leg)  # type: ignore[call-overload]  # a Leg
    return {name: value if isinstance(value, str) else pytest.approx(value, abs=1e-9) for name, value in values.items()}


def test_lengths_masses_and_sole_are_read() -> None:
    """Links, inertias and a box for a sole give the leg; the IMU sits at the ankle, its lever leads down."""
    leg = leg_of(LEG_URDF, ControllerParameters(imu_link="imu"))
    assert dataclasses.asdict(leg) == approximately(dataclasses.replace(LEG, lever_m=(0.0, 0.0, -0.02)))


def test_a_leg_on_a_turned_body_behind_an_abduction_is_read() -> None:
    """Names have a prefix, or are whole; fixed joints that turn place the hip, and all ways to the side add up."""
    hips = """
  <joint name="rear" type="fixed"><origin xyz="-0.2 0 0" rpy="0 0 1.5707963267948966"/><parent link="base_link"/>
    <child link="rack"/></joint>
  <link name="rack"/>
  <joint name="lh_hip_roll" type="revolute"><origin xyz="0.1 0 -0.02"/><parent link="rack"/><child link="hip"/></joint>
  <link name="hip"/>
  <joint name="lh_hip" type="revolute"><origin xyz="0 0.05 0"/><parent link="hip"/>"""
    text = LEG_URDF.replace('name="knee"', 'name="LH_KFE"').replace('name="ankle_pitch"', 'name="lh_ankle_pitch"')
    text = text.replace('<joint name="hip" type="revolute"><parent link="base_link"/>', hips)
    text = text.replace('<origin xyz="0 0 -0.15"/>', '<origin xyz="0 0.01 -0.15"/>')
    leg = leg_of(text, ControllerParameters(joint_prefix="lh_", knee_joint="LH_KFE"))
    placed = dataclasses.replace(LEG, hip_m=(-0.2, 0.1, -0.02), offset_m=0.06, abduction="hip_roll")
    assert dataclasses.asdict(leg) == approximately(placed)


def test_the_lowest_points_of_balls_are_the_sole() -> None:
    ball = '<collision><origin xyz="{} 0.02 -0.015"/><geometry><sphere radius="0.005"/></geometry></collision>'
    begin, end = LEG_URDF.index("<collision>"), LEG_URDF.index("</link>\n</robot>")
    leg = leg_of(LEG_URDF[:begin] + ball.format(0.05) + ball.format(-0.03) + LEG_URDF[end:], ControllerParameters())
    assert (leg.toe_m, leg.heel_m, leg.half_width_m, leg.sole_m) == pytest.approx((0.05, 0.03, 0.02, 0.02))
    bare = leg_of(LEG_URDF[:begin] + LEG_URDF[end:], ControllerParameters())
    assert (bare.toe_m, bare.sole_m) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("</robot>", "", "no XML"),
        ('name="knee"', 'name="bend"', "no joint 'knee' .* it has: hip, bend, ankle_pitch"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>', "'hip' .* must be 0 1 0"),
        ('<origin xyz="0 0 -0.15"/>', '<origin xyz="0.1 0 -0.15"/>', "'knee' .* straight below"),
        ('xyz="0 0 -0.107"', 'xyz="0 0 low"', "'0 0 low' where numbers must be"),
        ('<link name="imu"/>', "", "no link 'imu'"),
    ],
)
def test_a_description_that_is_no_such_leg_is_refused_in_a_line(old: str, new: str, why: str) -> None:
    with pytest.raises(ParameterError, match=why):
        leg_of(LEG_URDF.replace(old, new), ControllerParameters(imu_link="imu"))
