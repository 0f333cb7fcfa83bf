"""Who may ask what of the driver: atomic requests, the latest change wins, stopped means released."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.hardware import MANIFOLD, PressureSample, released
from jammkle_driver.core.requests import RequestError, Wish
from jammkle_driver.core.watchdog import Instant, Watchdog
from jammkle_driver.parameters import DriverParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_driver.core.channel import ChannelStatus

CHANNELS = ("left", "right", "achilles")
SETTINGS = DriverParameters(emergency_stop_timeout_s=0.0).settings()

channel_names = st.sampled_from(CHANNELS)
vacuums = st.sampled_from([10e3, 30e3, 50e3, 70e3])
bad_vacuums = st.one_of(
    st.sampled_from([math.nan, math.inf, -math.inf, 1.0, -50e3, 70001.0]), st.floats(70001.0), st.floats(max_value=-1.0)
)


class Rig:
    """A driver with its clocks and a finger on every pressure sensor."""

    def __init__(self, **parameters: float) -> None:
        self.now = Instant(10.0, 100.0)
        self.driver = Driver(CHANNELS, DriverParameters(**parameters).settings())

    def active(self) -> Rig:
        self.driver.activate(self.now)
        self.measure(0.0)
        return self

    def wait(self, steady_s: float, graph_s: float | None = None) -> None:
        passed_s = steady_s if graph_s is None else graph_s
        self.now = Instant(self.now.steady_s + steady_s, self.now.graph_s + passed_s)

    def measure(self, vacuum_pa: float, *places: str) -> None:
        for place in places or (*CHANNELS, MANIFOLD):
            self.driver.measure(PressureSample(place, vacuum_pa, self.now.graph_s), self.now)

    def follow(self, **vacuums_pa: float) -> None:
        self.driver.follow([Wish(name, value) for name, value in vacuums_pa.items()], self.now, "jam_command")

    def channel(self, name: str) -> ChannelStatus:
        return self.driver.status.channels[CHANNELS.index(name)]

    def wanted_pa(self, name: str) -> float:
        return self.channel(name).commanded_vacuum_pa


class AnythingGoes(RuleBasedStateMachine):
    """Whatever is asked and measured in whatever order, the actuators stay safe and the latest change wins."""

    def __init__(self) -> None:
        super().__init__()
        self.rig = Rig()
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
        before = (self.rig.driver.status, self.rig.driver.command)
        with pytest.raises(RequestError):
            self.rig.driver.jam(names, vacuum_pa, "test")
        assert (self.rig.driver.status, self.rig.driver.command) == before

    @rule(vacuums_pa=st.dictionaries(channel_names, st.one_of(st.just(0.0), vacuums)))
    def follow(self, vacuums_pa: dict[str, float]) -> None:
        before = (self.rig.driver.status, self.rig.driver.command)
        try:
            self.rig.follow(**vacuums_pa)
        except RequestError:
            assert (self.rig.driver.status, self.rig.driver.command) == before
            return
        self._accept_stream(vacuums_pa)

    @rule(vacuum_pa=st.one_of(st.just(0.0), vacuums))
    def follow_one_vacuum(self, vacuum_pa: float) -> None:
        vacuums_pa = dict.fromkeys(CHANNELS, vacuum_pa)
        if self.rig.driver.status.active:
            self.rig.follow(**vacuums_pa)
            self._accept_stream(vacuums_pa)

    def _accept_stream(self, vacuums_pa: dict[str, float]) -> None:
        """Every channel has what it had before or what the stream says, the latter only where it is named."""
        for channel in self.rig.driver.status.channels:
            commanded_pa = channel.commanded_vacuum_pa
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
            assert self.rig.driver.status.stop_reason

    @rule()
    def activate(self) -> None:
        if not self.rig.driver.status.active:
            self.rig.driver.activate(self.rig.now)

    @rule()
    def deactivate(self) -> None:
        self.rig.driver.deactivate()
        self.wanted = dict.fromkeys(CHANNELS, 0.0)

    def _forget_failed(self) -> None:
        for channel in self.rig.driver.status.channels:
            if channel.state is ChannelState.FAULT or "command_timeout_s" in channel.reason:
                self.wanted[channel.name] = 0.0

    @invariant()
    def is_safe(self) -> None:
        status, command = self.rig.driver.status, self.rig.driver.command
        assert 0.0 <= command.pump_duty <= 1.0
        if not status.active or status.stop_reason:
            assert command == released(CHANNELS)
        for channel in status.channels:
            if channel.state in (ChannelState.FAULT, ChannelState.UNKNOWN) or channel.commanded_vacuum_pa == 0.0:
                assert not command.solenoids[channel.name]
        if not any(channel.commanded_vacuum_pa for channel in status.channels):
            assert command.pump_duty == 0.0

    @invariant()
    def jammed_channels_share_one_vacuum(self) -> None:
        asked_pa = {channel.commanded_vacuum_pa for channel in self.rig.driver.status.channels}
        assert len(asked_pa - {0.0}) <= 1

    @invariant()
    def latest_change_wins(self) -> None:
        if self.wanted:
            assert {c.name: c.commanded_vacuum_pa for c in self.rig.driver.status.channels} == self.wanted


AnythingGoes.TestCase.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
TestAnythingGoes = AnythingGoes.TestCase


@pytest.mark.parametrize(
    ("request_of", "words"),
    [
        (lambda d: d.jam(["left", "knee"], 0.0, "t"), ["'knee'", "left, right, achilles"]),
        (lambda d: d.jam(["left"], 80e3, "t"), ["80000", "5000 to 70000 Pa"]),
        (lambda d: d.jam(["left"], math.nan, "t"), ["nan", "5000 to 70000 Pa"]),
        (lambda d: d.unjam(["left", "knee"], "t"), ["'knee'"]),
        (lambda d: d.follow([Wish("left", 5e4), Wish("knee", 5e4)], Instant(0, 0), "t"), ["'knee'"]),
        (lambda d: d.follow([Wish("left", 5e4), Wish("right", math.nan)], Instant(0, 0), "t"), ["'right'", "nan"]),
        (lambda d: d.follow([Wish("left", 5e4), Wish("left", 3e4)], Instant(0, 0), "t"), ["'left'", "twice"]),
        (
            lambda d: d.follow([Wish("left", 5e4), Wish("right", 3e4)], Instant(0, 0), "t"),
            ["50000", "30000", "one vac"],
        ),
    ],
)
def test_a_bad_request_changes_nothing_and_says_why(request_of: Callable[[Driver], object], words: list[str]) -> None:
    """One bad entry spoils the whole request; the message is one line with the value and the limit."""
    rig = Rig().active()
    before = (rig.driver.status, rig.driver.command)
    with pytest.raises(RequestError) as caught:
        request_of(rig.driver)
    assert (rig.driver.status, rig.driver.command) == before
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_requests_are_refused_while_inactive() -> None:
    """An inactive driver takes neither jam nor unjam nor a stream, and names the way out."""
    rig = Rig()
    for request in (
        lambda: rig.driver.jam([], 0.0, "t"),
        lambda: rig.driver.unjam([], "t"),
        lambda: rig.follow(left=50e3),
    ):
        with pytest.raises(RequestError, match="activate"):
            request()
    assert rig.driver.command == released(CHANNELS)


def test_nothing_jams_blindly() -> None:
    """A channel whose pressure was never measured is not jammed by a service; a stream's wish waits for it."""
    rig = Rig()
    rig.driver.activate(rig.now)
    with pytest.raises(RequestError, match="pressure"):
        rig.driver.jam(["left"], 0.0, "t")
    rig.follow(left=50e3)
    assert rig.driver.command == released(CHANNELS)
    rig.measure(0.0)
    rig.follow(left=50e3)
    assert rig.driver.command.solenoids == {"left": True, "right": False, "achilles": False}


