"""What the page takes from messages, and what of it a plot shows."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from jammkle_common import names
from jammkle_msgs.msg import ChannelJamState, ContactEvent, TendonState, TendonStates
from jammkle_msgs.msg import Landing as LandingMessage
from jammkle_view.core import samples
from jammkle_view.core.ankle import Ankle, Trace, thinned
from jammkle_view.core.figure import BROKEN_TINT, EVENT_TINTS, LINE_TINTS, Rgb, tendon_tint
from jammkle_view.core.samples import Channel, ChannelState, EventKind, JamReport, Joints, Pressure
from jammkle_view.page.plots import range_of
from jammkle_view.page.words import landing_html


def test_numbers_are_those_of_the_messages() -> None:
    """The core has enums of its own, as it knows no ROS."""
    assert {each.name: each.value for each in ChannelState} == {
        each.name: getattr(ChannelJamState, each.name) for each in ChannelState
    }
    reported = [name for name in dir(ContactEvent) if name.isupper() and name != "SLOT_TYPES"]
    assert {each.name: each.value for each in EventKind} == {name: getattr(ContactEvent, name) for name in reported}
    assert set(EVENT_TINTS) == set(EventKind)
    assert samples._BROKEN == TendonState.BROKEN


def test_no_peak_is_lost_in_a_plot() -> None:
    """One sample in ten thousand stays."""
    time_s = np.linspace(0.0, 10.0, 10_000)
    values = np.zeros((10_000, 2))
    values[7_123, 1], values[2_001, 0] = 80.0, -5.0
    thin_s, thin = thinned(time_s, values, 300)
    assert len(thin_s) < 700
    assert thin[:, 1].max() == 80.0
    assert thin[:, 0].min() == -5.0
    assert (np.diff(thin_s) > 0.0).all()
    assert abs(thin_s[np.argmax(thin[:, 1])] - time_s[7_123]) < 0.05


def test_a_trace_keeps_the_latest_and_begins_again_when_time_does() -> None:
    """A simulation that was started anew counts from 0."""
    trace = Trace(1, 4)
    for time_s in range(6):
        trace.append(float(time_s), [time_s])
    assert trace.window(0.0, 10.0)[0].tolist() == [2.0, 3.0, 4.0, 5.0]
    trace.append(0.5, [9.0])
    assert trace.window(0.0, 10.0)[1].tolist() == [[9.0]]


def test_a_tendon_takes_the_state_of_its_channel() -> None:
    """Both Achilles tendons hang on one solenoid."""
    ankle = Ankle()
    channel = Channel(ChannelState.JAMMED, 50e3, 49e3, "")
    ankle.take(JamReport(1.0, emergency_stopped=False, channels={names.ACHILLES: channel}))
    assert ankle.state_of("achilles_right") is ChannelState.JAMMED
    assert ankle.state_of("peroneal_left") is ChannelState.UNKNOWN
    assert ankle.vacuum_share("achilles_left") == pytest.approx(0.49)
    slack = tendon_tint(ChannelState.JAMMED, 0.0, broken=False)
    assert sum(slack) > sum(tendon_tint(ChannelState.JAMMED, 100.0, broken=False))
    assert tendon_tint(ChannelState.JAMMED, 5.0, broken=True) == BROKEN_TINT
    assert tendon_tint(ChannelState.JAMMED, float("nan"), broken=False) == slack


def test_it_says_what_a_landing_chose_and_what_is_left_of_each_tendon() -> None:
    """Until a sole is flat the Achilles pair has the travel of its landing; all else, and feet that hang flat, tear."""
    ankle = Ankle()
    assert "no touch-down yet" in landing_html(ankle)
    assert math.isnan(ankle.left_m("achilles_left"))
    message = LandingMessage(chosen_vacuum_pa=26e3, reached_vacuum_pa=42.5e3, travel_m=0.0187, why="a <fall>")
    ankle.take(samples.TAKERS[names.LANDING.name](message))
    stretched_m = {"peroneal_left": -0.002, "peroneal_right": 0.015, "achilles_left": 0.010, "achilles_right": 0.025}
    tendons = [TendonState(name=name, extension_m=by_m) for name, by_m in stretched_m.items()]
    ankle.take(samples.TAKERS[names.TENDON_STATES.name](TendonStates(tendons=tendons)))
    left_m = [ankle.left_m(name) for name in stretched_m]
    assert left_m == pytest.approx([0.055, 0.040, 0.0087, 0.0])
    shown = landing_html(ankle)
    assert "chosen 26 kPa, reached 42 kPa" in shown
    assert "8.7 mm" in shown
    assert "a &lt;fall&gt;" in shown
    ankle.take(samples.TAKERS[names.LANDING.name](LandingMessage(why="nothing foresaw it")))
    assert ankle.left_m("achilles_left") == pytest.approx(0.045)


def test_a_robot_whose_time_begins_anew_is_followed() -> None:
    """Messages that come a little late do not set the time back; a new start does."""
    ankle = Ankle()
    ankle.take(Joints(100.0, {"carriage": 0.1}))
    ankle.take(Pressure(99.99, names.MANIFOLD_PRESSURE.name, 1e5))
    assert ankle.time_s == 100.0
    for anew_s in (0.1, 8.0, 5.0):
        ankle.take(Joints(anew_s, {"carriage": 0.1}))
        assert ankle.time_s == anew_s


def test_a_sensor_that_has_died_is_not_plotted_on() -> None:
    """Its last reading is no measurement of what comes after; one that is only slower than the others is kept."""
    ankle = Ankle()
    dead, slow, *others = names.PRESSURES.values()
    for step in range(200):
        for topic in (*others, *([slow] if step % 10 == 0 else []), *([dead] if step < 50 else [])):
            ankle.take(Pressure(0.01 * step, topic.name, 1e5))
    _, pressures_pa = ankle.pressures_pa.window(1.2, 2.0)
    assert np.isnan(pressures_pa).all(axis=0).sum() == 2  # there is no manifold either
    assert np.isfinite(pressures_pa).all(axis=0).sum() == 2


def test_pressures_are_plotted_without_a_sensor_of_the_manifold() -> None:
    """A board may have none: each set of the channels' pressures is a point, with nothing for the manifold."""
    ankle = Ankle()
    for step in range(3):
        for topic in names.PRESSURES.values():
            ankle.take(Pressure(0.01 * step, topic.name, 1e5 + step))
    time_s, pressures_pa = ankle.pressures_pa.window(0.0, 1.0)
    assert list(time_s) == pytest.approx([0.0, 0.01])  # the third set is not known to be whole
    assert np.isnan(pressures_pa).sum(axis=1).tolist() == [1, 1]
    assert np.nanmax(pressures_pa) == 1e5 + 1


