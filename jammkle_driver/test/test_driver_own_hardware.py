"""Hardware that an installed package brings along: the driver's process finds it by its entry point, and drives it."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from fake_ankle import graph_of_its_own
from std_srvs.srv import Trigger

from jammkle_common import names
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from driver_graph import Graph

MODULE = '''
"""Valves that work at once, and a pump that needs none: pressures are what the command says."""

from rclpy.clock import Clock, ClockType

from jammkle_driver.core.hardware import LinkState, LinkStatus, released
from jammkle_driver.hardware import Measured
from jammkle_common.names import CHANNELS
from jammkle_common.parameters import ParameterError


class Bench:
    def __init__(self, context):
        self.link = LinkStatus(LinkState.CONNECTED, f"a bench at {context.parameters.port}")
        self._node = context.node
        self._command = released(CHANNELS)
        self._measured = Measured(context, CHANNELS)
        self._timer = context.node.create_timer(0.01, self._read, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @staticmethod
    def check(parameters):
        if not parameters.port.startswith("bench:"):
            raise ParameterError(f"parameter 'port' is '{parameters.port}'; it must be bench:NUMBER")

    def apply(self, command):
        self._command = command

    def acknowledge(self):
        pass

    def close(self):
        self._node.destroy_timer(self._timer)
        self._measured.close()

    def _read(self):
        vacuums_pa = {place: 50e3 if self._command.solenoids[place] else 0.0 for place in CHANNELS}
        self._measured.publish({place: 101325.0 - pa for place, pa in vacuums_pa.items()}, self._command)
'''
ENTRY_POINTS = """
[jammkle.hardware]
our_bench = our_bench:Bench
"""
METADATA = "Metadata-Version: 2.1\nName: our-bench\nVersion: 1.0\n"


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """Install a package of one module as pip does, into a folder of its own."""
    (tmp_path / "our_bench.py").write_text(MODULE)
    about = tmp_path / "our_bench-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(METADATA)
    (about / "entry_points.txt").write_text(ENTRY_POINTS)
    return tmp_path


@pytest.fixture
def graph() -> Iterator[Graph]:
    with graph_of_its_own() as graph:
        yield graph


def start(graph: Graph, installed: Path, **parameters: str) -> subprocess.Popen[str]:
    """Start the driver's process on a path that holds what is installed."""
    given = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    path = os.pathsep.join(filter(None, (str(installed), os.environ.get("PYTHONPATH"))))
    return subprocess.Popen(
        [sys.executable, "-m", "jammkle_driver", "--ros-args", *given],
        env={**os.environ, "PYTHONPATH": path, "ROS_DOMAIN_ID": str(graph.domain_id)},
        stderr=subprocess.PIPE,
        text=True,
    )


def test_hardware_of_a_users_own_is_driven(graph: Graph, installed: Path) -> None:
    """Its readings are published, its solenoids follow a jam, and the link's line says what it is."""
    with start(graph, installed, hardware="our_bench", port="bench:7", diagnose="false") as process:
        try:
            graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.UNJAMMED))
            assert graph.call(Trigger, names.JAM_ALL.path).success
            graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
            graph.spin_until(lambda: "link" in graph.ankle.lines)
            assert graph.ankle.lines["link"].message == "connected: a bench at bench:7"
            assert graph.ankle.lines["link"].hardware_id == "our_bench"
            process.terminate()
            graph.spin_until(graph.ankle.released)
        finally:
            process.kill()
        process.communicate()


@pytest.mark.parametrize(
    ("hardware", "words"),
    [
        ("our_bunch", "parameter 'hardware' is 'our_bunch'; it must be one of fake, modbus, our_bench, sim"),
        ("our_bench", "parameter 'port' is ''; it must be bench:NUMBER"),
    ],
)
def test_what_is_not_there_or_not_to_be_had_ends_the_start(
    graph: Graph, installed: Path, hardware: str, words: str
) -> None:
    """A wrong name is refused with all that are installed, and parameters in the hardware's own words: one line."""
    with start(graph, installed, hardware=hardware) as process:
        _, said = process.communicate()
    assert process.returncode == 2
    assert words in said
    assert len(said.splitlines()) == 1
