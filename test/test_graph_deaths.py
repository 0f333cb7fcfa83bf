"""What the ankle does when somebody stops, hangs or dies, and within what time; docs/faults.md tells it to users.

One graph of single processes, as `ros2 run` starts them, goes through it all.
"""

from __future__ import annotations

import signal
import sys
import time
from typing import TYPE_CHECKING, Any

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import Bool

from jammkle_common.names import (
    ACTUATOR_STATES,
    CLEAR_FAULT,
    DIAGNOSTICS,
    EMERGENCY_STOP,
    JAM_STATE,
    PRESSURES,
    SET_PAUSED,
    UNJAM_ALL,
)
from jammkle_msgs.msg import ChannelJamState, Fault

if TYPE_CHECKING:
    from collections.abc import Callable

    from processes import Processes

    from graph import Probe

AMBIENT_PA = 101325.0
HELD_PA = 40e3


class Witness:
    """What a bystander sees of the ankle, and how long everything took."""

    def __init__(self, probe: Probe) -> None:
        self.probe = probe
        self.seen_s: dict[str, float] = {}
        probe.listen(JAM_STATE, DIAGNOSTICS, ACTUATOR_STATES, *PRESSURES.values())

    def until(self, what: str, since_s: float, holds: Callable[[], bool]) -> None:
        self.probe.spin_until(holds, what)
        self.seen_s[what] = time.monotonic() - since_s

    def see_each_other(self) -> bool:
        names = ("controller", "driver", "sim")
        lines = [self.probe.line(f"/{name}: nodes").message for name in names]
        return all(name in line for name in names for line in lines)

    def energised(self) -> bool:
        return any(self.probe.last(ACTUATOR_STATES).energised)

    def let_go(self) -> bool:
        """Whether the board has let go by itself; a driver that regulates releases a solenoid now and then, too."""
        return self.probe.last(ACTUATOR_STATES).host_silent and not self.energised()

    def pump_off(self) -> bool:
        """Whether the board drives no pump."""
        return bool(self.probe.last(ACTUATOR_STATES).pump_duty == 0.0)

    def vacuum_pa(self) -> float:
        return AMBIENT_PA - max(self.probe.last(topic).fluid_pressure for topic in PRESSURES.values())

    def jammed(self) -> bool:
        states = self.probe.channel_states()
        return bool(states) and set(states.values()) == {ChannelJamState.JAMMED}

    def faults(self) -> set[int]:
        return {channel.fault for channel in self.probe.last(JAM_STATE).channels}

    def released_in_silence(self) -> bool:
        """Whether all is vented for want of commands; on a machine too busy for its watchdog, the board is first."""
        return self.faults() <= {Fault.COMMANDS_STALE, Fault.BOARD_LET_GO} and not self.energised()

    def missed(self, by: str, who: str) -> bool:
        del self.probe.received[DIAGNOSTICS.name][:-50]
        return f"{who} is dead" in self.probe.line(f"/{by}: nodes").message

    def clock_missed(self, by: str) -> bool:
        del self.probe.received[DIAGNOSTICS.name][:-50]
        return self.probe.line(f"/{by}: nodes").message.startswith("/clock has not ticked")

    def set_parameter(self, node: str, name: str, value: float) -> Any:
        client = self.probe.node.create_client(SetParameters, f"{node}/set_parameters")
        self.probe.spin_until(client.service_is_ready, f"{node} takes parameters")
        parameter = Parameter(name, value=value).to_parameter_msg()
        future = client.call_async(SetParameters.Request(parameters=[parameter]))
        self.probe.spin_until(future.done, f"{node} answers")
        return future.result().results[0]


