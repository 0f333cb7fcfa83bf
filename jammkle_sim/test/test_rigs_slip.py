"""The slip rig: what jamming gains on a slope, and when a rigid foot slides."""

from __future__ import annotations

import dataclasses
import functools
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_graph.parameters import ParameterError, from_mapping
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.rigs import slip
from jammkle_sim.rigs.catalogue import run_rig, scattered
from jammkle_sim.rigs.run import run
from jammkle_sim.rigs.simulation import OverloadError, UnstableSimulationError
from jammkle_sim.rigs.slip import SlipOptions, wedging_friction

if TYPE_CHECKING:
    from jammkle_sim.rigs.run import RigRun


@functools.cache
def push(repeat: int | None = None, **values: object) -> RigRun:
    """One slip test, scattered if a repeat is given."""
    options = from_mapping(SlipOptions, values)
    if repeat is not None:
        options = scattered("slip", options, repeat)
    return run_rig("slip", options, lambda _: None, lambda: False)


@pytest.mark.parametrize("repeat", [0, 1])
def test_jamming_pays(repeat: int) -> None:
    """At -50 kPa peak force and energy are at least 1.5 times those of the unjammed ankle, and -30 kPa lies between."""
    unjammed = push(repeat, foot="unjammed").results
    half = push(repeat, foot="jammed", vacuum_pa=30e3).results
    jammed = push(repeat, foot="jammed").results
    for figure in ("peak_force_n", "energy_n_m"):
        assert jammed[figure] > 1.5 * unjammed[figure]
        assert unjammed[figure] < half[figure] < jammed[figure]


def test_rigid_ankle_pushes_like_the_unjammed_one_and_keeps_little_energy() -> None:
    """Just below the friction that wedges it, the rigid foot peaks at 0.3 to 1.2 of the unjammed, with less energy."""
    rigid, unjammed, jammed = push(foot="rigid_ankle").results, push().results, push(foot="jammed").results
    assert 0.3 < rigid["peak_force_n"] / unjammed["peak_force_n"] < 1.2
    assert jammed["energy_n_m"] > 5.0 * rigid["energy_n_m"]


def test_friction_that_wedges_is_refused_with_its_limit() -> None:
    """The line names the friction, the limit and the way out."""
    with pytest.raises(
        ParameterError, match=r"'edge_friction' is 0.6; the rigid foot wedges from 0.411 on .*longer leg"
    ):
        push(foot="rigid_ankle", edge_friction=0.6)


def test_limit_is_where_the_force_runs_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the limit the force passes the load cell's range, below it it does not: the refusal is no mere caution."""
    monkeypatch.setattr(slip, "check_slides", lambda *_: None)
    limit = wedging_friction(40.0, SlipOptions().leg_m, AnkleParameters())
    options = {"foot": "rigid_ankle", "descent_m": 0.02}
    assert push(edge_friction=limit - 0.03, **options).results["peak_force_n"] < 50.0
    with pytest.raises(OverloadError, match="the force passed 245 N"):
        push(edge_friction=limit + 0.06, **options)


@pytest.mark.parametrize("foot", ["jammed", "unjammed"])
def test_an_ankle_that_wedges_ends_the_run_with_one_line(foot: str) -> None:
    """The line names range, descent and what to change; whoever runs rigs takes it as a failed simulation."""
    with pytest.raises(UnstableSimulationError) as caught:
        push(foot=foot, slope_deg=20.0, speed_m_s=0.02)
    line = str(caught.value)
    assert re.search(r"passed 245 N, .*at a descent of \d+\.\d mm; .*less friction .*steeper slope .*descent_m", line)
    assert "\n" not in line


def test_what_the_cell_cannot_carry_is_clipped() -> None:
    """Where a rig goes on regardless, the readings stand at the range, on no axis beyond it."""
    rig, programme = slip.slip_rig(SlipOptions(foot="jammed", slope_deg=20.0, speed_m_s=0.02))
    programme = dataclasses.replace(programme, overload_advice="")
    measured = run(rig, programme, None, lambda _: None, lambda: False).topics["load_cell/wrench"].values
    assert np.abs(measured).max() == rig.sensors.load_cell_limit_n == 245.0


def test_carriage_goes_down_its_way_at_its_speed() -> None:
    """It goes 110 mm and the clearance at 5 mm/s, whatever pushes back."""
    run = push(foot="jammed")
    assert run.results["descent_m"] == pytest.approx(0.111, abs=2e-4)
    joints = run.topics["joint_states"]
    moving = (joints.time_s > 1.1) & (joints.time_s < 23.0)
    assert joints.column("carriage.velocity")[moving].mean() == pytest.approx(-0.005, rel=0.01)


def test_foot_slides_in_the_end_and_stays_upright() -> None:
    """The force falls to less than a third of its peak; the foot does not roll or twist on the way; nothing breaks."""
    run = push()
    assert run.results["final_force_n"] < run.results["peak_force_n"] / 3.0
    for joint in ("ankle_roll", "ankle_yaw"):
        assert np.abs(run.topics["joint_states"].column(f"{joint}.position")).max() < 0.05
    assert not run.broken


def test_half_the_time_step_changes_little() -> None:
    """Peak and energy move by less than 1 %."""
    for foot in ("unjammed", "jammed"):
        coarse, fine = push(foot=foot).results, push(foot=foot, timestep_s=0.00025).results
        assert fine["peak_force_n"] == pytest.approx(coarse["peak_force_n"], rel=0.01)
        assert fine["energy_n_m"] == pytest.approx(coarse["energy_n_m"], rel=0.01)
