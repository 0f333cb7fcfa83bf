"""The slip rig: what jamming gains on a slope, and when a rigid foot slides."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common.parameters import ParameterError, from_mapping, in_si, rows, typed_name
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.rigs import slip
from jammkle_sim.rigs.catalogue import run_rig, scattered
from jammkle_sim.rigs.run import run
from jammkle_sim.rigs.simulation import OverloadError, Simulation, UnstableSimulationError
from jammkle_sim.rigs.slip import Footing, SlipOptions
from studies.paper.tables import SIGNIFICANT, are_similar

if TYPE_CHECKING:
    from jammkle_sim.rigs.run import RigRun


@functools.cache
def push(repeat: int | None = None, **values: object) -> RigRun:
    """One slip test, scattered if a repeat is given."""
    options = from_mapping(SlipOptions, values)
    if repeat is not None:
        options = scattered("slip", options, repeat)
    return run_rig("slip", options, lambda _: None, lambda: False)


ADVICE = r"([a-z][a-z-]*) of (\d[\d.]*)"


def advised(line: str) -> list[dict[str, float]]:
    """Every way out that an error names, as options."""
    ways = line.split(": give ")[1].split(" or --")
    names = {typed_name(field.name): field.name for field in dataclasses.fields(SlipOptions)}
    return [
        {names[typed]: in_si(names[typed], float(value)) for typed, value in re.findall(ADVICE, way)} for way in ways
    ]


@pytest.mark.parametrize("repeat", [0, 1])
def test_jamming_pays(repeat: int) -> None:
    """At -50 kPa peaks and energy are at least 1.5 times those of the unjammed ankle, and -30 kPa lies between."""
    unjammed = push(repeat, foot="unjammed").results
    half = push(repeat, foot="jammed", vacuum_pa=30e3).results
    jammed = push(repeat, foot="jammed").results
    for figure in ("peak_before_heel_n", "peak_force_n", "energy_n_m"):
        assert jammed[figure] > 1.5 * unjammed[figure]
        assert unjammed[figure] < half[figure] < jammed[figure]


def test_two_of_the_papers_claims_hold_and_one_does_not() -> None:
    """Jammed peaks highest and dissipates significantly more than rigid; the rigid peak is not like the unjammed."""
    rigid, unjammed, jammed = (push(foot=foot).results for foot in ("rigid_ankle", "unjammed", "jammed"))
    peak = "peak_before_heel_n"
    assert jammed[peak] > max(unjammed[peak], rigid[peak])
    assert jammed["energy_n_m"] >= SIGNIFICANT * rigid["energy_n_m"]
    assert not are_similar(unjammed[peak], rigid[peak])


@pytest.mark.parametrize(
    ("damping", "values"),
    [
        (0.005, {}),
        (0.005, {"timestep_s": 0.00025}),
        (0.005, {"timestep_s": 0.001}),
        (0.0, {}),
        (0.05, {}),
        (0.005, {"speed_m_s": 0.0025}),
    ],
)
def test_rigid_ankle_is_well_posed(damping: float, values: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever time step, damping and speed, its work is 0.169 J within 4 % and its peak below 5 N: its own weight."""
    monkeypatch.setattr(slip, "_BALL_DAMPING_N_M_S", damping)
    rig, programme = slip.slip_rig(from_mapping(SlipOptions, {"foot": "rigid_ankle", **values}))
    results = run(rig, programme, None, lambda _: None, lambda: False).results
    assert results["energy_n_m"] == pytest.approx(0.169, rel=0.04)
    assert 1.0 < results["peak_before_heel_n"] < 5.0
    assert "descent_at_heel_m" not in results
    assert results["peak_before_heel_n"] == results["peak_force_n"]


