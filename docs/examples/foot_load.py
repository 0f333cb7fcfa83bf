"""Estimate the load on every foot without a load cell: geometry_msgs/WrenchStamped on `foot_load`, from one IMU.

python foot_load.py --ros-args -p mass_kg:=1.8   # a single ankle: everything in its own namespace
python foot_load.py --ros-args -p mass_kg:=7.2 -p ankles:="[left_ankle, right_ankle]" -r imu/data:=/trunk/imu

What is known: all contact forces together are the robot's mass times the specific force of its centre of mass (Newton's
second law). What is assumed: the IMU feels just that, so it belongs on the body, and the feet that stand share it
equally. `contact` of foot_contact.py tells which stand. docs/integration.md says how good that is.
"""

import sys

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Imu
from std_msgs.msg import Bool

from jammkle_common.parameters import ParameterError
from jammkle_common.runner import run


def loads_n(mass_kg, specific_force_m_s2, standing):
    """Return the force of the ground on each foot, N, in the frame of the IMU; 0 on one that does not stand.

    The specific force is a vector; `standing` says of each foot, by name, whether it is on the ground.
    """
    count = sum(standing.values())
    share = tuple(mass_kg * axis / count for axis in specific_force_m_s2) if count else (0.0, 0.0, 0.0)
    return {foot: share if stands else (0.0, 0.0, 0.0) for foot, stands in standing.items()}


class FootLoad(Node):
    """Publishes an estimate with every sample of the IMU, once the contact of every foot is known."""

    def __init__(self):
        """Follow the IMU and the contact of each foot; ParameterError without a mass."""
        super().__init__("foot_load")
        self.mass_kg = self.declare_parameter("mass_kg", 0.0).value
        if not self.mass_kg > 0.0:
            raise ParameterError(f"mass_kg is {self.mass_kg}; give the mass of the whole robot, kg: -p mass_kg:=7.2")
        self.ankles = list(self.declare_parameter("ankles", [""]).value)
        self.standing = {}
        self.publishers_of = {}
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for ankle in self.ankles:
            prefix = f"{ankle}/" if ankle else ""
            self.publishers_of[ankle] = self.create_publisher(WrenchStamped, f"{prefix}foot_load", 10)
            self.create_subscription(
                Bool, f"{prefix}contact", lambda known, foot=ankle: self.stand(foot, known), latched
            )
        self.create_subscription(Imu, "imu/data", self.feel, qos_profile_sensor_data)

    def stand(self, foot, known):
        """Keep whether a foot is on the ground."""
        self.standing[foot] = known.data

    def feel(self, sample):
        """Publish the estimates of one sample; no torque, as it is about where the foot presses, wherever that is."""
        if len(self.standing) < len(self.ankles):
            return
        force = sample.linear_acceleration
        for foot, load_n in loads_n(self.mass_kg, (force.x, force.y, force.z), self.standing).items():
            message = WrenchStamped(header=sample.header)
            message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = load_n
            self.publishers_of[foot].publish(message)


if __name__ == "__main__":
    sys.exit(run(FootLoad))
