"""Units, signs and messages of the driver, and its parameter table."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from builtin_interfaces.msg import Time
from sensor_msgs.msg import FluidPressure

from jammkle_common import wire
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.messages import Level
from jammkle_common.parameters import ParameterError, from_mapping
from jammkle_driver import conversions
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.faults import Finding, Reason
from jammkle_driver.node import health_lines
from jammkle_driver.parameters import DriverParameters
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from conftest import Rig


def test_a_pressure_keeps_the_stamp_of_its_measurement() -> None:
    """A stamped message gives its own time, one without a stamp the time of arrival."""
    message = FluidPressure(fluid_pressure=51325.0)
    assert conversions.pressure_sample("achilles", message, 7.0).stamp_s == 7.0
    message.header.stamp = Time(sec=3, nanosec=500_000_000)
    sample = conversions.pressure_sample("achilles", message, 7.0)
    assert (sample.stamp_s, sample.pressure_pa) == (3.5, 51325.0)


def test_one_stamp_is_one_time() -> None:
    """An acknowledgement and a reading with the same stamp are of one moment, to the bit."""
    measured = [wire.Measured(ns, "", (1e5,)) for ns in range(10_000_000, 4_000_000_000, 10_000_000)]
    for each in measured:
        stamp = Time(sec=each.time_ns // NANOSECONDS_PER_SECOND, nanosec=each.time_ns % NANOSECONDS_PER_SECOND)
        assert conversions.stamp_seconds(stamp) == conversions.measured_pressure("achilles", each).stamp_s


def test_states_have_the_values_of_the_message() -> None:
    """The core's states and the message's constants are the same numbers under the same names."""
    for state in ChannelState:
        assert getattr(ChannelJamState, state.name) == state.value


def test_what_is_not_measured_is_not_a_number() -> None:
    """An unmeasured vacuum is NaN in jam_state, never 0, which would read as vented."""
    message = conversions.jam_state_message(Driver(("achilles",), DriverParameters()), Time(sec=1))
    assert math.isnan(message.manifold_vacuum_pa)
    assert math.isnan(message.channels[0].measured_vacuum_pa)


def test_a_fault_is_an_error_on_diagnostics(make_rig: type[Rig]) -> None:
    """A channel in FAULT is an ERROR with its reason; a refused jam_command a WARN with what was refused."""
    rig = make_rig().active()
    rig.driver.ankle.fail(("achilles",), Finding(Reason.LEAK, "achilles", "a leak"))
    lines = {line.about: line for line in health_lines(rig.driver, "active", "bad knee")}
    assert lines["achilles"].level is Level.ERROR
    assert "a leak" in lines["achilles"].message
    assert lines["jam_command"].level is Level.WARN
    assert "bad knee" in lines["jam_command"].message
    assert lines["driver"].level is Level.OK


def test_limits_of_vacuum_must_fit_together() -> None:
    """A default vacuum outside of its own limits is refused in one line that names all three."""
    with pytest.raises(ParameterError, match=r"default_vacuum_pa.*min_vacuum_pa.*max_vacuum_pa"):
        from_mapping(DriverParameters, {"max_vacuum_pa": 40e3})
    with pytest.raises(ParameterError, match=r"max_vacuum_pa.*below pump_ultimate_vacuum_pa.*80000"):
        from_mapping(DriverParameters, {"max_vacuum_pa": 95e3})
    with pytest.raises(ParameterError, match=r"tolerance_pa.*below min_vacuum_pa.*5000.*JAMMED"):
        from_mapping(DriverParameters, {"tolerance_pa": 6e3})
    with pytest.raises(ParameterError, match=r"'min_vacuum_pa' is 80000; .* at most max_vacuum_pa, here 70000 Pa"):
        from_mapping(DriverParameters, {"min_vacuum_pa": 80e3})
    with pytest.raises(ParameterError, match=r"'pump_rest_band_pa' is 700; .* below tolerance_pa, here 500 Pa"):
        from_mapping(DriverParameters, {"tolerance_pa": 500.0})