def test_repeating_is_not_changing() -> None:
    """A repeated jam_command does not take back what a service changed since; a changed one does."""
    rig = Rig().active()
    rig.follow(left=50e3)
    rig.driver.unjam(["left"], "t")
    rig.follow(left=50e3)
    assert rig.wanted_pa("left") == 0.0
    rig.follow(left=30e3)
    assert rig.wanted_pa("left") == 30e3


def test_a_second_vacuum_is_refused_until_the_way_out_is_taken() -> None:
    """The refusal names both vacuums, who has them and the way out; jamming all, or unjamming first, is taken."""
    rig = Rig().active()
    rig.driver.jam(["left", "right"], 50e3, "t")
    said = (
        "vacuum_pa is 40000 for achilles, but left and right hold 50000 Pa: channels share one manifold, "
        "so jam all of them to one vacuum or unjam those first"
    )
    before = (rig.driver.status, rig.driver.command)
    for request in (lambda: rig.driver.jam(["achilles"], 40e3, "t"), lambda: rig.follow(achilles=40e3)):
        with pytest.raises(RequestError) as caught:
            request()
        assert str(caught.value) == said
        assert (rig.driver.status, rig.driver.command) == before
    rig.driver.jam([], 40e3, "t")
    assert {rig.wanted_pa(name) for name in CHANNELS} == {40e3}
    rig.driver.unjam(["left", "right"], "t")
    rig.driver.jam(["achilles"], 30e3, "t")
    assert [rig.wanted_pa(name) for name in CHANNELS] == [0.0, 0.0, 30e3]


