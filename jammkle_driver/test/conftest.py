"""A driver with a finger on its clocks and sensors, for the tests of its core."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.hardware import MANIFOLD, PressureSample
from jammkle_driver.core.requests import SetPoint
from jammkle_driver.core.watch import Instant
from jammkle_driver.parameters import DriverParameters

if TYPE_CHECKING:
    from jammkle_driver.core.channel import Channel

settings.register_profile("soak", max_examples=3500, stateful_step_count=50, deadline=None)
"""100,000 requests: `make soak`."""

CHANNELS = ("left", "right", "achilles")


class Rig:
    """A driver with its clocks and a finger on every pressure sensor."""

    def __init__(self, **parameters: float) -> None:
        self.now = Instant(10.0, 100.0)
        given = {"diagnose": False, "fault_policy": "channel", **parameters}
        self.driver = Driver(CHANNELS, DriverParameters(**given))

    def active(self) -> Rig:
        self.driver.activate(self.now)
        self.measure(0.0)
        return self

    def wait(self, steady_s: float, graph_s: float | None = None) -> None:
        passed_s = steady_s if graph_s is None else graph_s
        self.now = Instant(self.now.steady_s + steady_s, self.now.graph_s + passed_s)

    def measure(self, vacuum_pa: float, *places: str) -> None:
        for place in places or (*CHANNELS, MANIFOLD):
            self.driver.measure(PressureSample(place, STANDARD_ATMOSPHERE_PA - vacuum_pa, self.now.graph_s), self.now)

    def follow(self, *, anew: bool = False, **vacuums_pa: float) -> None:
        set_points = [SetPoint(name, value) for name, value in vacuums_pa.items()]
        self.driver.follow(set_points, self.now, "jam_command", anew=anew)

    def channel(self, name: str) -> Channel:
        return self.driver.ankle.channels[name]

    def said(self) -> tuple[object, ...]:
        """Return all that the driver says of itself, and what it commands."""
        driver, channels = self.driver, self.driver.ankle.channels.values()
        of_channels = tuple((each.name, each.state, each.set_point_pa, each.vacuum_pa, each.why) for each in channels)
        of_publishers = (driver.stop.publishers, driver.stop.asked_by, driver.streams.speaking)
        of_ankle = (driver.ankle.manifold_vacuum_pa, driver.ankle.held, driver.trouble)
        of_driver = (driver.active, driver.stop.reason, driver.link_watch.noise, driver.link_watch.restarted)
        return (of_driver, of_ankle, of_channels, of_publishers, driver.command)

    def wanted_pa(self, name: str) -> float:
        return self.channel(name).set_point_pa


@pytest.fixture(scope="session")
def make_rig() -> type[Rig]:
    """Return what makes a driver of three channels, from parameters that differ from their defaults."""
    return Rig
