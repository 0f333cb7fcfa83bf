"""Requests of any kind and order, most of them malformed: the driver refuses them, and drives nothing unsafe.

`make soak` runs the same machine over 100,000 requests (profile `soak` in conftest.py).
"""

from __future__ import annotations

import contextlib

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.hardware import MANIFOLD, LinkState, LinkStatus, PressureSample, SafeCause, released
from jammkle_driver.core.requests import RequestError, SetPoint
from jammkle_driver.core.watch import Instant
from jammkle_driver.parameters import DriverParameters
from malformed import NAME, NAMES, PASCALS

CONNECTED = LinkStatus(LinkState.CONNECTED)
LOST = LinkStatus(LinkState.LOST, "no such device")
BROWNED_OUT = LinkStatus(LinkState.CONNECTED, latched=frozenset({SafeCause.SUPPLY_LOW}))
HAD_LET_GO = LinkStatus(LinkState.CONNECTED, latched=frozenset({SafeCause.HOST_SILENT}))


class Requests(RuleBasedStateMachine):
    """A driver that anybody may ask anything, on an ankle whose sensors say anything."""

    def __init__(self) -> None:
        super().__init__()
        self.driver = Driver(CHANNELS, DriverParameters())
        self.now = Instant(0.0, 0.0)
        self.driver.activate(self.now)

    @rule(names=NAMES, vacuum_pa=PASCALS)
    def jam(self, names: list[str], vacuum_pa: float) -> None:
        with contextlib.suppress(RequestError):
            self.driver.jam(names, vacuum_pa, "test")

    @rule(names=NAMES)
    def unjam(self, names: list[str]) -> None:
        with contextlib.suppress(RequestError):
            self.driver.unjam(names, "test")

    @rule(set_points=st.lists(st.builds(SetPoint, NAME, PASCALS), max_size=4))
    def follow(self, set_points: list[SetPoint]) -> None:
        with contextlib.suppress(RequestError):
            self.driver.follow(set_points, self.now, "test")

    @rule(place=st.sampled_from((*CHANNELS, MANIFOLD)), vacuum_pa=PASCALS, age_s=st.sampled_from((0.0, 5.0, -5.0)))
    def measure(self, place: str, vacuum_pa: float, age_s: float) -> None:
        pressure_pa = STANDARD_ATMOSPHERE_PA - vacuum_pa
        self.driver.measure(PressureSample(place, pressure_pa, self.now.graph_s - age_s), self.now)

    @rule()
    def measure_all(self) -> None:
        """Let every sensor say something that can be, so that jams are not only refused."""
        for place in (*CHANNELS, MANIFOLD):
            self.driver.measure(PressureSample(place, STANDARD_ATMOSPHERE_PA - 100.0, self.now.graph_s), self.now)

    @rule(passed_s=st.sampled_from((0.0, 0.01, 0.05, 0.3, 2.0)), runs=st.booleans())
    def tick(self, passed_s: float, *, runs: bool) -> None:
        steady_s = self.now.steady_s + passed_s
        self.now = Instant(steady_s, self.now.graph_s + (passed_s if runs else 0.0))
        self.driver.tick(self.now)

    @rule(stop=st.booleans())
    def emergency_stop(self, *, stop: bool) -> None:
        self.driver.emergency_stop(stop=stop, now=self.now)

    @rule()
    def clear_fault(self) -> None:
        with contextlib.suppress(RequestError):
            self.driver.clear_fault(self.now)

    @rule(link=st.sampled_from((CONNECTED, LOST, BROWNED_OUT, HAD_LET_GO)))
    def look_at_link(self, link: LinkStatus) -> None:
        self.driver.look_at_link(link, self.now)

    @rule(active=st.booleans())
    def change_state(self, *, active: bool) -> None:
        if active:
            self.driver.activate(self.now)
        else:
            self.driver.deactivate()

    @invariant()
    def nothing_unsafe_is_driven(self) -> None:
        command = self.driver.command
        assert 0.0 <= command.pump_duty <= 1.0
        if command == released(CHANNELS):
            return
        assert self.driver.active
        assert not self.driver.stop.reason
        assert not self.driver.ankle.faulty
        assert self.driver.ankle.jammed


TestRequests = Requests.TestCase