def test_a_refused_command_is_taken_when_it_fits() -> None:
    """A jam_command that was refused is not spent: repeated after the way is free, it jams."""
    rig = Rig().active()
    rig.driver.jam(["left"], 50e3, "t")
    with pytest.raises(RequestError):
        rig.follow(achilles=40e3)
    rig.driver.unjam(["left"], "t")
    rig.follow(achilles=40e3)
    assert rig.wanted_pa("achilles") == 40e3


def test_one_vacuum_for_all_is_always_taken() -> None:
    """A stream that names all channels with one value passes though only some of it is new; what is soft stays soft."""
    rig = Rig().active()
    rig.follow(left=50e3, right=50e3)
    rig.driver.jam(["left"], 50e3, "t")
    rig.driver.unjam(["right"], "t")
    rig.driver.jam(["left"], 30e3, "t")
    rig.follow(left=50e3, right=50e3, achilles=50e3)
    assert [rig.wanted_pa(name) for name in CHANNELS] == [50e3, 0.0, 50e3]


def test_reasons_say_who_asked_and_who_cleared() -> None:
    """jam_state's reason is a plain line for a service, for the stream, and after a stop that was cleared."""
    rig = Rig().active()
    rig.driver.jam(["left"], 50e3, "~/jam")
    rig.follow(right=50e3)
    assert rig.channel("left").reason == "asked by ~/jam"
    assert rig.channel("right").reason == "asked by jam_command"
    rig.driver.clear_fault(rig.now)
    assert rig.channel("left").reason == "asked by ~/jam"
    rig.driver.emergency_stop(stop=True, now=rig.now)
    assert "emergency stop" in rig.channel("left").reason
    rig.driver.emergency_stop(stop=False, now=rig.now)
    rig.driver.clear_fault(rig.now)
    assert {rig.channel(name).reason for name in CHANNELS} == {"cleared by ~/clear_fault"}


def test_a_stream_that_begins_with_nothing_takes_nothing_away() -> None:
    """A first jam_command of 0 leaves a channel that a service jammed as it is."""
    rig = Rig().active()
    rig.driver.jam(["left"], 0.0, "t")
    rig.follow(left=0.0, right=0.0)
    assert rig.wanted_pa("left") == 50e3


def test_a_silent_stream_is_taken_back() -> None:
    """What jam_command jammed is vented after command_timeout_s, with a reason; what a service jammed stays."""
    rig = Rig(pressure_timeout_s=60.0).active()
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
    assert "command_timeout_s" in rig.channel("left").reason
    assert rig.wanted_pa("right") == 50e3


