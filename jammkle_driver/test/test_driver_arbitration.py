"""Who may ask what of the driver: atomic requests, the latest change wins, stopped means released."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from jammkle_common.names import WAY_BACK
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.hardware import MANIFOLD, released
from jammkle_driver.core.requests import RequestError, SetPoint
from jammkle_driver.core.watch import Instant

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_driver.core.driver import Driver


CHANNELS = ("left", "right", "achilles")

channel_names = st.sampled_from(CHANNELS)
vacuums = st.sampled_from([10e3, 30e3, 50e3, 70e3])
bad_vacuums = st.one_of(
    st.sampled_from([math.nan, math.inf, -math.inf, 1.0, -50e3, 70001.0]), st.floats(70001.0), st.floats(max_value=-1.0)
)


class AnythingGoes(RuleBasedStateMachine):
    """Whatever is asked and measured in whatever order, the actuators stay safe and the latest change wins."""

    def __init__(self, rig: Any) -> None:
        super().__init__()
        self.rig = rig
        self.wanted: dict[str, float] = {}

    @initialize()
    def begin(self) -> None:
        self.rig.active()
        self.wanted = dict.fromkeys(CHANNELS, 0.0)

    @rule(names=st.lists(channel_names, unique=True), vacuum_pa=vacuums)
    def jam(self, names: list[str], vacuum_pa: float) -> None:
        others = {pa for name, pa in self.wanted.items() if names and name not in names} - {0.0, vacuum_pa}
        try:
            self.rig.driver.jam(names, vacuum_pa, "test")
        except RequestError:
            return
        assert not others
        self.wanted.update(dict.fromkeys(names or CHANNELS, vacuum_pa))

    @rule(names=st.lists(channel_names, unique=True))
    def unjam(self, names: list[str]) -> None:
        try:
            self.rig.driver.unjam(names, "test")
        except RequestError:
            return
        self.wanted.update(dict.fromkeys(names or CHANNELS, 0.0))

    @rule(vacuum_pa=st.floats(-500.0, 75e3), place=st.sampled_from([*CHANNELS, MANIFOLD]), step_s=st.floats(0.0, 0.4))
    def measure(self, vacuum_pa: float, place: str, step_s: float) -> None:
        self.rig.wait(step_s)
        self.rig.measure(vacuum_pa, place)
        self._forget_failed()

    @rule(names=st.lists(channel_names), vacuum_pa=bad_vacuums)
    def ask_nonsense(self, names: list[str], vacuum_pa: float) -> None:
        before = self.rig.said()
        with pytest.raises(RequestError):
            self.rig.driver.jam(names, vacuum_pa, "test")
        assert self.rig.said() == before

    @rule(vacuums_pa=st.dictionaries(channel_names, st.one_of(st.just(0.0), vacuums)))
    def follow(self, vacuums_pa: dict[str, float]) -> None:
        before = self.rig.said()
        try:
            self.rig.follow(**vacuums_pa)
        except RequestError:
            assert self.rig.said() == before
            return
        self._accept_stream(vacuums_pa)

    @rule(vacuum_pa=st.one_of(st.just(0.0), vacuums))
    def follow_one_vacuum(self, vacuum_pa: float) -> None:
        vacuums_pa = dict.fromkeys(CHANNELS, vacuum_pa)
        if self.rig.driver.active:
            self.rig.follow(**vacuums_pa)
            self._accept_stream(vacuums_pa)

    def _accept_stream(self, vacuums_pa: dict[str, float]) -> None:
        """Every channel has what it had before or what the stream says, the latter only where it is named."""
        for channel in self.rig.driver.ankle.channels.values():
            commanded_pa = channel.set_point_pa
            assert commanded_pa in (self.wanted[channel.name], vacuums_pa.get(channel.name, self.wanted[channel.name]))
            self.wanted[channel.name] = commanded_pa

    @rule()
    def tick(self) -> None:
        self.rig.driver.tick(self.rig.now)
        self._forget_failed()

    @rule(stop=st.booleans())
    def emergency_stop(self, *, stop: bool) -> None:
        self.rig.driver.emergency_stop(stop=stop, now=self.rig.now)
        if stop:
            self.wanted = dict.fromkeys(CHANNELS, 0.0)

    @rule()
    def clear_fault(self) -> None:
        try:
            self.rig.driver.clear_fault(self.rig.now)
        except RequestError:
            assert self.rig.driver.stop.reason

    @rule()
    def activate(self) -> None:
        if not self.rig.driver.active:
            self.rig.driver.activate(self.rig.now)

    @rule()
    def deactivate(self) -> None:
        self.rig.driver.deactivate()
        self.wanted = dict.fromkeys(CHANNELS, 0.0)

    def _forget_failed(self) -> None:
        for channel in self.rig.driver.ankle.channels.values():
            if channel.state is ChannelState.FAULT or "command_timeout_s" in channel.why.text:
                self.wanted[channel.name] = 0.0

    @invariant()
    def is_safe(self) -> None:
        driver, command = self.rig.driver, self.rig.driver.command
        assert 0.0 <= command.pump_duty <= 1.0
        if not driver.active or driver.stop.reason:
            assert command == released(CHANNELS)
        for channel in driver.ankle.channels.values():
            if channel.state in (ChannelState.FAULT, ChannelState.UNKNOWN) or channel.set_point_pa == 0.0:
                assert not command.solenoids[channel.name]
        if not driver.ankle.jammed:
            assert command.pump_duty == 0.0

    @invariant()
    def jammed_channels_share_one_vacuum(self) -> None:
        asked_pa = {channel.set_point_pa for channel in self.rig.driver.ankle.channels.values()}
        assert len(asked_pa - {0.0}) <= 1

    @invariant()
    def latest_change_wins(self) -> None:
        if self.wanted:
            assert {c.name: c.set_point_pa for c in self.rig.driver.ankle.channels.values()} == self.wanted


def test_anything_goes(make_rig: Callable[..., Any]) -> None:
    """No order of requests and measurements breaks an invariant."""
    few = settings(max_examples=60, stateful_step_count=40)
    run_state_machine_as_test(lambda: AnythingGoes(make_rig()), settings=few)


@pytest.mark.parametrize(
    ("request_of", "words"),
    [
        (lambda d: d.jam(["left", "knee"], 0.0, "t"), ["'knee'", "left, right, achilles"]),
        (lambda d: d.jam(["left"], 80e3, "t"), ["80000", "5000 to 70000 Pa"]),
        (lambda d: d.jam(["left"], math.nan, "t"), ["nan", "5000 to 70000 Pa"]),
        (lambda d: d.unjam(["left", "knee"], "t"), ["'knee'"]),
        (lambda d: d.follow([SetPoint("left", 5e4), SetPoint("knee", 5e4)], Instant(0, 0), "t"), ["'knee'"]),
        (
            lambda d: d.follow([SetPoint("left", 5e4), SetPoint("right", math.nan)], Instant(0, 0), "t"),
            ["'right'", "nan"],
        ),
        (lambda d: d.follow([SetPoint("left", 5e4), SetPoint("left", 3e4)], Instant(0, 0), "t"), ["'left'", "twice"]),
        (
            lambda d: d.follow([SetPoint("left", 5e4), SetPoint("right", 3e4)], Instant(0, 0), "t"),
            ["50000", "30000", "one vac"],
        ),
    ],
)
def test_a_bad_request_changes_nothing_and_says_why(
    make_rig: Callable[..., Any], request_of: Callable[[Driver], object], words: list[str]
) -> None:
    """One bad entry spoils the whole request; the message is one line with the value and the limit."""
    rig = make_rig().active()
    before = rig.said()
    with pytest.raises(RequestError) as caught:
        request_of(rig.driver)
    assert rig.said() == before
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_requests_are_refused_while_inactive(make_rig: Callable[..., Any]) -> None:
    """An inactive driver takes neither jam nor unjam nor a stream, and names the way out."""
    rig = make_rig()
    for request in (
        lambda: rig.driver.jam([], 0.0, "t"),
        lambda: rig.driver.unjam([], "t"),
        lambda: rig.follow(left=50e3),
    ):
        with pytest.raises(RequestError, match="activate"):
            request()
    assert rig.driver.command == released(CHANNELS)


def test_nothing_jams_blindly(make_rig: Callable[..., Any]) -> None:
    """A channel whose pressure was never measured is not jammed by a service; a stream's set point waits for it."""
    rig = make_rig()
    rig.driver.activate(rig.now)
    with pytest.raises(RequestError, match="pressure"):
        rig.driver.jam(["left"], 0.0, "t")
    rig.follow(left=50e3)
    assert rig.driver.command == released(CHANNELS)
    rig.measure(0.0)
    rig.follow(left=50e3)
    assert rig.driver.command.solenoids == {"left": True, "right": False, "achilles": False}