def test_a_rigid_foot_that_hangs_toe_down_wedges_later() -> None:
    """Its toe is nearer to the line through the ball joint: 0.433 flat, 0.590 by 40 degrees; ankles hang so too."""
    hung = {"foot": "rigid_ankle", "edge_friction": 0.58, "hang_pitch_deg": 40.0}
    slip.slip_rig(from_mapping(SlipOptions, hung))
    with pytest.raises(ParameterError, match=r"from 0\.590 on"):
        slip.slip_rig(from_mapping(SlipOptions, {**hung, "edge_friction": 0.6}))
    with pytest.raises(ParameterError, match=r"from 0\.433 on"):
        slip.slip_rig(from_mapping(SlipOptions, {**hung, "hang_pitch_deg": 0.0}))
    simulation = Simulation(slip.slip_rig(from_mapping(SlipOptions, {**hung, "foot": "jammed"}))[0])
    assert simulation.joint_position("ankle_pitch") == pytest.approx(math.radians(40.0))


@pytest.mark.parametrize("foot", ["unjammed", "jammed"])
def test_a_heel_that_lands_is_not_taken_for_the_peak_before(foot: str) -> None:
    """The heel lands after about 47 mm, where the force jumps; the peak before stands for itself, from before."""
    run = push(foot=foot)
    descent_m = run.results["descent_at_heel_m"]
    assert descent_m == pytest.approx(0.047, abs=0.001)
    assert run.results["peak_force_n"] > 1.5 * run.results["peak_before_heel_n"]
    assert run.results["descent_at_peak_m"] > descent_m
    height_m = run.topics["joint_states"].column("carriage.position")
    before = height_m[0] - height_m < descent_m - 1e-3
    force_n = run.topics["load_cell/wrench"].column("force_z_n")
    largest_n = force_n[:400].mean() - force_n[before].min()
    assert run.results["peak_before_heel_n"] == pytest.approx(largest_n, rel=0.03)


def test_leg_hangs_still_until_it_touches() -> None:
    """Before the touch it does not swing: what happens then does not depend on when it is pushed."""
    simulation = Simulation(slip.slip_rig(SlipOptions(foot="rigid_ankle"))[0])
    heights_m = []
    for _ in range(20):
        simulation.advance(100)
        heights_m.append(simulation.ground_clearance_m("toe_left"))
    assert heights_m[0] > 0.0005
    assert heights_m == pytest.approx([heights_m[0]] * 20, abs=1e-6)


def test_friction_that_wedges_is_refused_with_its_limit() -> None:
    """The line names the friction, the limit and the way out, and the option's own help the limit."""
    with pytest.raises(
        ParameterError, match=r"'edge_friction' is 0.6; the rigid foot wedges from 0.433 on .*--edge-friction of 0.31"
    ):
        push(foot="rigid_ankle", edge_friction=0.6)
    (row,) = (row for row in rows(SlipOptions) if row.name == "edge_friction")
    assert f"{Footing(40.0, 0.18, AnkleParameters()).wedging_friction:.3f}" in row.description


@pytest.mark.parametrize("leg_m", [0.12, 0.18, 0.4])
@pytest.mark.parametrize("slope_deg", [5.0, 17.0, 25.0, 40.0])
@pytest.mark.parametrize("edge_friction", [0.05, 0.6, 1.0])
def test_every_way_out_of_wedging_helps(leg_m: float, slope_deg: float, edge_friction: float) -> None:
    """Each value that the refusal names is in range and lets the foot slide, on gentle slopes and at full speed too."""
    asked = {"leg_m": leg_m, "slope_deg": slope_deg, "edge_friction": edge_friction}
    brisk = {"foot": "rigid_ankle", "speed_m_s": 0.05, "descent_m": 0.01}
    if edge_friction < Footing(slope_deg, leg_m, AnkleParameters()).wedging_friction:
        return  # it slides as asked for
    with pytest.raises(ParameterError) as refused:
        push(**asked, **brisk)
    ways = advised(str(refused.value))
    assert all(ways)
    for way in ways:
        push(**{**asked, **way}, **brisk)


