"""The sim node as a process: how it starts, ends, refuses, and what it does not load."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from typing import TYPE_CHECKING

import pytest
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TIMEOUT_S = 60.0
BAD_INPUT = 2


@pytest.fixture
def start_sim(sim_domain_id: int) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start `python -m jammkle_sim` with ROS arguments; whatever still runs at the end is ended."""
    processes: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "jammkle_sim", "--ros-args", *arguments]
        environment = {**os.environ, "ROS_DOMAIN_ID": str(sim_domain_id)}
        processes.append(
            subprocess.Popen(command, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        )
        return processes[-1]

    yield start
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture
def wait_for_clock(sim_domain_id: int) -> Iterator[Callable[[], None]]:
    """Wait until somebody publishes /clock."""
    rclpy.init(domain_id=sim_domain_id)
    node = rclpy.create_node("waiting")
    ticked = threading.Event()
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_subscription(Clock, "/clock", lambda _: ticked.set(), qos)

    def wait() -> None:
        for _ in range(int(TIMEOUT_S / 0.1)):
            rclpy.spin_once(node, timeout_sec=0.1)
            if ticked.is_set():
                return
        pytest.fail(f"no /clock within {TIMEOUT_S} s")

    yield wait
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.parametrize(
    ("argument", "text"),
    [
        ("imu_rate:=500", "unknown parameter 'imu_rate'; known are: "),
        ("imu_rate_hz:=300", "300 Hz does not fit timestep_s of 0.0005 s; the rate must divide 2000 Hz, as 250 or 400"),
        ("speed:=-1.0", "parameter 'speed' is -1; it must be 0 to 100 s/s"),
    ],
)
def test_bad_parameters_end_it_with_one_line(
    start_sim: Callable[..., subprocess.Popen[str]], argument: str, text: str
) -> None:
    """Exit code 2 and one line that names the value and what would be right."""
    process = start_sim("-p", argument)
    _output, errors = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == BAD_INPUT
    assert text in errors
    assert len(errors.strip().splitlines()) == 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_it_cleanly(
    start_sim: Callable[..., subprocess.Popen[str]], wait_for_clock: Callable[[], None], number: signal.Signals
) -> None:
    """SIGTERM and SIGINT while running: exit code 0, and nothing to read."""
    process = start_sim()
    wait_for_clock()
    process.send_signal(number)
    _output, errors = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 0
    assert errors == ""


def test_no_graphics_library_is_loaded() -> None:
    """Nothing that draws is imported or mapped by a process that simulates: it starts without a display."""
    program = (
        "import sys\n"
        "from jammkle_sim.kinds import make_simulation\n"
        "from jammkle_sim.node import SimNode\n"
        "from jammkle_sim.parameters import SimParameters\n"
        "make_simulation(SimParameters()).advance(10)\n"
        "drawing = ('glfw', 'OpenGL', 'mujoco.glfw', 'mujoco.egl', 'mujoco.osmesa', 'mujoco.viewer', 'matplotlib')\n"
        "print('modules', [name for name in drawing if name in sys.modules])\n"
        "maps = open('/proc/self/maps').read()\n"
        "print('libraries', [name for name in ('libGL', 'libEGL', 'libOSMesa', 'libglfw') if name in maps])\n"
    )
    environment = {key: value for key, value in os.environ.items() if key not in {"MUJOCO_GL", "DISPLAY"}}
    output = subprocess.check_output([sys.executable, "-c", program], env=environment, text=True, timeout=TIMEOUT_S)
    assert output.splitlines() == ["modules []", "libraries []"]