def test_repeating_is_not_changing(make_rig: Callable[..., Any]) -> None:
    """A repeated jam_command does not take back what a service changed since; a changed one does."""
    rig = make_rig().active()
    rig.follow(left=50e3)
    rig.driver.unjam(["left"], "t")
    rig.follow(left=50e3)
    assert rig.wanted_pa("left") == 0.0
    rig.follow(left=30e3)
    assert rig.wanted_pa("left") == 30e3


def test_a_second_vacuum_is_refused_until_the_way_out_is_taken(make_rig: Callable[..., Any]) -> None:
    """The refusal names both vacuums, who has them and the way out; jamming all, or unjamming first, is taken."""
    rig = make_rig().active()
    rig.driver.jam(["left", "right"], 50e3, "t")
    said = (
        "vacuum_pa is 40000 for achilles, but left and right hold 50000 Pa: channels share one manifold, "
        "so jam all of them to one vacuum or unjam those first"
    )
    before = rig.said()
    for request in (lambda: rig.driver.jam(["achilles"], 40e3, "t"), lambda: rig.follow(achilles=40e3)):
        with pytest.raises(RequestError) as caught:
            request()
        assert str(caught.value) == said
        assert rig.said() == before
    rig.driver.jam([], 40e3, "t")
    assert {rig.wanted_pa(name) for name in CHANNELS} == {40e3}
    rig.driver.unjam(["left", "right"], "t")
    rig.driver.jam(["achilles"], 30e3, "t")
    assert [rig.wanted_pa(name) for name in CHANNELS] == [0.0, 0.0, 30e3]


