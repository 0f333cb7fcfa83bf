"""A rig on the running graph: what tears shows on diagnostics, in the result, and in the bag."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticStatus
from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rclpy.action import ActionClient

from graph import messages_of
from jammkle_common.names import CLOCK, DIAGNOSTICS, JAM_STATE, RUN_RIG, TENDON_STATES
from jammkle_msgs.action import RunRig
from jammkle_msgs.msg import TendonState

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from graph import Probe, Up


def _holds(bag: Path, text: bytes) -> bool:
    """Whether the recorder, which is still writing, has heard a message with this text, and has flushed it."""
    file = next(bag.glob("*.mcap"), None)
    if file is None:
        return False
    with file.open("rb") as stream, contextlib.suppress(McapError):  # it has no end yet
        records = StreamReader(stream).records
        return any(isinstance(record, Message) and text in record.data for record in records)
    return False


def test_a_torn_tendon_is_in_the_bag(
    start: Callable[..., Up], make_probe: Callable[..., Probe], left_alone: tuple[str, str], tmp_path: Path
) -> None:
    """A pull to the break, by ~/run_rig: BROKEN and ERROR are recorded, and the recorded clock never falls."""
    bag = tmp_path / "bag"
    up = start("up", *left_alone, "--record", str(bag), "--speed", "4")
    probe = make_probe()
    probe.listen(JAM_STATE)
    probe.wait_until_up()
    client = ActionClient(probe.node, RunRig, RUN_RIG.path)
    probe.spin_until(client.server_is_ready, "the action is offered")
    probe.spin_until(lambda: _holds(bag, b"/sim: tendons"), "the recorder hears the simulation")
    sent = client.send_goal_async(
        RunRig.Goal(rig="tensile", options=["speed_m_s=0.1", "extension_m=0.07", "vacuum_pa=0"])
    )
    probe.spin_until(sent.done, "the goal is accepted")
    answer = sent.result().get_result_async()
    probe.spin_until(answer.done, "the rig is done")
    assert answer.result().status == GoalStatus.STATUS_SUCCEEDED
    assert "tendon broken: peroneal_left" in answer.result().result.message
    client.destroy()
    # a busy recorder may have lost it on the way, and who sends it again must still be there
    probe.spin_until(lambda: _holds(bag, b"tendon broken"), "the recorder has heard of it")
    assert up.stop() == 0, up.text()

    states = messages_of(bag, f"/{TENDON_STATES.name}")
    broken = [state for state in states if any(each.condition == TendonState.BROKEN for each in state.tendons)]
    assert broken
    assert all(each.tension_n == 0.0 for each in broken[-1].tendons)
    statuses = [status for report in messages_of(bag, DIAGNOSTICS.name) for status in report.status]
    for about in ("/sim: rig", "/sim: tendons"):
        told = [(status.level, status.message) for status in statuses if status.name == about]
        assert any(level == DiagnosticStatus.ERROR[0] and "peroneal_left" in message for level, message in told), told
    ticks_ns = [tick.clock.sec * 10**9 + tick.clock.nanosec for tick in messages_of(bag, CLOCK.name)]
    assert ticks_ns == sorted(ticks_ns)
