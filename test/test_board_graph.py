"""The whole way from a service to the pins and back: driver process, real bytes, firmware, plant; safe states."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from board_scene import EVENTS, EVERYTHING, Scene, all_off, cable, pump_off, repair, sigkill
from boards import AVR, board_command
from graph import environment
from jammkle_graph.names import MANIFOLD_PRESSURE
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

SCHEDULING_S = 0.5
"""How late a busy machine may run driver and board."""
STALE_S = 0.5
"""The driver's command_timeout_s."""


@pytest.fixture(scope="module")
def command(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return board_command(tmp_path_factory.mktemp("firmware"))


@pytest.fixture
def make_scene(command: list[str], tmp_path: Path, domain_id: int) -> Iterator[Callable[..., Scene]]:
    made: list[Scene] = []

    def make(**parameters: str) -> Scene:
        made.append(Scene(command, tmp_path / "board", domain_id, **parameters))
        return made[-1]

    yield make
    for scene in made:
        scene.close()


def test_a_jam_goes_all_the_way_and_every_safe_state_is_taken_in_time(make_scene: Callable[..., Scene]) -> None:
    """A service jams to the measured vacuum; whatever befalls driver, line or board vents in time; the next jams."""
    scene = make_scene()
    for name, (happen, within_s) in EVENTS.items():
        scene.jam()
        assert scene.probe.last(MANIFOLD_PRESSURE).fluid_pressure == pytest.approx(51325.0, abs=4e3)
        took_s = scene.delay_s(happen(scene), all_off)
        assert took_s < within_s + SCHEDULING_S, name
        repair(scene)
    scene.probe.wait_for_channels(ChannelJamState.UNJAMMED)  # the driver that was started after the killed one


def test_stale_commands_vent(make_scene: Callable[..., Scene]) -> None:
    """A stream of commands that ends, as with a controller that was killed, vents after its timeout."""
    scene = make_scene()
    sent_s = scene.stream_jam()
    took_s = scene.delay_s(sent_s, all_off)
    assert took_s < STALE_S + 0.1 + SCHEDULING_S
    if not AVR:  # whose simulator, on a busy machine, may lose the line before
        assert took_s >= STALE_S


@pytest.mark.parametrize("happen", [sigkill, cable])
def test_hold_keeps_tendons_connected_where_the_host_is_gone(
    make_scene: Callable[..., Scene], happen: Callable[[Scene], float]
) -> None:
    """With safe_state hold the pump stops in time, and the solenoids stay."""
    scene = make_scene(safe_state="hold")
    scene.jam()
    scene.delay_s(happen(scene), pump_off)
    assert scene.bench.edges[-1].solenoids == EVERYTHING


def test_the_link_is_told_on_diagnostics(make_scene: Callable[..., Scene]) -> None:
    """An unplugged board is an error with what to do, and a replugged one is well, with nothing restarted."""
    scene = make_scene()
    scene.jam()
    scene.bench.tell("unplug")
    scene.probe.spin_until(lambda: scene.link().level == DiagnosticStatus.ERROR, "the link is an error")
    assert "plug the board in" in scene.link().message or "gone" in scene.link().message
    scene.probe.wait_for_channels(ChannelJamState.FAULT)
    scene.bench.tell("plug")
    scene.probe.spin_until(lambda: "lost" not in scene.link().message, "the link is back")
    scene.jam()


def test_a_port_that_is_none_ends_the_driver_with_one_line(domain_id: int) -> None:
    """The node says what is wrong with `port`, and does not pretend to run."""
    arguments = [sys.executable, "-m", "jammkle_driver", "--ros-args", "-p", "hardware:=modbus", "-p", "port:=ttyUSB0"]
    result = subprocess.run(arguments, env=environment(domain_id), capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "'port'" in result.stderr
    assert len(result.stderr.splitlines()) == 1