def test_limit_is_where_the_force_runs_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the limit the force passes the load cell's range, below it it does not: the refusal is no mere caution."""
    monkeypatch.setattr(slip, "check_slides", lambda *_: None)
    limit = Footing(40.0, SlipOptions().leg_m, AnkleParameters()).wedging_friction
    options = {"foot": "rigid_ankle", "descent_m": 0.02}
    assert push(edge_friction=limit - 0.01, **options).results["peak_force_n"] < 50.0
    with pytest.raises(OverloadError, match="the force passed 245 N"):
        push(edge_friction=limit + 0.01, **options)


def test_repeats_of_a_rigid_foot_never_wedge_by_scatter_alone() -> None:
    """What slides as asked for slides in every repeat; what wedges as asked for is refused in every one."""
    near = SlipOptions(foot="rigid_ankle", edge_friction=0.43)
    beyond = dataclasses.replace(near, edge_friction=0.435)
    for repeat in range(20):
        slip.slip_rig(scattered("slip", near, repeat))
        with pytest.raises(ParameterError, match="wedges"):
            slip.slip_rig(scattered("slip", beyond, repeat))


@pytest.mark.parametrize("foot", ["jammed", "unjammed"])
@pytest.mark.parametrize("slope_deg", [5.0, 20.0])
def test_an_ankle_that_wedges_ends_the_run_with_one_line(foot: str, slope_deg: float) -> None:
    """The line names range, descent and what to change; whoever runs rigs takes it as a failed simulation."""
    with pytest.raises(UnstableSimulationError) as caught:
        push(foot=foot, slope_deg=slope_deg, speed_m_s=0.02)
    line = str(caught.value)
    assert re.search(r"passed 245 N, .*at a descent of \d+\.\d mm; .*", line)
    assert "\n" not in line
    assert advised(line) == [{"slope_deg": 40.0, "friction": 0.55}]


@pytest.mark.parametrize("leg_m", [0.12, 0.4])
def test_what_an_ankle_that_wedges_is_advised_helps(leg_m: float) -> None:
    """At the advised slope and friction the stiffest ankle slides with the shortest and the longest leg."""
    worst = {"foot": "jammed", "vacuum_pa": 75e3, "speed_m_s": 0.05}
    assert push(slope_deg=40.0, friction=0.55, leg_m=leg_m, **worst).results["peak_force_n"] < 245.0


def largest(done: RigRun, column: str) -> float:
    """Return the largest reading of the load cell in one of its columns, to both sides."""
    return float(np.abs(done.topics["load_cell/wrench"].column(column)).max())


def test_what_the_cell_cannot_carry_is_clipped() -> None:
    """Where a rig goes on regardless, the readings stand at the range, on no axis beyond it."""
    rig, programme = slip.slip_rig(SlipOptions(foot="jammed", slope_deg=20.0, speed_m_s=0.02))
    programme = dataclasses.replace(programme, overload_advice="")
    done = run(rig, programme, None, lambda _: None, lambda: False)
    measured = done.topics["load_cell/wrench"].values
    assert np.abs(measured).max() == rig.sensors.load_cell_limit_n == 245.0
    named = [line.partition(" of the load cell")[0] for line in done.clipped if "load cell" in line]
    assert named == [name for name in done.topics["load_cell/wrench"].columns if largest(done, name) == 245.0]
    assert 0 < len(named) < 6


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
    """Peaks and energy move by less than 1 %."""
    for foot in ("unjammed", "jammed"):
        coarse, fine = push(foot=foot).results, push(foot=foot, timestep_s=0.00025).results
        for peak in ("peak_before_heel_n", "peak_force_n"):
            assert fine[peak] == pytest.approx(coarse[peak], rel=0.01)
        assert fine["energy_n_m"] == pytest.approx(coarse["energy_n_m"], rel=0.01)
