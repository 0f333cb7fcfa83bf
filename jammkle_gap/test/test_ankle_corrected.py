"""corrected.yaml: written, read again, put into rigs; refused in one line where it cannot be right."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common import names
from jammkle_common.command.errors import InputError
from jammkle_common.parameters import ParameterError
from jammkle_gap import AnkleInputs, Recording
from jammkle_gap.ankle.corrected import Correction, corrected_text, load_change, load_correction
from jammkle_gap.ankle.effects import ankle_library, machine_constants
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.core.effects import BadEffectError, Library
from jammkle_sim.kinds import make_robot, make_simulation
from jammkle_sim.parameters import RobotParameters, SimParameters
from jammkle_sim.rigs.catalogue import RIGS, run_rig
from jammkle_sim.rigs.replay import CommandTrack, Timeline
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_sim.rigs.run import RigRun

LIBRARY = ankle_library()
NO_COMMANDS = CommandTrack(Timeline(np.zeros(1), np.zeros(1)), {})
OWN_LATENESS = """\
slow_bus:
  subsystem: timing
  sentence: "The bus is slow."
  inputs: shift_commands
  parameters:
    late_s: {unit: s, "null": 0, minimum: 0, maximum: 0.1, source: "a bus"}
"""
VALUES = {"line_leak_achilles.conductance_dm3_s_bar": 0.0012345678901234567, "imu_misalignment.roll_rad": -0.1}


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    """To the last digit; parameters of an effect that were not given are null; units stand beside the numbers."""
    text = corrected_text(LIBRARY, VALUES)
    (tmp_path / "corrected.yaml").write_text(text)
    values = load_correction(tmp_path / "corrected.yaml").values
    assert values == {**VALUES, "imu_misalignment.pitch_rad": 0.0, "imu_misalignment.yaw_rad": 0.0}
    assert "# dm3/(s bar), 0 to 0.01, off at 0" in text
    assert LIBRARY.effect("line_leak_achilles").sentence in text


@pytest.mark.parametrize("folder", ["rig #2", "a: b", "it's", "ä"])
def test_a_library_may_lie_anywhere(tmp_path: Path, folder: str) -> None:
    """What YAML takes for a comment or a name may stand in a path."""
    (tmp_path / folder).mkdir()
    own = tmp_path / folder / "own.yaml"
    own.write_text(OWN_LATENESS)
    values = {"slow_bus.late_s": 0.01}
    (tmp_path / "corrected.yaml").write_text(corrected_text(ankle_library(own), values, own), encoding="utf-8")
    assert load_correction(tmp_path / "corrected.yaml").values == values


def test_no_effects_are_no_change(tmp_path: Path) -> None:
    """A file without effects leaves the rig as it is, and its description too."""
    (tmp_path / "corrected.yaml").write_text(corrected_text(LIBRARY, {}))
    correction = load_correction(tmp_path / "corrected.yaml")
    options = RIGS["pressure"].options(cycles=1)
    plain, same = (
        run_rig("pressure", options, lambda _: None, lambda: False, *change) for change in ((), (correction,))
    )
    assert all(np.array_equal(plain.topics[name].values, same.topics[name].values) for name in plain.topics)
    assert same.description == plain.description


def test_constants_of_the_machine_are_loaded_as_the_diagnosis_simulates_them(tmp_path: Path) -> None:
    """A longer lever and a foot that hangs further toe-down are drawn so; a pump that draws less is changed so."""
    moved = {"lever_achilles.scale": 1.1, "pose.extra_deg": 3.0, "pump_curve.vacuum_scale": 0.95}
    (tmp_path / "corrected.yaml").write_text(corrected_text(machine_constants(), moved))
    correction = load_correction(tmp_path / "corrected.yaml")
    assert moved.items() <= correction.values.items()
    built, _ = RIGS["landing"].build(RIGS["landing"].options())
    found = correction(built)
    inputs = AnkleInputs("landing", tuple(sorted(dataclasses.asdict(built.options).items())), NO_COMMANDS)
    expected = AnkleSimulator(LIBRARY).rig(Recording("landing", (), inputs), correction.values)
    assert found.parts["ankle"] == expected.parts["ankle"]
    assert found.parts["ankle"] != built.parts["ankle"]
    assert laws_of(found).pneumatics.tobytes() == laws_of(expected).pneumatics.tobytes()


def test_a_rig_runs_with_its_effects() -> None:
    """A leak lowers the vacuum that a rig's worn pump holds, and the description tells both."""
    options = RIGS["tensile"].options(vacuum_pa=70e3, speed_m_s=0.05)
    correction = Correction(
        LIBRARY, {"line_leak_peroneal_left.conductance_dm3_s_bar": 0.01, "pump_wear.flow_scale": 0.5}
    )
    plain, leaking = (run_rig("tensile", options, lambda _: None, lambda: False, *c) for c in ((), (correction,)))
    lowest = [run.topics[names.PRESSURES[names.PERONEAL_LEFT].name].values.min() for run in (plain, leaking)]
    assert lowest[1] > lowest[0] + 5e3
    assert leaking.description["effects"] == dict(correction.values)


