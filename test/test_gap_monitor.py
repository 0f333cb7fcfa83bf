"""The gap monitor on a running graph: it warns of a leak where the leak is, and of nothing without one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus

from jammkle_common.names import (
    DIAGNOSTICS,
    GAP_MONITOR_NODE,
    JAM_ALL,
    JAM_STATE,
    RESET,
    SET_PAUSED,
    SIMULATOR_GAP,
    UNJAM_ALL,
)
from jammkle_msgs.msg import ChannelJamState, SubsystemGap

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from graph import Probe, Up

REPORTS = 10
"""Messages of the monitor, five a second, after which it has looked at what came before them."""
LEAK = "line_leak_manifold:\n  conductance_dm3_s_bar: 0.003\n"


def subsystems(probe: Probe) -> dict[str, SubsystemGap]:
    return {each.name: each for each in probe.last(SIMULATOR_GAP).subsystems}


def lines(probe: Probe) -> list[DiagnosticStatus]:
    """Every line that the monitor has put on /diagnostics."""
    return [
        line
        for array in probe.received[DIAGNOSTICS.name]
        for line in array.status
        if f"{GAP_MONITOR_NODE}: " in line.name
    ]


def jammed(probe: Probe) -> None:
    """Listen, wait until the twin follows, and jam everything."""
    probe.listen(SIMULATOR_GAP, DIAGNOSTICS, JAM_STATE)
    probe.wait_until_up()
    probe.spin_until(
        lambda: {each.state for each in subsystems(probe).values()} == {SubsystemGap.CLOSE},
        "every subsystem is followed, and close",
    )
    assert probe.call(JAM_ALL).success


def test_nothing_is_warned_of_without_an_effect(
    start: Callable[..., Up], make_probe: Callable[..., Probe], left_alone: tuple[str, str]
) -> None:
    """While channels are jammed, vented, jammed again and reset, no subsystem ever leaves its simulator."""
    start("up", "--monitor", *left_alone)
    probe = make_probe()
    jammed(probe)
    probe.wait_until_jammed()
    assert probe.call(UNJAM_ALL).success
    probe.wait_for_channels(ChannelJamState.UNJAMMED)
    assert probe.call(JAM_ALL).success
    probe.wait_until_jammed()
    assert probe.call(RESET).success
    probe.wait_until_jammed()
    since = len(probe.received[SIMULATOR_GAP.name])
    probe.spin_until(lambda: len(probe.received[SIMULATOR_GAP.name]) > since + 4 * REPORTS, "all of it was followed")
    said = [each for message in probe.received[SIMULATOR_GAP.name] for each in message.subsystems]
    assert SubsystemGap.WIDE not in {each.state for each in said}
    # On a busy machine not every report has everything to compare.
    compared = [each for each in said if math.isfinite(each.gap)]
    assert {each.name for each in compared} == set(subsystems(probe))
    assert max(each.gap for each in compared) < probe.last(SIMULATOR_GAP).limit

    # While simulated time stands nothing is missed that comes once a second or more often.
    assert probe.call(SET_PAUSED, data=True).success
    since = len(probe.received[SIMULATOR_GAP.name])
    probe.spin_until(lambda: len(probe.received[SIMULATOR_GAP.name]) > since + 3 * REPORTS, "it reports in a pause")
    assert SubsystemGap.STALE not in {each.state for each in subsystems(probe).values()}


def test_a_leak_is_warned_of_in_the_pneumatics_alone(
    start: Callable[..., Up], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """With a leak in the manifold the pressures leave their simulator; tendons, bodies and sensors do not."""
    (tmp_path / "effects.yaml").write_text(LEAK)
    parameters = tmp_path / "leaking.yaml"
    parameters.write_text(
        f"/**/sim:\n  ros__parameters:\n    release_time_s: 3600.0\n    effects_file: {tmp_path / 'effects.yaml'}\n"
        "/**/controller:\n  ros__parameters:\n    auto_at_start: false\n"
    )
    start("up", "--monitor", "--params", str(parameters))
    probe = make_probe()
    jammed(probe)
    probe.spin_jammed_until(
        lambda: subsystems(probe)["pneumatics"].state == SubsystemGap.WIDE, "the pneumatics are wide"
    )
    found = subsystems(probe)
    assert found["pneumatics"].signal.endswith("/pressure")
    assert found["pneumatics"].gap > probe.last(SIMULATOR_GAP).limit
    assert {name for name, each in found.items() if each.state == SubsystemGap.WIDE} == {"pneumatics"}
    probe.spin_until(lambda: any(line.level == DiagnosticStatus.WARN for line in lines(probe)), "it is warned of")
    warned = {line.name.rpartition(": ")[2] for line in lines(probe) if line.level == DiagnosticStatus.WARN}
    assert warned == {"pneumatics"}