@pytest.mark.parametrize(("steady_s", "graph_s"), [(100.0, 0.0), (0.0, 100.0)])
def test_a_paused_or_racing_simulation_is_no_silence(steady_s: float, graph_s: float) -> None:
    """While only one of the clocks advances, neither pressure nor command is stale."""
    rig = Rig().active()
    rig.follow(left=50e3)
    rig.wait(steady_s, graph_s)
    rig.driver.tick(rig.now)
    assert rig.wanted_pa("left") == 50e3
    assert rig.channel("left").state is ChannelState.JAMMING


@given(bad=st.sampled_from([math.nan, math.inf, -math.inf]))
def test_a_sensor_that_fails_faults_its_channel_alone(bad: float) -> None:
    """Silence or readings that are no numbers release the channel with a reason until it is cleared."""
    rig = Rig().active()
    rig.driver.jam([], 0.0, "t")
    for _ in range(8):
        rig.wait(0.1)
        rig.measure(10e3, "right", "achilles", MANIFOLD)
        rig.measure(bad, "left")
        rig.driver.tick(rig.now)
    left = rig.channel("left")
    assert left.state is ChannelState.FAULT
    assert "pressure_timeout_s" in left.reason
    assert rig.driver.command.solenoids == {"left": False, "right": True, "achilles": True}
    with pytest.raises(RequestError, match="clear_fault"):
        rig.driver.jam([], 0.0, "t")
    rig.driver.clear_fault(rig.now)
    rig.measure(0.0, "left")
    assert rig.channel("left").state is ChannelState.UNJAMMED
    assert not rig.driver.command.solenoids["left"]


def test_after_an_emergency_stop_nothing_jams_by_itself() -> None:
    """Stop releases all; false alone frees nothing; after clear_fault a stream that only repeats jams nothing."""
    rig = Rig().active()
    rig.follow(left=50e3)
    rig.driver.emergency_stop(stop=True, now=rig.now)
    assert rig.driver.command == released(CHANNELS)
    with pytest.raises(RequestError, match="still true"):
        rig.driver.clear_fault(rig.now)
    rig.driver.emergency_stop(stop=False, now=rig.now)
    with pytest.raises(RequestError, match="emergency stop"):
        rig.driver.jam([], 0.0, "t")
    rig.follow(left=50e3, right=50e3)
    rig.driver.clear_fault(rig.now)
    rig.follow(left=50e3, right=50e3)
    assert rig.driver.command == released(CHANNELS)
    rig.driver.jam(["left"], 0.0, "t")
    assert rig.driver.command.solenoids["left"]


def test_an_emergency_stop_survives_the_lifecycle() -> None:
    """Deactivate, cleanup and activate do not clear a stop."""
    rig = Rig().active()
    rig.driver.emergency_stop(stop=True, now=rig.now)
    rig.driver.emergency_stop(stop=False, now=rig.now)
    rig.driver.deactivate()
    rig.driver.reset()
    rig.active()
    with pytest.raises(RequestError, match="emergency stop"):
        rig.driver.jam([], 0.0, "t")


def test_a_silent_emergency_stop_stops_where_so_configured() -> None:
    """With emergency_stop_timeout_s, silence stops; without, it does not."""
    for timeout_s, stops in ((0.0, False), (1.0, True)):
        rig = Rig(emergency_stop_timeout_s=timeout_s).active()
        rig.wait(0.9)
        rig.driver.tick(rig.now)
        assert not rig.driver.status.stop_reason
        rig.wait(0.2)
        rig.driver.tick(rig.now)
        assert bool(rig.driver.status.stop_reason) is stops


def test_time_that_runs_backwards_is_survived() -> None:
    """A simulation that was started anew with an earlier clock neither faults nor blocks a channel."""
    rig = Rig().active()
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
def test_a_watchdog_needs_both_clocks(timeout_s: float, steps: list[tuple[float, float]]) -> None:
    """It expires exactly when both clocks have passed the timeout since it was fed; unfed, never."""
    watchdog = Watchdog(timeout_s)
    now = Instant(0.0, 0.0)
    assert not watchdog.expired(Instant(1e9, 1e9))
    watchdog.feed(now)
    for steady_s, graph_s in steps:
        now = Instant(now.steady_s + steady_s, now.graph_s + graph_s)
        assert watchdog.expired(now) is (min(now.steady_s, now.graph_s) > timeout_s)
