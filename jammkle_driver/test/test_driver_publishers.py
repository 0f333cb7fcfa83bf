"""Several publishers of one topic: an emergency stop is the OR of all, and one alone commands jamming."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_driver.core.requests import EmergencyStop, Publication, RequestError, SetPoint
from jammkle_driver.core.watch import Instant

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

STEP_S = 0.05


class Source:
    """A publisher that counts its messages, as the middleware does for it."""

    def __init__(self, number: int = 0) -> None:
        self.number = number
        self.says = False

    def publication(self, sent_ns: int, publishers: int) -> Publication:
        self.number += 1
        return Publication(self.number, sent_ns, publishers)


class Scene:
    """Publishers of emergency_stop around an `EmergencyStop`, in a time that goes on with every message."""

    def __init__(self, sources: int, timeout_s: float = 0.0) -> None:
        self.sources = [Source() for _ in range(sources)]
        self.stop = EmergencyStop(timeout_s)
        self.time_s = 0.0

    @property
    def now(self) -> Instant:
        return Instant(self.time_s, self.time_s)

    def publish(self, source: Source, *, stop: bool, deliveries: int = 1) -> None:
        self.time_s += STEP_S
        source.says = stop
        publication = source.publication(round(self.time_s * 1e9), len(self.sources))
        for _ in range(deliveries):
            self.stop.take(publication, self.now, stop=stop)

    def wait(self, time_s: float) -> None:
        for _ in range(round(time_s / STEP_S)):
            self.time_s += STEP_S
            self.stop.tick(len(self.sources), self.now)


MESSAGES = st.lists(st.tuples(st.integers(0, 3), st.booleans(), st.integers(0, 3)), max_size=40)


@given(sources=st.integers(1, 4), begun=st.lists(st.integers(0, 3), min_size=4, max_size=4), messages=MESSAGES)
def test_a_stop_is_asked_for_as_long_as_anybody_asks(
    sources: int, begun: list[int], messages: list[tuple[int, bool, int]]
) -> None:
    """Whatever came once, several times or not at all, in whatever order: true of one is never taken back by others."""
    scene = Scene(sources)
    for source, number in zip(scene.sources, begun, strict=False):
        source.number = number
    said: dict[int, bool] = {}
    for index, stop, deliveries in messages:
        place = index % sources
        scene.publish(scene.sources[place], stop=stop, deliveries=deliveries)
        if deliveries:
            said[place] = stop
        assert bool(scene.stop.asked_by) >= any(said.values())
    for _ in range(2):
        for source in scene.sources:
            scene.publish(source, stop=False)
    if all(deliveries for _, _, deliveries in messages) and not any(begun):
        assert scene.stop.asked_by == 0
        assert not scene.stop.clear(scene.now)


def test_false_of_one_frees_nobody_from_true_of_another() -> None:
    """Neither while both live, nor by clear_fault; the one that asked takes it back."""
    scene = Scene(2)
    hand, teleoperation = scene.sources
    scene.publish(hand, stop=True)
    for _ in range(100):
        scene.publish(teleoperation, stop=False)
        scene.stop.tick(2, scene.now)
    assert "from 1 of 2 publishers" in scene.stop.clear(scene.now)
    assert scene.stop.way_out == "release it, then call ~/clear_fault"
    scene.publish(hand, stop=False)
    assert (scene.stop.reason, scene.stop.way_out) == ("emergency_stop was true", "call ~/clear_fault")
    assert not scene.stop.clear(scene.now)


def test_a_publisher_that_has_left_asks_until_another_says_false() -> None:
    """`ros2 topic pub --once` with true, then with false: two publishers, of which the first is gone."""
    scene = Scene(1)
    scene.publish(scene.sources[0], stop=True)
    scene.sources.clear()
    scene.wait(2.0)
    assert scene.stop.clear(scene.now)
    scene.sources.append(Source())
    scene.publish(scene.sources[0], stop=False)
    assert not scene.stop.clear(scene.now)


@pytest.mark.parametrize("first", [1, 5])
def test_a_true_that_its_own_false_overtakes_stops(first: int) -> None:
    """Of two subscriptions the newer message may come first: the stop holds, and nobody is left who still asks."""
    scene = Scene(1)
    if first > 1:
        scene.stop.take(Publication(first - 1, 50, 1), scene.now, stop=False)
    scene.stop.take(Publication(first + 1, 200, 1), scene.now, stop=False)
    scene.stop.take(Publication(first, 100, 1), scene.now, stop=True)
    assert scene.stop.reason
    assert not scene.stop.clear(scene.now)
    scene.stop.take(Publication(first, 100, 1), scene.now, stop=True)
    assert not scene.stop.reason, "what is delivered twice stops once"


def test_a_stop_node_that_is_started_anew_takes_back_its_own_stop() -> None:
    """It died while true, and is there again before its end was seen, publishing on change: its second false counts."""
    scene = Scene(1)
    scene.publish(scene.sources[0], stop=True)
    scene.sources = [Source()]
    scene.publish(scene.sources[0], stop=False)
    scene.wait(3.0)
    scene.publish(scene.sources[0], stop=False)
    assert not scene.stop.clear(scene.now)


def test_each_publisher_must_live() -> None:
    """Silence of one is a stop though the other goes on; once cleared, one that never comes back is missed no more."""
    scene = Scene(2, timeout_s=1.0)
    first, second = scene.sources
    for _ in range(10):
        for source in (first, second):
            scene.publish(source, stop=False)
        scene.stop.tick(2, scene.now)
    assert not scene.stop.reason
    for _ in range(25):
        scene.publish(first, stop=False)
        scene.stop.tick(2, scene.now)
    assert scene.stop.reason == "no emergency_stop from 1 of 2 publishers for 1 s (emergency_stop_timeout_s)"
    assert not scene.stop.clear(scene.now)
    for _ in range(25):
        scene.publish(first, stop=False)
        scene.stop.tick(1, scene.now)
    assert not scene.stop.reason
    scene.wait(1.5)
    assert scene.stop.reason


def follow(rig: Any, source: Source, vacuum_pa: float, publishers: int) -> None:
    publication = source.publication(round(rig.now.graph_s * 1e9) + source.number, publishers)
    rig.driver.follow([SetPoint("left", vacuum_pa)], rig.now, "jam_command", publication=publication)


def pause(rig: Any) -> None:
    rig.wait(STEP_S)
    rig.measure(0.0)
    rig.driver.tick(rig.now)


def test_two_that_contradict_one_another_do_not_take_turns(make_rig: Callable[..., Any]) -> None:
    """At 20 Hz each: the latest change wins and stays, it is reported, and silence of the followed one vents."""
    rig = make_rig().active()
    controller, mission = Source(), Source(number=40)
    commanded = []
    for _ in range(20):
        follow(rig, controller, 0.0, 2)
        follow(rig, mission, 40e3, 2)
        pause(rig)
        commanded.append(rig.wanted_pa("left"))
    assert commanded == [40e3] * len(commanded)
    assert rig.driver.streams.speaking == 2
    follow(rig, controller, 30e3, 2)
    follow(rig, mission, 40e3, 2)
    assert rig.wanted_pa("left") == 30e3
    for _ in range(40):
        follow(rig, mission, 40e3, 1)
        pause(rig)
    assert rig.wanted_pa("left") == 0.0
    assert rig.driver.streams.speaking == 1


def test_a_refused_stop_names_who_still_asks(make_rig: Callable[..., Any]) -> None:
    """The driver's own refusal, with the way out, also where nobody is left who could take it back."""
    rig = make_rig().active()
    first, second = Source(), Source()
    for sent_ns, source, stop in ((1, first, True), (2, second, False)):
        publication = source.publication(sent_ns, 2)
        rig.driver.emergency_stop(stop=stop, now=rig.now, publication=publication)
    with pytest.raises(RequestError, match="still true from 1 of 2 publishers; publish false on each of them"):
        rig.driver.clear_fault(rig.now)
    for _ in range(2):
        rig.wait(2.0)
        rig.driver.tick(rig.now, 0)
    with pytest.raises(RequestError, match=r"2 publishers \(1 left the graph while true: a false of any other"):
        rig.driver.clear_fault(rig.now)
