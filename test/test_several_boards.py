"""A quadruped on hardware: four drivers with a board each, or with the built-in plant."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

from board_bench import BoardBench
from jammkle_common.command.main import EXIT_FAILED
from jammkle_common.names import ACHILLES, JAM_STATE, QUADRUPED_ANKLES
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from graph import Probe, Up

ACHILLES_BIT = 4
"""Place of the channel among the solenoids of the shipped wiring, at the pins."""
ALL_BITS = 7
TRIES = 10
"""Of a command, where four boards and nine processes share two cores."""
FIRST, *OTHERS = QUADRUPED_ANKLES


def pins(board: BoardBench) -> int:
    """Return which solenoids of a board are energised now, a bit each."""
    return board.edges[-1].solenoids if board.edges else 0


def look_on(make_probe: Callable[..., Probe]) -> dict[str, Probe]:
    """Listen to each ankle, and wait until its driver knows its channels."""
    probes = {ankle: make_probe(f"/{ankle}") for ankle in QUADRUPED_ANKLES}
    for probe in probes.values():
        probe.listen(JAM_STATE)
    for probe in probes.values():
        probe.wait_until_up()
    return probes


def jam(start: Callable[..., Up], *arguments: str) -> None:
    """Jam by command, and again where the machine kept a board or a driver waiting just then."""
    for _ in range(TRIES):
        asked = start("jam", *arguments)
        if (code := asked.wait()) == 0:
            return
        assert code == EXIT_FAILED, asked.text()
    msg = f"`jam {' '.join(arguments)}` failed {TRIES} times"
    raise AssertionError(msg)


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_each_ankle_has_its_own_board(
    command: list[str], start: Callable[..., Up], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """One channel of one ankle is one pin of one board; all are jammed by one command; the end vents every board.

    A board lets go of a driver that a busy machine keeps waiting, or does not answer in time, and is jammed again; none
    of that is a fault.
    """
    sections = [f"/{ankle}/driver: {{ros__parameters: {{port: {tmp_path / ankle}}}}}\n" for ankle in QUADRUPED_ANKLES]
    sections.append("/**/controller: {ros__parameters: {auto_at_start: false}}\n")
    (tmp_path / "ports.yaml").write_text("".join(sections))
    with ExitStack() as stack:
        boards = {
            ankle: stack.enter_context(BoardBench(command, tmp_path / ankle, store=tmp_path / f"{ankle}.store"))
            for ankle in QUADRUPED_ANKLES
        }
        hardware = ("--hardware", "modbus", "--params", str(tmp_path / "ports.yaml"))
        up = start("up", "--robot", "quadruped", *hardware)
        probes = look_on(make_probe)
        jam(start, ACHILLES, "--namespace", FIRST)
        probes[FIRST].spin_jammed_until(
            lambda: (
                probes[FIRST].channel_states().get(ACHILLES) == ChannelJamState.JAMMED
                and pins(boards[FIRST]) == ACHILLES_BIT
            ),
            f"{ACHILLES} is jammed",
            ACHILLES,
        )
        assert [pins(boards[ankle]) for ankle in OTHERS] == [0, 0, 0]
        jam(start)
        for ankle, probe in probes.items():
            probe.wait_until_jammed(lambda board=boards[ankle]: pins(board) == ALL_BITS)
        reported = [
            channel for probe in probes.values() for said in probe.received[JAM_STATE.name] for channel in said.channels
        ]
        assert {channel.state for channel in reported} & {ChannelJamState.FAULT} == set()
        assert up.stop() == 0, up.text()
        probes[FIRST].spin_until(lambda: not any(pins(board) for board in boards.values()), "every board has let go")


def test_a_quadruped_of_built_in_plants(start: Callable[..., Up], make_probe: Callable[..., Probe]) -> None:
    up = start("up", "--robot", "quadruped", "--hardware", "fake", "-p", "controller:auto_at_start:=false")
    probes = look_on(make_probe)
    assert start("jam").wait() == 0
    for probe in probes.values():
        probe.wait_until_jammed()
    assert up.stop() == 0, up.text()