@pytest.mark.parametrize("least", [2.0, 5.0])
def test_noise_does_not_fill_a_plot(least: float) -> None:
    """What moves less than it matters gets a scale of at least that height, which holds it; what moves more its own."""
    for middle in (0.0, 55.3, -101.25):
        still = middle + 1e-10 * np.sin(np.arange(200.0))[:, np.newaxis]
        found = range_of(still, least)
        assert found is not None
        assert found[1] - found[0] >= least
        assert found[0] < still.min()
        assert still.max() < found[1]
    moved = np.array([[0.0], [1.01 * least], [np.nan]])
    assert range_of(moved, least) is None
    assert range_of(0.98 * moved, least) is not None
    assert range_of(np.full((3, 1), np.nan), least) is None


def test_a_slow_drift_moves_the_scale_seldom() -> None:
    """Over one least height it is moved three times at most, not with every sample: each time the plot is made anew."""
    found = [range_of(np.array([[middle]]), 2.0) for middle in np.linspace(0.0, 2.0, 500)]
    assert len(set(found)) <= 3


def test_axes_and_events_share_a_plot_and_no_colour() -> None:
    """No axis is as near to an event as the two events are that are nearest to each other."""

    def apart(one: Rgb, other: Rgb) -> float:
        return math.dist(one, other)

    between = min(apart(a, b) for a, b in itertools.combinations(EVENT_TINTS.values(), 2))
    assert min(apart(LINE_TINTS[axis], tint) for axis in "xyz" for tint in EVENT_TINTS.values()) >= between
