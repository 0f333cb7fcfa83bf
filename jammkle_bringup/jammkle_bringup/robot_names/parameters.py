"""Parameters of robot_names: one table that is declared, bounded, validated and documented from here."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_common.parameters import parameter

OF_THE_ROBOT = "robot"
OF_THE_ANKLE = "ankle"


@dataclass(frozen=True)
class RobotNamesParameters:
    """What can be set on robot_names."""

    joints: str = parameter(
        "",
        "Joints, as theirs=ours parted by commas: lf_foot_pitch=ankle_pitch, lf_foot_roll=-ankle_roll; with the minus "
        "theirs counts the other way round; the others are left out",
    )
    joints_of: str = parameter(
        OF_THE_ROBOT,
        "Who publishes joint states; robot: robot/joint_states is heard and joint_states published; ankle, as in "
        "simulation: the other way round",
        choices=(OF_THE_ROBOT, OF_THE_ANKLE),
    )
    channels: str = parameter(
        "",
        "Channels, as theirs=ours parted by commas: rear=achilles; those that are not named keep their names",
    )
