"""Drives a simulation from one due output to the next, at the pace wanted. Knows neither ROS nor a clock."""

from __future__ import annotations

import enum
import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.parameters import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jammkle_sim.rigs.simulation import Simulation


@dataclass(frozen=True)
class Tick:
    """What is due now: the simulated time, ns, and the outputs in the order of publishing (none: only /clock)."""

    time_ns: int
    outputs: tuple[Output, ...]


class Engine:
    """One simulation, its pace, its schedule and its run state."""

    def __init__(
        self,
        simulation: Simulation,
        periods: Mapping[Output, int],
        pacer: Pacer,
        now_s: Callable[[], float],
        *,
        start_paused: bool = False,
    ) -> None:
        """Put the parts together; time begins where the simulation stands.

        Args:
            simulation: What is driven.
            periods: Steps between two of each output.
            pacer: Pace.
            now_s: Real time, s, from a steady clock.
            start_paused: Whether time stands until somebody resumes it.

        Raises:
            ParameterError: the time step is not a whole number of nanoseconds.

        """
        self._simulation = simulation
        self._schedule = Schedule(periods)
        self._timestep_ns = timestep_ns(simulation.timestep_s)
        self._offset_ns = 0
        """Simulated time at which the simulation was made."""
        self._first_step = self._step
        """At which the rig was last started: the schedule counts from there."""
        self.state = RunState.PAUSED if start_paused else RunState.RUNNING
        """What simulated time does."""
        self.failure = ""
        """Why the simulation failed, in one line; empty if it did not."""
        self.begun = False
        """Whether a step was taken."""
        self.pacer = pacer
        """The pace, to look at."""
        self._steps_left = 0
        self._factor = RealTimeFactor()
        self._now_s = now_s
        self._limit_ns: int | None = None
        self.restart_pace()

    @property
    def time_ns(self) -> int:
        """Simulated time, ns, exact: it counts whole steps from the time of the start."""
        return self._time_ns_at(self._step)

    @property
    def stands(self) -> bool:
        """Whether simulated time stands still until somebody asks for something."""
        return self.state in (RunState.PAUSED, RunState.FAILED)

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per real second; 0 while time stands still, NaN while too little has been measured."""
        if self.stands:
            return 0.0
        return self._factor.value()

    def go_as_far_as(self, limit_ns: int) -> None:
        """Live in the time of another clock from now on, which stands at `limit_ns`: its pace is that of this one.

        Time that is ahead of it, as when that clock was set back, is set back as well.
        """
        if self._limit_ns is None or self.time_ns > limit_ns:
            self._move_to(limit_ns)
        self._limit_ns = limit_ns

    def next_output_ns(self) -> int:
        """Simulated time, ns, of the next output."""
        return self._time_ns_at(self._next_step())

    def wait_s(self) -> float:
        """Real time, s, until `cycle` has something to do; infinite while time stands still."""
        if self.state is RunState.STEPPING:
            return 0.0
        if self.stands:
            return float("inf")
        if self._limit_ns is not None:
            return 0.0 if self.next_output_ns() <= self._limit_ns else float("inf")
        return self.pacer.wait_s(self._time_s_at(self._next_step()), self._now_s())

    def cycle(self) -> Tick | None:
        """Advance to the next due output if its time has come.

        Returns:
            What is due; None if time stands still or has not come.

        """
        if self.wait_s() > 0:
            return None
        target = self._next_step()
        now_s = self._now_s()
        stepping = self.state is RunState.STEPPING
        if stepping:
            target = min(target, self._step + self._steps_left)
        else:
            self.pacer.begin(self._time_s_at(target), now_s)
        steps = target - self._step
        self._simulation.advance(steps)
        self.begun = True
        if stepping:
            self._steps_left -= steps
            self.state = RunState.STEPPING if self._steps_left else RunState.PAUSED
        self._factor.note(self._time_s_at(target), now_s)
        outputs = self._schedule.due(target - self._first_step)
        if self.state is RunState.PAUSED:
            # Who steps one by one wants to see the state after each; readings keep to their rates.
            outputs = tuple(output for output in Output if output in outputs or output in STATES)
        return Tick(self.time_ns, outputs)

    def set_start_time(self, start_time_s: float) -> None:
        """Let simulated time start at this time, s, rounded to a whole step so that stamps keep to one grid.

        Only before the first step: a later change would be a jump in time.
        """
        self._move_to(round(start_time_s / self._simulation.timestep_s) * self._timestep_ns)
        self.restart_pace()

    def pause(self) -> None:
        """Stop simulated time; nothing changes if it stands already.

        Raises:
            RefusedError: steps are being taken, which ends in a pause anyway.

        """
        self._refuse_while_stepping("pause")
        if self.state is RunState.RUNNING:
            self.state = RunState.PAUSED

    def resume(self) -> None:
        """Let simulated time run on from where it stands; nothing changes if it runs already.

        Raises:
            RefusedError: steps are being taken, or the simulation has failed.

        """
        self._refuse_while_stepping("resume")
        self._refuse_after_failure("resume")
        if self.state is not RunState.RUNNING:
            self.state = RunState.RUNNING
            if self._limit_ns is not None:  # the clock went on meanwhile
                self._move_to(self._limit_ns)
            self.restart_pace()

    def begin_steps(self, steps: int) -> None:
        """Take 1 to MAX_STEPS steps while paused, in the cycles to come.

        Raises:
            RefusedError: the number is out of range, or simulated time is not paused.

        """
        self._refuse_while_stepping("step")
        self._refuse_after_failure("step")
        if self.state is RunState.RUNNING:
            msg = "cannot step while running; pause first with ~/set_paused"
            raise RefusedError(msg)
        if not 1 <= steps <= MAX_STEPS:
            msg = f"steps is {steps}; it must be 1 to {MAX_STEPS}; ask several times for more"
            raise RefusedError(msg)
        self.state, self._steps_left = RunState.STEPPING, steps
        self._factor.restart()

    def set_speed(self, speed: float) -> None:
        """Change the pace from now on; 0 is as fast as possible."""
        if speed != self.pacer.speed:
            self.restart_pace(speed)

    def restart_pace(self, speed: float | None = None) -> None:
        """Let simulated time go on from where it stands now, without catching up; with another speed if given."""
        self.pacer.restart(self._time_s_at(self._step), self._now_s(), speed)
        self._factor.restart()

    def fail(self, why: str) -> None:
        """Stop simulated time until a reset, and remember why, in one line."""
        self.state, self.failure = RunState.FAILED, why

    def reset(self) -> None:
        """Restore the rig; simulated time goes on, and the schedule counts from here. After a failure it stays paused.

        Raises:
            RefusedError: steps are being taken.

        """
        self._refuse_while_stepping("reset")
        if self.state is RunState.FAILED:
            self.state, self.failure = RunState.PAUSED, ""
        self._simulation.reset()
        self._first_step = self._step
        self.restart_pace()

    def _refuse_while_stepping(self, request: str) -> None:
        if self.state is RunState.STEPPING:
            msg = f"cannot {request} while {self._steps_left} steps are still to take; wait for the answer of ~/step"
            raise RefusedError(msg)

    def _refuse_after_failure(self, request: str) -> None:
        if self.state is RunState.FAILED:
            msg = f"cannot {request}: {self.failure}; call ~/reset"
            raise RefusedError(msg)

    @property
    def _step(self) -> int:
        return round(self._simulation.time_s / self._simulation.timestep_s)

    def _next_step(self) -> int:
        return self._step + self._schedule.steps_to_next(self._step - self._first_step)

    def _time_ns_at(self, step: int) -> int:
        return self._offset_ns + step * self._timestep_ns

    def _time_s_at(self, step: int) -> float:
        return self._time_ns_at(step) / NANOSECONDS_PER_SECOND

    def _move_to(self, time_ns: int) -> None:
        """Let the step that it stands at lie at this simulated time."""
        self._offset_ns += time_ns - self.time_ns


MAX_STEPS = 100_000
"""Most steps of one request, as jammkle_msgs/Step says; 50 s of simulated time at 0.5 ms."""


class RunState(enum.Enum):
    """What simulated time does."""

    RUNNING = "running"
    PAUSED = "paused"
    STEPPING = "stepping"
    """Paused, and taking a number of steps that somebody asked for."""
    FAILED = "failed"
    """Paused because the simulation became unstable; only a reset helps."""


class RefusedError(Exception):
    """A request that is refused. The message names the state, or the value and its limit, and the way out."""


AS_FAST_AS_POSSIBLE = 0.0
"""The speed that stands for no pacing at all."""

MAX_BACKLOG_S = 0.1
"""Real time that may be caught up, s. Assumed: longer than any usual pause of the machine, and short enough that
catching up is no burst that a 100 Hz regulator would feel."""

_FACTOR_WINDOW_S = 2.0
_FACTOR_SAMPLE_S = 0.05
_FACTOR_SHORTEST_S = 0.25


class Pacer:
    """Maps simulated time to the real time at which it is due, without drift: due times count from one fixed anchor.

    Simulated time never runs ahead of real time x speed. When the machine falls behind by more than
    `max_backlog_s` of real time, the excess is given up for good instead of being caught up in a rush.
    """

    def __init__(self, speed: float, max_backlog_s: float = MAX_BACKLOG_S) -> None:
        """Make a pacer; `restart` it before use. `max_backlog_s` is the real time that may be caught up, s."""
        self._max_backlog_s = max_backlog_s
        self.late_cycles = 0
        """How many cycles began only when the one after them was due already."""
        self.given_up_s = 0.0
        """Real time, s, that was lost for good because the backlog had grown beyond its bound."""
        self.speed = speed
        """Simulated seconds per real second; 0 is as fast as possible."""
        self._anchor_real_s = 0.0
        self._anchor_simulated_s = 0.0
        self._last_simulated_s = 0.0

    def restart(self, simulated_s: float, now_s: float, speed: float | None = None) -> None:
        """Begin anew: `simulated_s` is due at `now_s`. After a pause, a change of speed, or whatever stopped time."""
        self._anchor_real_s = now_s
        self._anchor_simulated_s = simulated_s
        self._last_simulated_s = simulated_s
        if speed is not None:
            self.speed = speed

    def wait_s(self, simulated_s: float, now_s: float) -> float:
        """Real time, s, until `simulated_s` is due; 0 when it is due, never negative."""
        if self.speed == AS_FAST_AS_POSSIBLE:
            return 0.0
        return max(0.0, self._due_s(simulated_s) - now_s)

    def begin(self, simulated_s: float, now_s: float) -> None:
        """Note that the cycle which ends at `simulated_s` begins now; keeps the count of late ones and the backlog."""
        if self.speed == AS_FAST_AS_POSSIBLE:
            return
        late_s = now_s - self._due_s(simulated_s)
        if late_s > (simulated_s - self._last_simulated_s) / self.speed:
            self.late_cycles += 1
        self._last_simulated_s = simulated_s
        if late_s > self._max_backlog_s:
            self.given_up_s += late_s - self._max_backlog_s
            self._anchor_real_s += late_s - self._max_backlog_s

    def _due_s(self, simulated_s: float) -> float:
        return self._anchor_real_s + (simulated_s - self._anchor_simulated_s) / self.speed


class RealTimeFactor:
    """Simulated time per real time, measured over the last two seconds of real time."""

    def __init__(self, shortest_s: float = _FACTOR_SHORTEST_S) -> None:
        """Make a meter that has measured nothing, and says nothing before it has measured for so long, s."""
        self._shortest_s = shortest_s
        self._samples: deque[tuple[float, float]] = deque()

    def restart(self) -> None:
        """Forget everything: time stood still, and a mean across that would mean nothing."""
        self._samples.clear()

    def note(self, simulated_s: float, now_s: float) -> None:
        """Note where simulated time stands at real time `now_s`; NaN: nobody knows. Time that goes back starts anew."""
        samples = self._samples
        if math.isnan(simulated_s):
            return
        if samples and simulated_s < samples[-1][1]:
            samples.clear()
        if samples and now_s - samples[-1][0] < _FACTOR_SAMPLE_S:
            return
        samples.append((now_s, simulated_s))
        while now_s - samples[0][0] > _FACTOR_WINDOW_S:
            samples.popleft()

    def value(self) -> float:
        """Simulated seconds per real second; NaN while too little has been measured."""
        if not self._samples:
            return math.nan
        (first_s, first_simulated_s), (last_s, last_simulated_s) = self._samples[0], self._samples[-1]
        span_s = last_s - first_s
        return (last_simulated_s - first_simulated_s) / span_s if span_s >= self._shortest_s else math.nan


_RATE_TOLERANCE = 1e-9


class Output(enum.Enum):
    """What the sim node publishes at rates of their own. Listed in the order of publishing."""

    JOINT_STATES = "joint_states"
    TENDON_STATES = "tendon_states"
    LOAD_CELL = "load_cell"
    TRUE_CONTACT = "true_contact"
    GAIT = "gait"
    """What the robot's gait plans of the foot."""
    MACHINE = "machine"
    """Where the base is, and the joints of all ankles together."""
    PRESSURES = "pressures"
    IMU = "imu"


