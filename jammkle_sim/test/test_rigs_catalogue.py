"""What holds for every rig of the catalogue: bytes, scatter, cancelling, bad input, finite figures, saved models."""

from __future__ import annotations

import dataclasses
import functools
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from jammkle_common.parameters import ParameterError, from_mapping, rows
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.catalogue import EXERCISES, RIGS, rig_kind, run_rig, save_mjcf, scattered
from jammkle_sim.rigs.run import RigCancelledError, RigRun
from jammkle_sim.rigs.simulation import Simulation

if TYPE_CHECKING:
    from pathlib import Path

QUICK: dict[str, dict[str, object]] = {
    "tensile": {"speed_m_s": 0.05, "vacuum_pa": 50e3},
    "pressure": {"cycles": 1},
    "drop": {"foot": "jammed"},
    "slip": {"foot": "jammed", "speed_m_s": 0.05, "descent_m": 0.03},
    "landing": {"release_time_s": 0.2},
    "cycle": {"jam_time_s": 0.5, "vent_time_s": 0.2},
    "press": {"sides": "no", "way_time_s": 0.2},
    "shake": {"sweep_s": 1.0},
    "tilt": {"hold_s": 0.5},
}


def quick(name: str, **values: object) -> Any:
    """Options of a short run."""
    return from_mapping(RIGS[name].options, {**QUICK[name], **values})


def go(name: str, options: Any) -> RigRun:
    """Run without watching."""
    return run_rig(name, options, lambda _: None, lambda: False)


@functools.cache
def usual(name: str) -> RigRun:
    """The short run of a rig, made once."""
    return go(name, quick(name))


def same(one: RigRun, other: RigRun) -> bool:
    """Whether two runs agree to the last bit."""
    return one.results == other.results and all(
        series.time_s.tobytes() == other.topics[topic].time_s.tobytes()
        and series.values.tobytes() == other.topics[topic].values.tobytes()
        for topic, series in one.topics.items()
    )


def test_catalogue_holds_the_rigs() -> None:
    """Rigs of a laboratory and exercises of a robot; every one has a seed, a parameter set and a time step."""
    assert set(RIGS) == {"tensile", "pressure", "drop", "slip", "landing", *EXERCISES}
    assert set(EXERCISES) == {"cycle", "press", "shake", "tilt"}
    for kind in RIGS.values():
        assert {"seed", "parameter_set", "timestep_s"} <= {row.name for row in rows(kind.options)}
        assert all(row.description for row in rows(kind.options))


@pytest.mark.parametrize("name", RIGS)
def test_another_seed_gives_other_noise(name: str) -> None:
    """A run with another seed does not agree to the last bit; that one with the same does is tested for any options."""
    assert not same(usual(name), go(name, quick(name, seed=1)))


@pytest.mark.parametrize("name", RIGS)
def test_recording_does_not_disturb(name: str) -> None:
    """A run recorded in rows, across its events, ends where one that is only advanced ends."""
    recorded, advanced = (Simulation(RIGS[name].build(quick(name))[0]) for _ in range(2))
    recorded.record(300, 2)
    recorded.record(450, 3)
    advanced.advance(1950)
    assert recorded.ankle.joint_positions() == advanced.ankle.joint_positions()
    assert recorded.ankle.tendons() == advanced.ankle.tendons()
    assert recorded.ankle.imu() == advanced.ankle.imu()


@pytest.mark.parametrize("name", RIGS)
def test_repeats_differ_and_come_back(name: str) -> None:
    """Every repeat has options and noise of its own, the same every time, and within range."""
    options = quick(name)
    repeats = [scattered(name, options, repeat) for repeat in range(5)]
    assert repeats == [scattered(name, options, repeat) for repeat in range(5)]
    assert len({dataclasses.astuple(repeat) for repeat in repeats}) == 5
    for repeat in repeats:
        from_mapping(RIGS[name].options, dataclasses.asdict(repeat))


@pytest.mark.parametrize("name", RIGS)
def test_run_is_complete_and_can_be_written(name: str) -> None:
    """Times rise by the topic's rate from first to last, commands start at 0 s, description and results are plain."""
    run = usual(name)
    rates_hz = {"imu/data": 1000, "joint_states": 500, "tendon_states": 500, "load_cell/wrench": 500}
    for topic, series in run.topics.items():
        assert series.values.shape == (len(series.time_s), len(series.columns))
        assert np.isfinite(series.values).all()
        assert (np.diff(series.time_s) > 0.0).all()
        if topic in rates_hz:
            assert np.diff(series.time_s) == pytest.approx(1.0 / rates_hz[topic])
    for topic in ("pump/duty", "achilles/solenoid"):
        assert run.topics[topic].time_s[0] == 0.0
    assert np.diff(run.topics["manifold/pressure"].time_s) == pytest.approx(0.01)
    assert json.loads(json.dumps(run.description))["options"] == dataclasses.asdict(run.options)
    json.dumps(run.results, allow_nan=False)


@pytest.mark.parametrize("name", RIGS)
def test_saved_model_opens_in_mujoco(name: str, tmp_path: Path) -> None:
    """The MJCF has the bodies, tendons and start of what was simulated, and says at its top what it does not have."""
    options = quick(name)
    save_mjcf(name, options, tmp_path / "rig.xml")
    top = (tmp_path / "rig.xml").read_text().partition("<mujoco")[0]
    assert all(word in top for word in (f"Rig {name}.", "law of the tendons", "air", "release"))
    read, made = mujoco.MjModel.from_xml_path(str(tmp_path / "rig.xml")), RIGS[name].build(options)[0].model
    assert (read.nq, read.nbody, read.ntendon, read.nu, read.nkey) == (
        made.nq,
        made.nbody,
        made.ntendon,
        made.nu,
        made.nkey,
    )
    assert read.body_mass == pytest.approx(made.body_mass)


def test_run_can_be_watched_and_cancelled() -> None:
    """Progress rises from 0 to 1; a cancelled run ends with a line that says how far it came."""
    progress: list[float] = []
    run_rig("drop", quick("drop"), progress.append, lambda: False)
    assert progress[0] == 0.0
    assert progress[-1] == 1.0
    assert progress == sorted(progress)
    with pytest.raises(RigCancelledError, match="'drop' was cancelled after"):
        run_rig("drop", quick("drop"), progress.append, lambda: True)


def test_bad_input_gets_one_line() -> None:
    """Unknown rig, another rig's options, values out of range and odd time steps are named with what is right."""
    with pytest.raises(
        ParameterError, match=r"'jump' does not exist; known are: tensile, pressure, drop, slip, landing"
    ):
        rig_kind("jump")
    with pytest.raises(ParameterError, match="must be DropOptions, not SlipOptions"):
        go("drop", quick("slip"))
    with pytest.raises(ParameterError, match="'foot' is 'hoof'; it must be one of rigid_ankle, standard"):
        go("drop", dataclasses.replace(quick("drop"), foot="hoof"))
    with pytest.raises(ParameterError, match="'vacuum_pa' is nan"):
        go("tensile", dataclasses.replace(quick("tensile"), vacuum_pa=float("nan")))
    with pytest.raises(ParameterError, match=r"'timestep_s' is 0.0003; it must divide 0.001 s"):
        go("drop", quick("drop", timestep_s=0.0003))
