"""What stops a channel by itself: silence of a stream or a sensor, the emergency stop; and what time may do."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_driver.core.requests import RequestError
from jammkle_driver.core.watch import Instant, Watchdog

if TYPE_CHECKING:
    from collections.abc import Callable


CHANNELS = ("left", "right", "achilles")


def test_a_silent_stream_is_taken_back(make_rig: Callable[..., Any]) -> None:
    """What jam_command jammed is vented after command_timeout_s, with a reason; what a service jammed stays."""
    rig = make_rig(pressure_timeout_s=60.0).active()
    rig.follow(left=50e3, right=50e3)
    rig.driver.jam(["right"], 50e3, "t")
    rig.wait(0.4)
    rig.follow(left=50e3)
    rig.wait(0.4)
    rig.driver.tick(rig.now)
    assert rig.wanted_pa("left") == 50e3
    rig.wait(0.2)
    rig.driver.tick(rig.now)
    assert rig.wanted_pa("left") == 0.0
    assert "command_timeout_s" in rig.channel("left").why.text
    assert rig.wanted_pa("right") == 50e3


def test_a_paused_simulation_is_no_silence(make_rig: Callable[..., Any]) -> None:
    """While simulated time stands, neither pressure nor command goes stale, however long that takes."""
    rig = make_rig().active()
    rig.follow(left=50e3)
    rig.wait(100.0, 0.0)
    rig.driver.tick(rig.now)
    assert rig.wanted_pa("left") == 50e3
    assert rig.channel("left").state is ChannelState.JAMMING


@given(bad=st.sampled_from([math.nan, math.inf, -math.inf]))
def test_a_sensor_that_fails_faults_its_channel_alone(make_rig: Callable[..., Any], bad: float) -> None:
    """Silence or readings that are no numbers release the channel with a reason until it is cleared."""
    rig = make_rig().active()
    rig.driver.jam([], 0.0, "t")
    for _ in range(8):
        rig.wait(0.1)
        rig.measure(10e3, "right", "achilles", MANIFOLD)
        rig.measure(bad, "left")
        rig.driver.tick(rig.now)
    left = rig.channel("left")
    assert left.state is ChannelState.FAULT
    assert "pressure_timeout_s" in left.why.text
    assert rig.driver.command.solenoids == {"left": False, "right": True, "achilles": True}
    with pytest.raises(RequestError, match="clear_fault"):
        rig.driver.jam([], 0.0, "t")
    rig.driver.clear_fault(rig.now)
    rig.measure(0.0, "left")
    assert rig.channel("left").state is ChannelState.UNJAMMED
    assert not rig.driver.command.solenoids["left"]


def test_an_emergency_stop_survives_the_lifecycle(make_rig: Callable[..., Any]) -> None:
    """Deactivate, cleanup and activate do not clear a stop."""
    rig = make_rig().active()
    rig.driver.emergency_stop(stop=True, now=rig.now)
    rig.driver.emergency_stop(stop=False, now=rig.now)
    rig.driver.deactivate()
    rig.driver.reset()
    rig.active()
    with pytest.raises(RequestError, match="emergency stop"):
        rig.driver.jam([], 0.0, "t")


def test_a_silent_emergency_stop_stops_where_so_configured(make_rig: Callable[..., Any]) -> None:
    """With emergency_stop_timeout_s, silence stops; without, it does not."""
    for timeout_s, stops in ((0.0, False), (1.0, True)):
        rig = make_rig(emergency_stop_timeout_s=timeout_s).active()
        rig.wait(0.9)
        rig.driver.tick(rig.now)
        assert not rig.driver.stop.reason
        rig.wait(0.2)
        rig.driver.tick(rig.now)
        assert bool(rig.driver.stop.reason) is stops


def test_time_that_runs_backwards_is_survived(make_rig: Callable[..., Any]) -> None:
    """A simulation that was started anew with an earlier clock neither faults nor blocks a channel."""
    rig = make_rig().active()
    rig.driver.jam(["left"], 0.0, "t")
    rig.wait(0.01, -90.0)
    rig.measure(20e3)
    rig.driver.tick(rig.now)
    rig.wait(0.01)
    rig.measure(49e3)
    assert rig.channel("left").state is ChannelState.JAMMED


@given(
    timeout_s=st.floats(0.01, 10.0),
    steps=st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0)), max_size=20),
)
def test_a_watchdog_counts_the_time_that_the_ankle_lives_in(timeout_s: float, steps: list[tuple[float, float]]) -> None:
    """It expires exactly when that has passed the timeout since it was fed, whatever real time does; unfed, never."""
    watchdog = Watchdog(timeout_s)
    now = Instant(0.0, 0.0)
    assert not watchdog.expired(Instant(1e9, 1e9))
    watchdog.feed(now)
    for steady_s, graph_s in steps:
        now = Instant(now.steady_s + steady_s, now.graph_s + graph_s)
        assert watchdog.expired(now) is (now.graph_s > timeout_s)


def test_what_others_do_to_the_air_is_no_fault_of_an_inactive_driver(make_rig: Callable[..., Any]) -> None:
    """A rig evacuates the manifold while the driver only looks on: nothing is concluded, then or once it is active."""
    rig = make_rig(diagnose=True, fault_policy="ankle")
    for manifold_pa in (40e3, 0.0):
        for _ in range(300):
            rig.wait(0.01)
            rig.measure(manifold_pa, MANIFOLD)
            rig.measure(0.0, *CHANNELS)
            rig.driver.tick(rig.now)
        assert {channel.why.reason for channel in rig.driver.ankle.channels.values()} == {Reason.NONE}
        rig.active()