def test_a_refused_command_is_taken_when_it_fits(make_rig: Callable[..., Any]) -> None:
    """A jam_command that was refused is not spent: repeated after the way is free, it jams."""
    rig = make_rig().active()
    rig.driver.jam(["left"], 50e3, "t")
    with pytest.raises(RequestError):
        rig.follow(achilles=40e3)
    rig.driver.unjam(["left"], "t")
    rig.follow(achilles=40e3)
    assert rig.wanted_pa("achilles") == 40e3


def test_one_vacuum_for_all_is_always_taken(make_rig: Callable[..., Any]) -> None:
    """A stream that names all channels with one value passes though only some of it is new; what is soft stays soft."""
    rig = make_rig().active()
    rig.follow(left=50e3, right=50e3)
    rig.driver.jam(["left"], 50e3, "t")
    rig.driver.unjam(["right"], "t")
    rig.driver.jam(["left"], 30e3, "t")
    rig.follow(left=50e3, right=50e3, achilles=50e3)
    assert [rig.wanted_pa(name) for name in CHANNELS] == [50e3, 0.0, 50e3]


def test_reasons_say_who_asked_and_who_cleared(make_rig: Callable[..., Any]) -> None:
    """jam_state's reason is a plain line for a service, for the stream, and after a stop that was cleared."""
    rig = make_rig().active()
    rig.driver.jam(["left"], 50e3, "~/jam")
    rig.follow(right=50e3)
    assert rig.channel("left").why.text == "asked by ~/jam"
    assert rig.channel("right").why.text == "asked by jam_command"
    rig.driver.clear_fault(rig.now)
    assert rig.channel("left").why.text == "asked by ~/jam"
    rig.driver.emergency_stop(stop=True, now=rig.now)
    assert "emergency stop" in rig.channel("left").why.text
    rig.driver.emergency_stop(stop=False, now=rig.now)
    rig.driver.clear_fault(rig.now)
    assert {rig.channel(name).why.text for name in CHANNELS} == {"cleared by ~/clear_fault"}


def test_a_stream_that_begins_with_nothing_takes_nothing_away(make_rig: Callable[..., Any]) -> None:
    """A first jam_command of 0 leaves a channel that a service jammed as it is."""
    rig = make_rig().active()
    rig.driver.jam(["left"], 0.0, "t")
    rig.follow(left=0.0, right=0.0)
    assert rig.wanted_pa("left") == 50e3


@pytest.mark.parametrize("how", ["unjam", "emergency stop"])
def test_what_is_said_anew_brings_channels_back(make_rig: Callable[..., Any], how: str) -> None:
    """After a service or a cleared stop repeats change nothing, and the answer names the way back: `anew`."""
    rig = make_rig().active()
    rig.follow(left=50e3, right=50e3, achilles=50e3)
    if how == "unjam":
        answer = rig.driver.unjam([], "t")
    else:
        rig.driver.emergency_stop(stop=True, now=rig.now)
        rig.follow(left=50e3, right=50e3, achilles=50e3, anew=True)
        assert [rig.wanted_pa(name) for name in CHANNELS] == [0.0] * 3
        with pytest.raises(RequestError, match=WAY_BACK):
            rig.driver.jam([], 0.0, "t")
        rig.driver.emergency_stop(stop=False, now=rig.now)
        answer = rig.driver.clear_fault(rig.now)
    assert WAY_BACK in answer
    rig.follow(left=50e3, right=50e3, achilles=50e3)
    assert [rig.wanted_pa(name) for name in CHANNELS] == [0.0] * 3
    rig.follow(left=50e3, right=50e3, achilles=50e3, anew=True)
    assert [rig.wanted_pa(name) for name in CHANNELS] == [50e3] * 3
