"""Goals of ~/run_rig without the graph: options from text, runs and figures; and the engine that drives a guest."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_common.names import IMU, JOINT_STATES, LOAD_CELL, TENDON_STATES
from jammkle_common.parameters import ParameterError, rows
from jammkle_sim.core.engine import Engine
from jammkle_sim.core.pacing import Pacer
from jammkle_sim.core.rig_goal import RigGoal, periods_of, unit_of
from jammkle_sim.core.run_control import RefusedError, RunControl, RunState
from jammkle_sim.core.schedule import Output
from jammkle_sim.rigs.catalogue import RIGS, run_rig

MS_NS = 1_000_000


class Stepped:
    """Something with steps."""

    def __init__(self, timestep_s: float) -> None:
        self.timestep_s = timestep_s
        self.steps = 0

    @property
    def time_s(self) -> float:
        return self.steps * self.timestep_s

    def advance(self, steps: int) -> None:
        self.steps += steps

    def reset(self) -> None:
        """Nothing to restore."""


def make_engine(own: Stepped, control: RunControl) -> Engine:
    """Make an engine that goes as fast as it can."""
    return Engine(own, {Output.IMU: 4, Output.PRESSURES: 20}, control, Pacer(0.0), lambda: 0.0)


@given(before=st.integers(0, 50), guest=st.integers(0, 50), after=st.integers(1, 50))
@settings(deadline=None)
def test_time_goes_on_through_a_guest(before: int, guest: int, after: int) -> None:
    """Ticks rise without a gap from the own simulation to a guest with another step and back; each keeps its grid."""
    own, other = Stepped(0.0005), Stepped(0.001)
    engine = make_engine(own, RunControl(start_paused=False))
    ticks = [engine.cycle() for _ in range(before)]
    engine.lend(other, {Output.IMU: 1, Output.PRESSURES: 10})
    ticks += [engine.cycle() for _ in range(guest)]
    assert own.steps == 4 * before
    engine.take_back()
    ticks += [engine.cycle() for _ in range(after)]
    assert other.steps == guest
    times_ns = [tick.time_ns for tick in ticks if tick is not None]
    periods_ns = [2 * MS_NS] * before + [MS_NS] * guest + [2 * MS_NS] * after
    assert times_ns == [sum(periods_ns[: index + 1]) for index in range(len(periods_ns))]
    own_ticks = ticks[:before] + ticks[before + guest :]
    pressures = [index for index, tick in enumerate(own_ticks, 1) if tick and Output.PRESSURES in tick.outputs]
    assert pressures == [index for index in range(1, len(own_ticks) + 1) if index % 5 == 0]


@pytest.mark.parametrize("start_paused", [True, False])
def test_a_rig_runs_in_a_pause_and_leaves_what_it_found(start_paused: bool) -> None:  # noqa: FBT001 - a case
    """Time runs for the rig, pauses when asked to, and is as before afterwards."""
    control = RunControl(start_paused=start_paused)
    before = control.state
    control.begin_rig("drop")
    assert (control.state, control.rig) == (RunState.RUNNING, "drop")
    control.pause()
    assert control.state is RunState.PAUSED
    with pytest.raises(RefusedError, match=r"cannot step while rig 'drop' runs; wait .* or cancel"):
        control.begin_steps(1)
    control.resume()
    control.end_rig()
    assert (control.state, control.rig) == (before, "")


def test_a_rig_waits_for_steps_and_for_a_reset() -> None:
    """It is refused while steps are taken and after a failure, with the way out."""
    control = RunControl(start_paused=True)
    control.begin_steps(5)
    with pytest.raises(RefusedError, match="5 steps are still to take"):
        control.begin_rig("drop")
    control.fail("it blew up")
    with pytest.raises(RefusedError, match="it blew up; call ~/reset"):
        control.begin_rig("drop")


@pytest.mark.parametrize("rig", list(RIGS))
def test_every_option_can_be_written_as_text(rig: str) -> None:
    """The text of every default is read as that default, for every rig of the catalogue; the periods fit the topics."""
    texts = [f"{row.name} = {row.default}" for row in rows(RIGS[rig].options) if row.name != "seed"]
    running = RigGoal(rig, texts, 1, 0).begin()
    plain = RigGoal(rig, [], 0, 0).begin()
    assert running.simulation.description() == plain.simulation.description()
    periods = periods_of(running)
    for output, topic in (
        (Output.IMU, IMU),
        (Output.JOINT_STATES, JOINT_STATES),
        (Output.TENDON_STATES, TENDON_STATES),
        (Output.LOAD_CELL, LOAD_CELL),
    ):
        assert (output in periods) == (topic.name in running.topics)


@given(st.lists(st.text(max_size=30) | st.from_regex(r"material=\w*\s\w*"), max_size=3))
@settings(deadline=None, max_examples=50)
def test_a_text_without_sense_is_refused_in_one_line(texts: list[str]) -> None:
    """No text, whatever is in it, ends in anything but one line that says why."""
    refused = ""
    try:
        RigGoal("tensile", texts, 1, 0)
    except ParameterError as error:
        refused = str(error)
    assert bool(refused) == bool(texts)
    assert len(refused.splitlines()) <= 1


def test_every_figure_has_its_unit() -> None:
    """Whatever the rigs measure, the end of its name gives the unit; ratios and counts have none."""
    cases = {
        "peak_force_n": "N",
        "energy_in_n_m": "N m",
        "peak_deceleration_m_s2": "m/s^2",
        "rebound_m": "m",
        "final_pitch_rad": "rad",
        "share_lost": "",
    }
    assert {name: unit_of(name) for name in cases} == cases


def test_a_figure_that_one_run_lacks_is_nan_there() -> None:
    """Values stand in the order of the runs."""
    goal = RigGoal("tensile", ["speed_m_s=0.5"], 2, 0)
    make = RIGS["tensile"].options
    whole = run_rig("tensile", make(speed_m_s=0.5), lambda _: None, lambda: False)
    torn = run_rig("tensile", make(speed_m_s=0.5, extension_m=0.07), lambda _: None, lambda: False)
    goal.keep(whole)
    assert goal.share_done(0.5) == 0.75
    assert not goal.is_done
    goal.keep(torn)
    assert goal.is_done
    values = {figure.name: figure.values for figure in goal.figures()}["break_extension_m"]
    assert math.isnan(values[0])
    assert values[1] == torn.results["break_extension_m"]
    assert goal.torn() == "peroneal_left in run 2"