def test_the_sim_node_takes_the_file(tmp_path: Path) -> None:
    """With a heavier leg the same drop compresses the ankle further; commands that come late arrive late."""
    (tmp_path / "heavy.yaml").write_text(corrected_text(LIBRARY, {"payload.mass_kg": 1.0}))
    heights = []
    for file in ("", str(tmp_path / "heavy.yaml")):
        simulation = make_simulation(SimParameters(release_time_s=0.0, effects_file=file))
        simulation.advance(3000)
        heights.append(simulation.ankle.joint_positions()[names.CARRIAGE_JOINT])
    assert heights[1] < heights[0]

    (tmp_path / "late.yaml").write_text(corrected_text(LIBRARY, {"command_delay.delay_s": 0.1}))
    simulation = make_simulation(SimParameters(release_time_s=5.0, effects_file=str(tmp_path / "late.yaml")))
    simulation.ankle.set_pump_duty(1.0)
    simulation.ankle.set_solenoid(names.ACHILLES, energised=True)
    before = simulation.ankle.channel_pressures_pa()[names.ACHILLES]
    simulation.advance(200)
    assert simulation.ankle.channel_pressures_pa()[names.ACHILLES] == pytest.approx(before, abs=400.0)
    simulation.advance(200)
    assert simulation.ankle.channel_pressures_pa()[names.ACHILLES] < before - 5e3


def test_one_ankle_of_a_robot_has_the_effects_of_a_file(tmp_path: Path) -> None:
    """A leak in one of four ankles keeps its pump at work, and the description of the robot has it."""
    (tmp_path / "leak.yaml").write_text(corrected_text(LIBRARY, {"line_leak_achilles.conductance_dm3_s_bar": 0.004}))
    held = []
    for file, ankle in (("", ""), (str(tmp_path / "leak.yaml"), "lh_ankle")):
        parameters = RobotParameters(robot="quadruped", behaviour="stand", effects_file=file, effects_ankle=ankle)
        simulation = make_robot(parameters)
        for each in simulation.ankles.values():
            each.hold_vacuum({names.ACHILLES: 40e3})
        for _ in simulation.samples(duration_s=1.5, rate_hz=100):
            pass
        held.append({name: each.pump_duty for name, each in simulation.ankles.items()})
    healthy, leaking = held
    assert leaking["lh_ankle"] > healthy["lh_ankle"] + 0.1
    assert simulation.machine.description()["effects"] == {
        "lh_ankle": {"line_leak_achilles.conductance_dm3_s_bar": 0.004}
    }


@pytest.mark.parametrize(
    ("values", "ankle", "said"),
    [
        ({"payload.mass_kg": 1.0}, "", r"effect 'payload' changes a body.*take it out"),
        ({"ankle_joint_friction.viscous_n_m_s": 0.01}, "", r"effect 'ankle_joint_friction' changes a body"),
        ({"imu_delay.delay_s": 0.01}, "", r"imu_delay.*stamps"),
        ({"pump_wear.flow_scale": 0.5}, "left", r"effects_ankle' is 'left'; this robot's ankles are: ankle"),
    ],
)
def test_a_robot_refuses_effects_that_it_cannot_have(
    tmp_path: Path, values: dict[str, float], ankle: str, said: str
) -> None:
    """Its bodies are its own, and what acts on stamps shows in no live simulation."""
    (tmp_path / "effects.yaml").write_text(corrected_text(LIBRARY, values))
    with pytest.raises(ParameterError, match=said):
        make_robot(RobotParameters(effects_file=str(tmp_path / "effects.yaml"), effects_ankle=ankle))


