"""Schedule: every output exactly at its rate, in the order of publishing, for ever."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_common.parameters import ParameterError
from jammkle_sim.core.engine import Output, Schedule, steps_per_output, timestep_ns

PERIODS = st.dictionaries(st.sampled_from(list(Output)), st.integers(1, 40), min_size=1)
HOURS_LATER = 2000 * 3600 * 100


def due_between(schedule: Schedule, first: int, last: int) -> dict[int, tuple[Output, ...]]:
    """Walk from due step to due step as the engine does."""
    found = {}
    step = first
    while (step := step + schedule.steps_to_next(step)) <= last:
        found[step] = schedule.due(step)
    return found


@given(PERIODS, st.sampled_from([0, 1, 777, HOURS_LATER]))
def test_every_output_comes_exactly_at_its_period(periods: dict[Output, int], first: int) -> None:
    """Each output is due at the multiples of its period and at no other step, also after a hundred hours."""
    found = due_between(Schedule(periods), first, first + 300)
    for output in Output:
        steps = [step for step, outputs in found.items() if output in outputs]
        period = periods.get(output)
        expected = [step for step in range(first + 1, first + 301) if period and step % period == 0]
        assert steps == expected


@given(PERIODS)
def test_no_stop_without_an_output(periods: dict[Output, int]) -> None:
    """The walk stops only where something is due, and in the order of publishing."""
    order = list(Output)
    for outputs in due_between(Schedule(periods), 0, 200).values():
        assert outputs
        assert list(outputs) == sorted(outputs, key=order.index)


@given(st.integers(1, 2000))
def test_a_rate_is_exact_or_refused(rate_hz: int) -> None:
    """A rate gives a whole number of steps, or an error that names rates which do."""
    if 2000 % rate_hz == 0:
        assert steps_per_output(rate_hz, 0.0005, 1000) * rate_hz == 2000
    else:
        with pytest.raises(ParameterError, match=rf"{rate_hz} Hz .* must divide 2000 Hz, as \d+( or \d+)? Hz$"):
            steps_per_output(rate_hz, 0.0005, 1000)


def test_the_rates_named_in_an_error_are_the_neighbours() -> None:
    """300 Hz at 0.5 ms: 250 and 400 Hz would do."""
    with pytest.raises(ParameterError, match=r"as 250 or 400 Hz$"):
        steps_per_output(300, 0.0005, 1000)


def test_stamps_need_whole_nanoseconds() -> None:
    """0.5 ms is exact; a third of a millisecond is refused, since its stamps would drift."""
    assert timestep_ns(0.0005) == 500_000
    with pytest.raises(ParameterError, match="whole number of nanoseconds"):
        timestep_ns(1 / 3000)


@pytest.mark.parametrize("periods", [{}, {Output.IMU: 0}])
def test_an_impossible_schedule_is_refused(periods: dict[Output, int]) -> None:
    """Nothing at all, or a period of zero steps, is a mistake of the caller."""
    with pytest.raises(ValueError, match="at least one step"):
        Schedule(periods)
