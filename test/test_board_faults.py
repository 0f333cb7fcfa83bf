"""What fails behind a board's pins, through firmware, line and node: the reason, the place, the pins, the way back."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest
from faulty_plant import FaultyPlant

from board_scene import Scene, all_off
from boards import AVR
from domains import own_domain
from jammkle_common.names import (
    ACHILLES,
    CHANNELS,
    JAM_ALL,
    JAM_STATE,
    MANIFOLD_PRESSURE,
    PERONEAL_LEFT,
    PERONEAL_RIGHT,
    UNJAM_ALL,
)
from jammkle_driver.fake import FakeFault
from jammkle_msgs.msg import ChannelJamState, Fault
from jammkle_sim.physics.pneumatics import MANIFOLD

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.skipif(AVR, reason="a simulator that is slower than real time delays what is judged by time")

PASSING = {Fault.UNKNOWN, Fault.EXECUTOR_OVERLOADED, Fault.BOARD_LET_GO, Fault.LINE_NOISE}
"""What passes by itself."""
BUSY = (PASSING | {Fault.BOARD_UNPLUGGED}) - {Fault.UNKNOWN}
"""What a machine brings about that is too busy for driver or firmware."""
STOOD_STILL_S = 0.02
"""Longest time for which the plant may stand still: two cycles of the line; then readings are older than they say."""
TRIES = 5
STEADY_READINGS = 150
"""Of the manifold, about a second of them: what begins just as a jam is reached has not always its own name."""


@dataclass(frozen=True)
class Broken:
    """What is broken and how it must be reported."""

    reason: int
    fault: FakeFault
    place: str
    size: float = 0.0
    while_jammed: bool = True


BROKEN = {
    "leak": Broken(Fault.LEAK, FakeFault.LEAK, ACHILLES, 3e-10),
    "leak of the manifold": Broken(Fault.LEAK, FakeFault.LEAK, MANIFOLD, 3e-10),
    "blocked line": Broken(Fault.BLOCKED_LINE, FakeFault.BLOCKED, PERONEAL_RIGHT, 0.05, while_jammed=False),
    "valve stuck open": Broken(Fault.VALVE_STUCK_OPEN, FakeFault.STUCK_OPEN, PERONEAL_LEFT),
    "valve stuck closed": Broken(Fault.VALVE_STUCK_CLOSED, FakeFault.STUCK_CLOSED, ACHILLES, while_jammed=False),
    "pump dead": Broken(Fault.PUMP_DEAD, FakeFault.PUMP_DEAD, MANIFOLD, while_jammed=False),
    "pump weak": Broken(Fault.PUMP_WEAK, FakeFault.PUMP_WEAK, MANIFOLD, 0.25, while_jammed=False),
    "sensor's wire off": Broken(Fault.SENSOR_DEAD, FakeFault.SENSOR_DEAD, ACHILLES),
    "sensor stuck": Broken(Fault.SENSOR_STUCK, FakeFault.SENSOR_STUCK, PERONEAL_RIGHT),
    "sensor drifting": Broken(Fault.SENSOR_DRIFTING, FakeFault.SENSOR_DRIFT, PERONEAL_LEFT, -3e3),
    "sensor off at once": Broken(Fault.SENSOR_DRIFTING, FakeFault.SENSOR_BIAS, ACHILLES, 6e3),
    "sensor out of range": Broken(Fault.SENSOR_OUT_OF_RANGE, FakeFault.SENSOR_OUT_OF_RANGE, ACHILLES, 5e3),
}


@pytest.fixture(scope="module")
def plant() -> FaultyPlant:
    return FaultyPlant()


@pytest.fixture(scope="module")
def scene(command: list[str], plant: FaultyPlant, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    """One driver on one board, on which one thing after the other fails."""
    with pytest.MonkeyPatch.context() as patch, own_domain() as domain_id:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        made = Scene(command, tmp_path_factory.mktemp("port") / "board", domain_id, plant)
        made.know_atmosphere()
        yield made
        made.close()


def worst(scene: Scene) -> Fault:
    """Return the worst that is reported on jam_state."""
    return scene.probe.last(JAM_STATE).fault


def rest(scene: Scene) -> None:
    """Wait until the driver has seen a second of what is."""
    received = scene.probe.received[MANIFOLD_PRESSURE.name]
    received.clear()
    scene.probe.spin_until(lambda: len(received) > STEADY_READINGS, "a second of readings")


def shake_until_reported(scene: Scene, broken: Broken) -> Fault:
    """Jam and vent in turn until a fault is reported, as some show in motion alone; return it."""
    shaken = broken.fault in {FakeFault.STUCK_OPEN, FakeFault.SENSOR_STUCK, FakeFault.PUMP_WEAK}

    def reported() -> bool:
        if worst(scene).reason not in PASSING:
            return True
        if scene.channels_in(ChannelJamState.UNJAMMED):
            scene.probe.call(JAM_ALL)
        elif shaken and scene.channels_in(ChannelJamState.JAMMED):
            scene.probe.call(UNJAM_ALL)
        return False

    scene.probe.spin_until(reported, "a fault is reported")
    return worst(scene)


@pytest.mark.parametrize("name", BROKEN)
def test_what_fails_behind_the_pins_is_reported_apart(scene: Scene, plant: FaultyPlant, name: str) -> None:
    """Reason and place on jam_state, all off at the pins, and a jam again after the repair.

    A busy machine keeps driver or plant waiting, and readings are judged that are older than they say: where that was
    so, and another reason was reported, it is tried anew.
    """
    broken = BROKEN[name]
    for _ in range(TRIES):
        scene.jam()
        if not broken.while_jammed:
            scene.probe.call(UNJAM_ALL)
            scene.probe.wait_for_channels(ChannelJamState.UNJAMMED)
        rest(scene)
        scene.probe.received[JAM_STATE.name].clear()
        scene.bench.longest_gap_s = 0.0
        broke_s = time.monotonic()
        plant.inject(broken.fault, broken.place, broken.size)
        scene.probe.spin_until(lambda: scene.probe.has(JAM_STATE), "jam_state is received")
        reported = shake_until_reported(scene, broken)
        sys.stdout.write(f"{name}: {scene.delay_s(broke_s, all_off):.2f} s, {reported.text}\n")
        disturbed = {each.fault.reason for each in scene.probe.received[JAM_STATE.name]} & BUSY
        plant.heal()
        if reported.reason == broken.reason or not (disturbed or scene.bench.longest_gap_s > STOOD_STILL_S):
            break
    assert reported.reason == broken.reason, reported.text
    assert reported.text.startswith(f"{broken.place} ")
    assert reported.action == "every channel vented until ~/clear_fault"
    failed = {each.channel for each in scene.probe.last(JAM_STATE).channels if each.state == ChannelJamState.FAULT}
    assert failed == (set(CHANNELS) if broken.place == MANIFOLD else {broken.place})
    scene.jam()
