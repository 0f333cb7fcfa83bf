"""Commands between two time steps: means, delays, and valves with a dead time, as the stepped law has them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_sim.physics import kernels
from jammkle_sim.physics.pneumatics import PneumaticParameters, pneumatic_law, vented_state
from jammkle_sim.rigs.replay import Timeline, valve_timeline

DT_S = 0.0005
STEPS = 400


def timeline(*changes: tuple[float, float]) -> Timeline:
    """Make a timeline from times and values."""
    return Timeline(np.array([time_s for time_s, _ in changes]), np.array([value for _, value in changes]))


def test_a_change_between_two_steps_counts_for_its_share() -> None:
    """A value that begins a quarter into a step has three quarters of it there, and all of it later."""
    means = timeline((0.0, 0.0), (10.25 * DT_S, 0.8)).means(DT_S, 20)
    assert means[:10] == pytest.approx(0.0)
    assert means[10] == pytest.approx(0.6)
    assert means[11:] == pytest.approx(0.8)


@given(
    st.lists(st.tuples(st.floats(0.0, 0.19), st.floats(0.0, 1.0)), min_size=1, max_size=10, unique_by=lambda c: c[0]),
    st.floats(0.0, 0.01),
)
@settings(deadline=None)
def test_the_means_keep_the_area(changes: list[tuple[float, float]], delay_s: float) -> None:
    """However a command changes within steps, its time integral is kept."""
    line = timeline(*sorted(changes)).later(delay_s)
    ends_s = np.append(line.time_s[1:], STEPS * DT_S)
    area = float((line.values * (ends_s - line.time_s)).sum())
    assert line.means(DT_S, STEPS).sum() * DT_S == pytest.approx(area, abs=1e-6)


@given(
    st.lists(st.integers(0, STEPS - 1), min_size=1, max_size=8, unique=True),
    st.floats(0.0, 0.02),
    st.lists(st.integers(0, STEPS - 1), max_size=8),
)
@settings(deadline=None)
def test_valves_move_as_in_the_stepped_law(changes: list[int], dead_time_s: float, repeats: list[int]) -> None:
    """Given ahead or step by step, and however often anew, a valve draws for the same share of every step."""
    law = pneumatic_law(PneumaticParameters(valve_dead_time_s=dead_time_s), DT_S)
    state = vented_state(law)
    stepped = np.zeros(STEPS)
    for step in range(STEPS):
        if step in changes:
            state["command"][0, 0] = 1.0 - state["command"][0, 0]
        kernels.move_valves(law[0], state[0])
        stepped[step] = state["position"][0, 0]
    given = sorted({*changes, *repeats})
    values = [(DT_S * step, float(sum(change <= step for change in changes) % 2)) for step in given]
    ahead = valve_timeline(timeline(*values), dead_time_s, DT_S).means(DT_S, STEPS)
    taken_back = np.diff(sorted(changes)).min(initial=STEPS) <= dead_time_s / DT_S + 1
    if not taken_back:
        assert ahead == pytest.approx(stepped, abs=1e-5)
    else:  # a command that is taken back while the valve moves is a matter of less than a step
        assert abs(ahead.sum() - stepped.sum()) <= len(changes)