STATES = (Output.JOINT_STATES, Output.TENDON_STATES)
"""Outputs that are states and not readings: looking at them once more, between two due times, disturbs nothing."""


def timestep_ns(timestep_s: float) -> int:
    """Return the time step in whole nanoseconds, so that every stamp is exact.

    Raises:
        ParameterError: it is not a whole number of nanoseconds.

    """
    nanoseconds = timestep_s * NANOSECONDS_PER_SECOND
    if round(nanoseconds) < 1 or abs(nanoseconds - round(nanoseconds)) > _RATE_TOLERANCE * nanoseconds:
        msg = f"timestep_s is {timestep_s!r}; it must be a whole number of nanoseconds, as 0.0005 is"
        raise ParameterError(msg)
    return round(nanoseconds)


def steps_per_output(rate_hz: int, timestep_s: float, max_rate_hz: int) -> int:
    """Whole number of steps between two outputs; no rate above the highest is named as a way out.

    Raises:
        ParameterError: the rate is not the step rate divided by a whole number.

    """
    steps_per_second = 1.0 / timestep_s
    steps = steps_per_second / rate_hz
    if steps < 1 - _RATE_TOLERANCE or abs(steps - round(steps)) > _RATE_TOLERANCE * steps:
        fitting = [
            rate
            for rate in range(1, max_rate_hz + 1)
            if abs(steps_per_second / rate - round(steps_per_second / rate)) <= _RATE_TOLERANCE * steps_per_second
        ]
        below, above = [rate for rate in fitting if rate < rate_hz], [rate for rate in fitting if rate > rate_hz]
        neighbours = " or ".join(str(rate) for rate in below[-1:] + above[:1])
        way_out = f"as {neighbours} Hz" if neighbours else "which none does: change timestep_s, 0.0005 s is usual"
        msg = (
            f"an output rate of {rate_hz} Hz does not fit timestep_s of {timestep_s:g} s; "
            f"the rate must divide {steps_per_second:g} Hz, {way_out}"
        )
        raise ParameterError(msg)
    return round(steps)


class Schedule:
    """Outputs by step, counted from the last (re)start of the rig. An output of period n is due at n, 2n, 3n ..."""

    def __init__(self, periods: Mapping[Output, int]) -> None:
        """Take the steps between two of each output, each at least 1."""
        if not periods or min(periods.values()) < 1:
            msg = f"every output needs a period of at least one step, not {dict(periods)}"
            raise ValueError(msg)
        # An enum's members iterate in the order of their definition, which is the order of publishing.
        self._periods = tuple((output, periods[output]) for output in Output if output in periods)
        self._distinct = tuple(sorted(set(periods.values())))

    def due(self, step: int) -> tuple[Output, ...]:
        """Outputs due at `step`, in the order of publishing."""
        return tuple([output for output, period in self._periods if step % period == 0])

    def steps_to_next(self, step: int) -> int:
        """Steps from `step` to the next one, after it, at which something is due."""
        return min([period - step % period for period in self._distinct])