def test_what_the_diagnosis_wrote_runs_live(tmp_path: Path) -> None:
    """It writes every constant it fitted; the sim node goes without those that it cannot show, and says which."""
    pump = {"pump_curve.flow_scale": 1.05, "pump_curve.vacuum_scale": 0.9}
    constants = {"lever_toe.scale": 1.05, **pump, "imu_latency.delay_s": 0.003}
    leak = {"line_leak_achilles.conductance_dm3_s_bar": 0.004}
    library = Library((*machine_constants(), *LIBRARY))
    (tmp_path / "corrected.yaml").write_text(corrected_text(library, {**constants, **leak}))

    rig = make_simulation(SimParameters(effects_file=str(tmp_path / "corrected.yaml"))).machine
    assert rig.left_out == ("imu_latency.delay_s",)
    assert rig.description()["effects"] == {"lever_toe.scale": 1.05, **pump, **leak}

    robot = make_robot(RobotParameters(effects_file=str(tmp_path / "corrected.yaml"))).machine
    assert set(robot.left_out) == {"imu_latency.delay_s", "lever_toe.scale"}
    assert robot.description()["effects"] == {"ankle": {**pump, **leak}}


def test_a_rig_goes_without_constants_of_recorded_commands(tmp_path: Path) -> None:
    """It has no recording whose commands could come late; `release_latency` would shift its readings alone."""
    late = {"command_latency.late_s": 0.01, "release_latency.late_s": 0.02}
    library = Library((*machine_constants(), *LIBRARY))
    (tmp_path / "corrected.yaml").write_text(corrected_text(library, {**late, "pump_wear.flow_scale": 0.5}))
    options = RIGS["landing"].options()

    def made(file: str) -> RigRun:
        return run_rig("landing", options, lambda _: None, lambda: False, load_change(tmp_path / file))

    run = made("corrected.yaml")
    assert set(run.left_out) == set(late)
    assert set(run.description["effects"]) == {"pump_wear.flow_scale", "pump_wear.vacuum_scale"}
    (tmp_path / "own.yaml").write_text(OWN_LATENESS)
    (tmp_path / "effects.yaml").write_text("library: own.yaml\nslow_bus:\n  late_s: 0.01\n")
    with pytest.raises(InputError, match=r"'slow_bus' acts on recorded commands.*command_delay"):
        made("effects.yaml")


def test_a_reset_forgets_commands_on_their_way(tmp_path: Path) -> None:
    """What was commanded before a reset never arrives after it."""
    (tmp_path / "late.yaml").write_text(corrected_text(LIBRARY, {"command_delay.delay_s": 0.1}))
    simulation = make_simulation(SimParameters(release_time_s=5.0, effects_file=str(tmp_path / "late.yaml")))
    before = simulation.ankle.channel_pressures_pa()[names.ACHILLES]
    simulation.ankle.set_pump_duty(1.0)
    simulation.ankle.set_solenoid(names.ACHILLES, energised=True)
    simulation.advance(100)
    simulation.reset()
    simulation.advance(1000)
    assert simulation.ankle.channel_pressures_pa()[names.ACHILLES] == pytest.approx(before, abs=400.0)


def test_the_sim_node_refuses_what_it_cannot_show(tmp_path: Path) -> None:
    """A late sensor is a matter of stamps, which a live simulation does not change; a missing file is named."""
    (tmp_path / "late.yaml").write_text(corrected_text(LIBRARY, {"imu_delay.delay_s": 0.01}))
    with pytest.raises(ParameterError, match=r"imu_delay.*jammkle rig"):
        make_simulation(SimParameters(effects_file=str(tmp_path / "late.yaml")))
    with pytest.raises(ParameterError, match=r"effects_file.*nowhere.yaml"):
        make_simulation(SimParameters(effects_file=str(tmp_path / "nowhere.yaml")))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("line_leek: {conductance_dm3_s_bar: 0.001}", "line_leek"),
        ("payload: {weight_kg: 0.1}", "weight_kg"),
        ("payload: {mass_kg: 100}", "must be a number from -0.8 to 3 kg"),
        ("payload: {mass_kg: much}", "must be a number"),
        ("payload: {mass_kg: .nan}", "must be a number"),
        ("payload: {mass_kg: true}", "must be a number"),
        ("payload: 3", "must have values of: mass_kg"),
        ("payload", "must hold EFFECT"),
        ("a: b: c", "not YAML"),
        ("payload: {mass_kg: 0.1}\npayload: {mass_kg: 0.2}", "'payload' stands in line 1 and again in line 2"),
        ("library: nowhere.yaml", "nowhere.yaml"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    """The message names what is wrong."""
    (tmp_path / "corrected.yaml").write_text(text)
    with pytest.raises(BadEffectError, match=said) as error:
        load_correction(tmp_path / "corrected.yaml")
    assert "\n" not in str(error.value)
