"""Drives a simulation from one due output to the next, at the pace wanted. Knows neither ROS nor a clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_sim.core.pacing import Pacer, RealTimeFactor
from jammkle_sim.core.run_control import RunControl, RunState
from jammkle_sim.core.schedule import STATES, Output, Schedule, timestep_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


class SteppedSimulation(Protocol):
    """What the engine needs of the simulation that it drives."""

    @property
    def timestep_s(self) -> float:
        """Length of one step, s; a whole number of nanoseconds."""

    @property
    def time_s(self) -> float:
        """Simulated time since construction, s; never falls, not even in a reset."""

    def advance(self, steps: int) -> None:
        """Take steps."""

    def reset(self) -> None:
        """Restore the state and the noise seeds of the start."""


@dataclass(frozen=True)
class Tick:
    """What is due now: the simulated time, ns, and the outputs in the order of publishing (none: only /clock)."""

    time_ns: int
    outputs: tuple[Output, ...]


class _Course:
    """A simulation, when which of its outputs are due, and where its steps lie in simulated time."""

    def __init__(self, simulation: SteppedSimulation, periods: Mapping[Output, int], start_ns: int) -> None:
        self.simulation = simulation
        self.schedule = Schedule(periods)
        self.timestep_ns = timestep_ns(simulation.timestep_s)
        self._timestep_s = simulation.timestep_s
        self._start_ns = start_ns - self.step * self.timestep_ns
        self.first_step = self.step

    @property
    def step(self) -> int:
        """Steps since the simulation was made."""
        return round(self.simulation.time_s / self._timestep_s)

    @property
    def time_ns(self) -> int:
        """Simulated time, ns."""
        return self.time_ns_at(self.step)

    def time_ns_at(self, step: int) -> int:
        """Simulated time, ns, of a step."""
        return self._start_ns + step * self.timestep_ns

    def whole_steps_ns(self, time_s: float) -> int:
        """Simulated time, ns, rounded to a whole step."""
        return round(time_s / self._timestep_s) * self.timestep_ns

    def next_step(self) -> int:
        """Next step at which something is due."""
        step = self.step
        return step + self.schedule.steps_to_next(step - self.first_step)

    def move_to(self, time_ns: int) -> None:
        """Let the step that it stands at lie at this simulated time."""
        self._start_ns += time_ns - self.time_ns


class Engine:
    """One simulation, its pace, its schedule and its run state."""

    def __init__(
        self,
        simulation: SteppedSimulation,
        periods: Mapping[Output, int],
        control: RunControl,
        pacer: Pacer,
        now_s: Callable[[], float],
    ) -> None:
        """Put the parts together.

        Args:
            simulation: What is driven.
            periods: Steps between two of each output.
            control: Run state; shared with whoever pauses, resumes and steps through this engine only.
            pacer: Pace.
            now_s: Real time, s, from a steady clock.

        Raises:
            RateError: the time step is not a whole number of nanoseconds.

        """
        own_ns = round(simulation.time_s / simulation.timestep_s) * timestep_ns(simulation.timestep_s)
        self._simulation = simulation
        self._own = _Course(simulation, periods, own_ns)
        self._course = self._own
        self._control = control
        self._pacer = pacer
        self._factor = RealTimeFactor()
        self._now_s = now_s
        self._begun = False
        self._limit_ns: int | None = None
        self.restart_pace()

    @property
    def time_ns(self) -> int:
        """Simulated time, ns, exact: it counts whole steps from the time of the start."""
        return self._course.time_ns

    @property
    def begun(self) -> bool:
        """True once a step was taken."""
        return self._begun

    @property
    def control(self) -> RunControl:
        """The run state, to look at."""
        return self._control

    @property
    def pacer(self) -> Pacer:
        """The pace, to look at."""
        return self._pacer

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per real second; 0 while time stands still, NaN while too little has been measured."""
        if self._control.state in (RunState.PAUSED, RunState.FAILED):
            return 0.0
        return self._factor.value()

    def go_as_far_as(self, limit_ns: int) -> None:
        """Live in the time of another clock from now on, which stands at `limit_ns`: its pace is that of this one.

        Time that is ahead of it, as when that clock was set back, is set back as well.
        """
        if self._limit_ns is None or self.time_ns > limit_ns:
            self._course.move_to(limit_ns)
        self._limit_ns = limit_ns

    def next_output_ns(self) -> int:
        """Simulated time, ns, of the next output."""
        return self._course.time_ns_at(self._course.next_step())

    def wait_s(self) -> float:
        """Real time, s, until `cycle` has something to do; infinite while time stands still."""
        state = self._control.state
        if state is RunState.STEPPING:
            return 0.0
        if state is not RunState.RUNNING:
            return float("inf")
        if self._limit_ns is not None:
            return 0.0 if self.next_output_ns() <= self._limit_ns else float("inf")
        return self._pacer.wait_s(self._time_s_at(self._course.next_step()), self._now_s())

    def cycle(self) -> Tick | None:
        """Advance to the next due output if its time has come.

        Returns:
            What is due; None if time stands still or has not come.

        """
        if self.wait_s() > 0:
            return None
        course = self._course
        target = course.next_step()
        now_s = self._now_s()
        stepping = self._control.state is RunState.STEPPING
        if stepping:
            target = min(target, course.step + self._control.steps_left)
        else:
            self._pacer.begin(self._time_s_at(target), now_s)
        steps = target - course.step
        course.simulation.advance(steps)
        self._begun = True
        self._control.steps_taken(steps)
        self._factor.note(self._time_s_at(target), now_s)
        outputs = course.schedule.due(target - course.first_step)
        if stepping and self._control.state is RunState.PAUSED:
            # Who steps one by one wants to see the state after each; readings keep to their rates.
            outputs = tuple(output for output in Output if output in outputs or output in STATES)
        return Tick(self.time_ns, outputs)

    def set_start_time(self, start_time_s: float) -> None:
        """Let simulated time start at this time, s, rounded to a whole step so that stamps keep to one grid.

        Only before the first step: a later change would be a jump in time.
        """
        self._own.move_to(self._own.whole_steps_ns(start_time_s))
        self.restart_pace()

    def pause(self) -> None:
        """Stop simulated time; see RunControl.pause."""
        self._control.pause()

    def resume(self) -> None:
        """Let simulated time run on from where it stands; see RunControl.resume."""
        already_running = self._control.state is RunState.RUNNING
        self._control.resume()
        if not already_running:
            if self._limit_ns is not None:  # the clock went on meanwhile
                self._course.move_to(self._limit_ns)
            self.restart_pace()

    def begin_steps(self, steps: int) -> None:
        """Take steps in the cycles to come; see RunControl.begin_steps."""
        self._control.begin_steps(steps)
        self._factor.restart()

    def set_speed(self, speed: float) -> None:
        """Change the pace from now on; 0 is as fast as possible."""
        if speed != self._pacer.speed:
            self.restart_pace(speed)

    def restart_pace(self, speed: float | None = None) -> None:
        """Let simulated time go on from where it stands now, without catching up; with another speed if given."""
        self._pacer.restart(self._time_s_at(self._course.step), self._now_s(), speed)
        self._factor.restart()

    def fail(self, why: str) -> None:
        """Stop simulated time until a reset, and remember why."""
        self._control.fail(why)

    def reset(self) -> None:
        """Restore the rig; simulated time goes on, and the schedule counts from here. See RunControl.reset."""
        self._control.reset()
        self._simulation.reset()
        self._own.first_step = self._own.step
        self.restart_pace()

    def _time_s_at(self, step: int) -> float:
        return self._course.time_ns_at(step) / NANOSECONDS_PER_SECOND
