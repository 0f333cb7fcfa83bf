"""Jam an ankle, wait until it holds, do what wants a stiff ankle, let go: as the code of a mission does it.

python mission.py --ros-args -r __ns:=/lf_ankle
"""

import signal
import sys
import time

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions

from jammkle_msgs.msg import ChannelJamState, JamState
from jammkle_msgs.srv import Jam, Unjam


class Ankle(Node):
    """Asks the driver, and believes jam_state alone."""

    def __init__(self):
        """Look on from the start: jam_state is latched, so that the first one comes at once."""
        super().__init__("mission")
        self.state = JamState()
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(JamState, "jam_state", self.update, latched)

    def update(self, state):
        """Keep the latest report."""
        self.state = state

    def ask(self, kind, name, **request):
        """Call a service of the driver; RuntimeError says what it refused and why."""
        client, full = self.create_client(kind, name), self.resolve_service_name(name)
        if not client.wait_for_service(timeout_sec=5.0):
            raise RuntimeError(f"nobody offers {full}")
        future = client.call_async(kind.Request(**request))
        rclpy.spin_until_future_complete(self, future, timeout_sec=5.0)
        if future.result() is None or not future.result().success:
            raise RuntimeError(future.result().message if future.result() else f"no answer from {full}")

    def wait(self, wanted, timeout_s=5.0):
        """Wait until every channel is in a state; RuntimeError names the channel that is not, and why."""
        end = time.monotonic() + timeout_s
        while not self.state.channels or any(channel.state != wanted for channel in self.state.channels):
            failed = [channel for channel in self.state.channels if channel.state == ChannelJamState.FAULT]
            if failed or time.monotonic() > end:
                late = failed or [channel for channel in self.state.channels if channel.state != wanted]
                raise RuntimeError("; ".join(f"{each.channel}: {each.reason}" for each in late) or "no jam_state")
            rclpy.spin_once(self, timeout_sec=0.1)


def main():
    """Return 0 if the ankle was stiff when it should be, and soft in the end."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # rclpy's own would end the graph before it can let go
    ankle = Ankle()
    try:
        try:
            ankle.ask(Jam, "driver/jam", vacuum_pa=40e3)  # no channels: all of them
            ankle.wait(ChannelJamState.JAMMED)
            print("stiff")  # here the robot steps onto the slope
        finally:  # also when it was interrupted, or did not get stiff: nobody else lets go
            ankle.ask(Unjam, "driver/unjam")
        ankle.wait(ChannelJamState.UNJAMMED)
        print("soft")
    except (KeyboardInterrupt, RuntimeError) as error:
        first = error.__context__ or error  # what came before, where letting go failed too
        print(f"mission: {str(first) or 'interrupted'}", file=sys.stderr)
        return 1
    finally:
        ankle.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