def test_whoever_dies_the_ankle_is_safe_and_somebody_tells(  # noqa: PLR0915 - one start of the graph for all of it
    processes: Processes, make_probe: Callable[..., Probe]
) -> None:
    """A stall, every death, a stop and nonsense in parameters, one after the other, on one standing ankle."""
    probe = make_probe()
    witness = Witness(probe)
    processes.start("controller", "use_sim_time:=true")
    processes.start("driver", "use_sim_time:=true")
    processes.start("sim", "start_paused:=true")
    probe.spin_until(witness.see_each_other, "the nodes see each other")
    assert probe.call(SET_PAUSED, data=False).success
    witness.until("standing, jammed", time.monotonic(), witness.jammed)

    # Set points and the atmosphere: refused at the source, or outweighed.
    refused = witness.set_parameter("controller", "full_vacuum_pa", 75e3)
    assert not refused.successful
    assert "70000" in refused.reason
    assert witness.set_parameter("driver", "ambient_pressure_pa", 80e3).successful
    probe.spin_until(lambda: probe.line("/driver: atmosphere").level == b"\x01", "the parameter is doubted")
    probe.spin_until(
        lambda: witness.jammed() and witness.vacuum_pa() == pytest.approx(HELD_PA, abs=2.5e3), "it is held as before"
    )
    assert witness.set_parameter("driver", "ambient_pressure_pa", AMBIENT_PA).successful

    # The driver stands still: the board lets go, and afterwards nothing healthy is in FAULT.
    stood_s = processes.send("driver", signal.SIGSTOP)
    witness.until("driver stopped: released", stood_s, witness.let_go)
    probe.spin_until(lambda: time.monotonic() - stood_s > 1.5, "a stall of 1.5 s has passed")
    woken_s = processes.send("driver", signal.SIGCONT)
    witness.until("driver goes on: jammed again", woken_s, lambda: witness.energised() and witness.jammed())
    assert ChannelJamState.FAULT not in probe.channel_states().values()

    # The controller dies: vented, reported, and taken up again where the robot stands.
    dead_s = processes.send("controller", signal.SIGKILL)
    stale = {Fault.COMMANDS_STALE}
    witness.until("controller killed: released", dead_s, witness.released_in_silence)
    witness.until("controller killed: reported", dead_s, lambda: witness.missed("driver", "controller"))
    processes.start("controller", "use_sim_time:=true")
    witness.until("controller again: jammed", time.monotonic(), lambda: witness.energised() and witness.jammed())

    # The controller stands still: the same, and it goes on by itself.
    stood_s = processes.send("controller", signal.SIGSTOP)
    witness.until("controller stopped: released", stood_s, witness.released_in_silence)
    processes.send("controller", signal.SIGCONT)
    woken_s = time.monotonic()
    witness.until("controller goes on: jammed again", woken_s, lambda: witness.energised() and witness.jammed())

    # The driver is stopped in order: it releases everything before it ends, and nobody misses it.
    ended_s = processes.send("driver", signal.SIGTERM)
    probe.spin_until(lambda: processes.running["driver"].poll() is not None, "the driver has ended")
    witness.until(
        "driver ended: released",
        ended_s,
        lambda: not witness.energised() and not probe.last(ACTUATOR_STATES).host_silent,
    )
    assert processes.running["driver"].returncode == 0
    processes.start("driver", "use_sim_time:=true")
    probe.spin_until(lambda: witness.energised() and witness.jammed(), "another driver jams again")

    # The driver dies: the board lets go; a new driver follows the controller that is there.
    dead_s = processes.send("driver", signal.SIGKILL)
    witness.until("driver killed: released", dead_s, witness.let_go)
    witness.until("driver killed: reported", dead_s, lambda: witness.missed("sim", "driver"))
    assert "released" in witness.probe.line("/sim: commands").message
    processes.start("driver", "use_sim_time:=true")
    witness.until("driver again: jammed", time.monotonic(), lambda: witness.energised() and witness.jammed())

    # An emergency stop latches until it is cleared.
    stop = probe.publisher(EMERGENCY_STOP)
    probe.spin_until(lambda: stop.get_subscription_count() > 0, "the driver receives emergency_stop")
    stop.publish(Bool(data=True))
    stopped_s = time.monotonic()
    witness.until(
        "emergency stop: released",
        stopped_s,
        lambda: probe.last(JAM_STATE).emergency_stopped and not witness.energised(),
    )
    assert not probe.call(CLEAR_FAULT).success
    stop.publish(Bool(data=False))
    probe.spin_until(lambda: probe.call(CLEAR_FAULT).success, "the stop is cleared")
    assert not witness.energised()

    # The simulation stands still, and time with it: that is reported, and nothing has happened to the ankle.
    stood_s = processes.send("sim", signal.SIGSTOP)
    witness.until("sim stopped: reported", stood_s, lambda: witness.clock_missed("driver"))
    processes.send("sim", signal.SIGCONT)
    probe.spin_until(lambda: not witness.clock_missed("driver"), "the clock ticks again")
    assert ChannelJamState.FAULT not in probe.channel_states().values()

    # safe_state hold: without a controller the solenoids stay, with the pump off, until somebody vents.
    processes.send("driver", signal.SIGTERM)
    probe.spin_until(lambda: processes.running["driver"].poll() is not None, "the driver has ended again")
    processes.start("driver", "use_sim_time:=true", "safe_state:=hold")
    probe.spin_until(lambda: witness.energised() and witness.jammed(), "a driver that holds jams")
    dead_s = processes.send("controller", signal.SIGKILL)
    witness.until("hold, controller killed: pump off", dead_s, lambda: witness.faults() == stale and witness.pump_off())
    assert witness.energised()
    assert probe.call(UNJAM_ALL).success
    probe.spin_until(lambda: not witness.energised(), "a held ankle is vented by ~/unjam_all")
    processes.start("controller", "use_sim_time:=true")
    probe.received[DIAGNOSTICS.name].clear()
    probe.spin_until(
        lambda: "sim" in probe.line("/driver: nodes").message,
        "the driver receives the simulation's",
    )
    probe.spin_until(lambda: probe.line("/controller: nodes").name != "", "the controller is there again")

    # The simulation dies: there is no ankle any more.
    dead_s = processes.send("sim", signal.SIGKILL)
    witness.until("sim killed: reported", dead_s, lambda: witness.clock_missed("driver"))

    # Stopped in order, nobody is missed.
    ended_s = processes.send("controller", signal.SIGTERM)
    witness.until("controller ended", ended_s, lambda: processes.running["controller"].poll() is not None)
    assert processes.running["controller"].returncode == 0
    for what, took_s in witness.seen_s.items():
        sys.stdout.write(f"{what}: {took_s:.2f} s\n")
