"""The whole way from a service to the pins and back: driver process, real bytes, firmware, plant; safe states."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from board_scene import EVENTS, EVERYTHING, HELD_VACUUM_PA, Scene, all_off, cable, pump_off, repair, sigkill
from boards import AVR, board_command
from graph import environment
from jammkle_graph.constants import STANDARD_ATMOSPHERE_PA
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

HELD_PA = STANDARD_ATMOSPHERE_PA - HELD_VACUUM_PA
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


def test_a_jam_goes_all_the_way_and_every_mishap_ends_in_the_safe_state(make_scene: Callable[..., Scene]) -> None:
    """A service jams to the measured vacuum; whatever befalls driver, controller, line or board vents; the next jams.

    Within what time is measured by `make bench`, and printed here.
    """
    scene = make_scene()
    for name, event in EVENTS.items():
        event.jam(scene)
        scene.probe.spin_until(lambda: scene.manifold_pa() == pytest.approx(HELD_PA, abs=4e3), "drawn to the set point")
        took_s = scene.delay_s(event.happen(scene), all_off)
        sys.stdout.write(f"{name}: {took_s:.3f} s\n")
        repair(scene)
    scene.probe.wait_for_channels(ChannelJamState.UNJAMMED)  # the driver that was started after the killed one


def test_stale_commands_vent_later_than_a_pulled_cable(make_scene: Callable[..., Scene]) -> None:
    """A stream of commands that ends vents after its timeout; the board's watchdog, which is shorter, is sooner."""
    scene = make_scene()
    stale_s = scene.delay_s(scene.stream_jam(), all_off)
    if not AVR:  # whose simulator, on a busy machine, may lose the line before
        assert stale_s >= STALE_S
    scene.jam()
    assert scene.delay_s(cable(scene), all_off) < stale_s


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
