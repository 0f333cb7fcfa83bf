"""`jammkle rig`: bags that a stranger's reader understands, by the conventions of a recording."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader

from jammkle_common.command.errors import InputError
from jammkle_common.command.main import main
from jammkle_common.names import CHANNELS, PRESSURES, SOLENOIDS, TOPICS
from jammkle_common.parameters import option_name, rows, typed_row
from jammkle_sim.commands.rig import run_repeats
from jammkle_sim.commands.table import options_in
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.robots.options import RobotRunOptions

if TYPE_CHECKING:
    from pathlib import Path

SHORT_PULL = ("rig", "tensile", "--vacuum-kpa", "50", "--extension-mm", "10", "--speed-mm-s", "50")
LIFT_M = 0.05


def test_effects_are_put_into_the_rig_or_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With --effects the bag is of a rig that has them, and says so; a value out of bounds is one line and exit 2."""
    effects, bag = tmp_path / "effects.yaml", tmp_path / "bag"
    effects.write_text("tendon_stiffness: {scale: 2.0}\n")
    assert main([*SHORT_PULL, "--effects", str(effects), "-o", str(bag), "--json", str(tmp_path / "with.json")]) == 0
    assert main([*SHORT_PULL, "-o", str(tmp_path / "plain"), "--json", str(tmp_path / "without.json")]) == 0
    peaks = [
        json.loads((tmp_path / f"{name}.json").read_text())["runs"][0]["results"]["peak_force_n"]
        for name in ("with", "without")
    ]
    assert peaks[0] > 1.3 * peaks[1]
    metadata = yaml.safe_load((bag / "metadata.yaml").read_text())
    said = metadata["rosbag2_bagfile_information"]["custom_data"].values()
    assert any("tendon_stiffness.scale: 2.0" in text for text in said)
    capsys.readouterr()
    effects.write_text("tendon_stiffness: {scale: 20.0}\n")
    assert main([*SHORT_PULL, "--effects", str(effects), "-o", str(tmp_path / "other")]) == 2
    assert "must be a number from 0.4 to 2.5" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


class Bag:
    """Everything in a bag, by topic, read by the bag library with the definitions inside the bag alone."""

    def __init__(self, path: Path) -> None:
        self.messages: dict[str, list[Any]] = {}
        self.times_ns: dict[str, list[int]] = {}
        self.types: dict[str, str] = {}
        self.data: dict[str, list[bytes]] = {}
        self.order: list[tuple[int, str]] = []
        with AnyReader([path]) as reader:
            for connection, time_ns, data in reader.messages():
                self.types[connection.topic] = connection.msgtype
                self.messages.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
                self.data.setdefault(connection.topic, []).append(bytes(data))
                self.times_ns.setdefault(connection.topic, []).append(time_ns)
                self.order.append((time_ns, connection.topic))

    def position(self, joint: str) -> np.ndarray:
        """Return a joint's positions."""
        return np.array([each.position[each.name.index(joint)] for each in self.messages["/joint_states"]])

    def pull_n(self) -> np.ndarray:
        """Return what the load cell read along z."""
        return np.array([each.wrench.force.z for each in self.messages["/load_cell/wrench"]])


def stamp_ns(message: Any) -> int:
    """Return the time in a message's header."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


@pytest.fixture(scope="module")
def pull(tmp_path_factory: pytest.TempPathFactory) -> Bag:
    """Make the bag of a short pull."""
    path = tmp_path_factory.mktemp("pull") / "bag"
    assert main([*SHORT_PULL, "-o", str(path)]) == 0
    return Bag(path)


def test_a_rig_bag_has_the_topics_and_types_of_a_recording(pull: Bag) -> None:
    """Every topic is one of the graph's, with its type; sensors, commands, parameters, /clock are there."""
    known = {f"/{topic.name.lstrip('/')}": topic.message_type for topic in TOPICS}
    assert pull.types.items() <= known.items()
    wanted = {"/joint_states", "/tendon_states", "/load_cell/wrench", "/pump/duty", "/manifold/pressure"}
    wanted |= {f"/{topic.name}" for topic in (*PRESSURES.values(), *SOLENOIDS.values())}
    assert wanted | {"/sim_parameters", "/clock", "/diagnostics"} <= set(pull.types)


def test_stamps_are_log_times_and_the_clock_ticks_after_them(pull: Bag) -> None:
    """A message is logged at its stamp; /clock never runs backwards and comes after all else of its time."""
    for topic in ("/joint_states", "/load_cell/wrench", "/achilles/pressure", "/diagnostics"):
        assert [stamp_ns(each) for each in pull.messages[topic]] == pull.times_ns[topic]
    ticks = pull.times_ns["/clock"]
    assert ticks == sorted(set(ticks))
    last = dict(pull.order)
    assert all(last[time_ns] == "/clock" for time_ns in ticks)
    assert set(ticks) == {time_ns for time_ns, _ in pull.order}


def test_a_pull_is_recorded_as_extension_and_tension(pull: Bag) -> None:
    """Tensile: `carriage` goes from 0 to the extension and back, the load cell reads tension as positive."""
    carriage_m, pull_n = pull.position("carriage"), pull.pull_n()
    assert carriage_m[0] == pytest.approx(0.0, abs=1e-4)
    assert carriage_m.max() == pytest.approx(0.01, rel=0.01)
    assert carriage_m[-1] == pytest.approx(0.0, abs=1e-4)
    assert pull_n[int(carriage_m.argmax())] > 20.0
    (tendon,) = pull.messages["/tendon_states"][int(carriage_m.argmax())].tendons
    assert tendon.name == "peroneal_left"
    assert tendon.extension_m == pytest.approx(carriage_m.max(), rel=0.01)
    assert tendon.tension_n == pytest.approx(pull_n[int(carriage_m.argmax())], abs=0.5)


def test_commands_are_recorded_as_issued(pull: Bag) -> None:
    """The jammed channel is energised and reaches its vacuum, the others stay vented, and the pump has run."""
    energised = {channel: [bool(each.data) for each in pull.messages[f"/{channel}/solenoid"]] for channel in CHANNELS}
    assert energised == {"peroneal_left": [False, True], "peroneal_right": [False], "achilles": [False]}
    least_pa = min(each.fluid_pressure for each in pull.messages["/peroneal_left/pressure"])
    assert least_pa == pytest.approx(101_325.0 - 50e3, abs=2e3)
    assert max(each.data for each in pull.messages["/pump/duty"]) > 0.5


def test_the_parameters_travel_in_the_bag(tmp_path: Path) -> None:
    """Topic and custom data tell the rig and its options; results stand in the custom data."""
    path = tmp_path / "bag"
    assert main([*SHORT_PULL, "-o", str(path)]) == 0
    assert main(["info", str(path), "--json", str(tmp_path / "info.json")]) == 0
    custom = json.loads((tmp_path / "info.json").read_text())["custom_data"]
    assert custom["sim_parameters"] == Bag(path).messages["/sim_parameters"][0].data
    assert "rig: tensile" in custom["sim_parameters"]
    assert "extension_m: 0.01" in custom["sim_parameters"]
    assert json.loads(custom["rig_results"])["peak_force_n"] > 20.0


def test_a_drop_is_recorded_as_height_and_specific_force(tmp_path: Path) -> None:
    """Drop: `carriage` is the height of the ankle, the hanging leg reads + on the cell, the IMU reads +g at rest."""
    assert main(["rig", "drop", "--foot", "unjammed", "-o", str(tmp_path / "bag"), "--namespace", "lf_ankle"]) == 0
    bag = Bag(tmp_path / "bag")
    assert "/clock" in bag.types
    bag.messages = {topic.removeprefix("/lf_ankle"): messages for topic, messages in bag.messages.items()}
    height_m, pull_n = bag.position("carriage"), bag.pull_n()
    assert height_m[0] - height_m.min() > LIFT_M
    assert height_m.min() > 0.0
    assert pull_n[10:100].mean() > 0.0
    assert pull_n.min() < -20.0
    upward = np.array([each.linear_acceleration.z for each in bag.messages["/imu/data"]])
    assert upward[:500].mean() == pytest.approx(9.81, abs=0.1)
    assert upward.max() > 30.0
    assert all(each.orientation_covariance[0] == -1.0 for each in bag.messages["/imu/data"])
    assert_covariances_are_those_of_the_noise(bag)


def assert_covariances_are_those_of_the_noise(bag: Bag) -> None:
    """Check the spread of IMU and pressures while the leg hangs still against what their messages say of it."""
    still = bag.messages["/imu/data"][100:900]
    for field in ("linear_acceleration", "angular_velocity"):
        said = np.array(getattr(still[0], f"{field}_covariance")).reshape(3, 3)
        seen = [[getattr(getattr(each, field), axis) for axis in "xy"] for each in still]
        assert np.var(seen, axis=0) == pytest.approx(np.diagonal(said)[:2], rel=0.35)
        assert not (said - np.diag(np.diagonal(said))).any()
    pressures = bag.messages["/achilles/pressure"][:90]
    assert np.var([each.fluid_pressure for each in pressures]) == pytest.approx(pressures[0].variance, rel=0.5)


def test_a_torn_tendon_is_said_and_recorded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line names it, tendon_states turns to BROKEN for good, and /diagnostics to ERROR at the same time."""
    arguments = ["rig", "tensile", "--extension-mm", "60", "--speed-mm-s", "200", "-o", str(tmp_path / "bag")]
    assert main([*arguments, "--json", str(tmp_path / "rig.json")]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("broken")]
    assert "peroneal_left" in line
    assert json.loads((tmp_path / "rig.json").read_text())["runs"][0]["broken"] == ["peroneal_left"]
    bag = Bag(tmp_path / "bag")
    broken = [each.tendons[0].condition == each.tendons[0].BROKEN for each in bag.messages["/tendon_states"]]
    first = broken.index(True)
    assert all(broken[first:])
    assert bag.messages["/tendon_states"][first].tendons[0].extension_m == pytest.approx(0.055, abs=5e-4)
    levels = {stamp_ns(each): (each.status[0].level, each.status[0].message) for each in bag.messages["/diagnostics"]}
    torn_ns = bag.times_ns["/tendon_states"][first]
    assert {time_ns: level for time_ns, (level, _) in levels.items()} == {
        time_ns: 2 if time_ns >= torn_ns else 0 for time_ns in levels
    }
    assert "peroneal_left" in levels[torn_ns][1]


def test_a_sensor_at_the_end_of_its_range_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A stiff tendon pulled beyond 245 N and a hard landing say which sensor clipped; a soft landing says nothing."""
    pull = ("tensile", "--material", "a85", "--extension-mm", "50", "--speed-mm-s", "1000", "--vacuum-kpa", "75")
    said = {}
    for name, options in (
        ("pull", pull),
        ("hard", ("drop", "--foot", "standard")),
        ("soft", ("drop", "--foot", "unjammed")),
    ):
        assert main(["rig", *options, "-o", str(tmp_path / name), "--json", str(tmp_path / f"{name}.json")]) == 0
        (run,) = json.loads((tmp_path / f"{name}.json").read_text())["runs"]
        said[name] = run["clipped"]
        lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("clipped")]
        assert bool(lines) == bool(said[name])
    assert said["pull"] == ["force_z_n of the load cell at 245 N"]
    assert said["hard"] == ["force_z_n of the load cell at 245 N", "the IMU at 80.83 m/s^2 with gravity"]
    assert said["soft"] == []


def test_help_says_what_a_saved_model_lacks(capsys: pytest.CaptureFixture[str]) -> None:
    """The help of --save-mjcf says that tendon law, air and the release of the carriage are not in the file."""
    assert main(["rig", "drop", "--help"]) == 0
    words = re.sub(r"[\s│|]+", " ", capsys.readouterr().out)
    assert "without the law of the tendons, the air, or the release and drive of the carriage" in words


def test_a_ball_pressed_flat_is_told_in_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run that its foot cannot bear ends with exit code 1 and one line whose way out is written as options."""
    arguments = ["rig", "drop", "--foot", "squash_ball", "--mass-kg", "20", "--drop-height-mm", "500"]
    assert main([*arguments, "-o", str(tmp_path / "bag")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "limit is 28.9 mm; give --mass-kg of 0.79 or less (it is 20)" in line


def test_repeats_differ_and_seeds_repeat(tmp_path: Path) -> None:
    """Repeats go into bags of their own and differ; the same seed gives the same messages to the byte."""
    for name in ("first", "second"):
        assert main([*SHORT_PULL, "--repeats", "2", "--seed", "7", "-o", str(tmp_path / name)]) == 0
    first, other, again = (Bag(tmp_path / name) for name in ("first_0", "first_1", "second_0"))
    assert first.data == again.data
    assert first.data["/load_cell/wrench"] != other.data["/load_cell/wrench"]
    assert not (tmp_path / "first").exists()


def test_a_bag_that_can_not_be_made_is_refused_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file in place of a folder, and a folder without permission: a run of minutes would be lost for it."""
    monkeypatch.setitem(run_repeats.__globals__, "run_rig", lambda *_: pytest.fail("it was run"))
    file = tmp_path / "file"
    file.touch()
    assert main(["rig", "drop", "-o", str(file / "bag")]) == 2
    assert f"bag {file / 'bag'} cannot be made: {file} is no folder" in capsys.readouterr().err
    monkeypatch.setattr(os, "access", lambda path, _mode: path != tmp_path)  # a superuser may write anywhere
    assert main(["rig", "drop", "-o", str(tmp_path / "new" / "bag")]) == 2
    assert f"there is no permission to write into {tmp_path}" in capsys.readouterr().err


def test_the_model_is_written_for_the_viewer(tmp_path: Path) -> None:
    """--save-mjcf alone writes a model that MuJoCo loads, and no bag."""
    mujoco = pytest.importorskip("mujoco")
    assert main(["rig", "drop", "--foot", "squash_ball", "--save-mjcf", str(tmp_path / "drop.xml")]) == 0
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "drop.xml")).nbody > 1
    assert [path.name for path in tmp_path.iterdir()] == ["drop.xml"]


@pytest.mark.parametrize("rig", RIGS)
def test_every_option_of_a_rig_is_one_of_the_command(rig: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The help names each parameter of the rig's own table: there is no second list that could lack one."""
    assert main(["rig", rig, "--help"]) == 0
    text = capsys.readouterr().out
    for row in rows(RIGS[rig].options):
        in_file = f"\n {typed_row(row).name}: {typed_row(row).default} "
        assert (option_name(row.name) if row.flag else in_file) in text
        assert row.flag or option_name(row.name) not in text


@pytest.mark.parametrize("words", [*(("rig", rig) for rig in RIGS), ("robot",)])
def test_what_is_copied_from_the_help_is_a_file(
    words: tuple[str, ...], file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 80 columns: YAML that names every option without a flag, with the value that it has by default."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERMINAL_WIDTH", "80")
    assert main([*words, "--help"]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) == 80
    copied = text.partition("with defaults:")[2].partition("\n")[2]
    table = RobotRunOptions if words == ("robot",) else RIGS[words[-1]].options
    wanted = [row for row in rows(table) if not row.flag]
    assert set(yaml.safe_load(copied)) == {typed_row(row).name for row in wanted}
    file.write_text(copied)
    assert options_in(file, table, " ".join(words)) == {row.name: row.default for row in wanted}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Where a file of options goes."""
    return tmp_path / "rig.yaml"


def options_of(tmp_path: Path, *words: str) -> dict[str, Any]:
    """Options of a short run."""
    report = tmp_path / "run.json"
    assert main(["rig", *words, "-o", str(tmp_path / "bag"), "--json", str(report)]) == 0
    options: dict[str, Any] = json.loads(report.read_text())["runs"][0]["options"]
    return options


def test_a_file_sets_options_and_what_is_typed_wins(file: Path, tmp_path: Path) -> None:
    """In the units that are typed, those with a flag too; of two files the last wins, over both what is typed."""
    file.write_text("mounting_error_mm: 1.5\nextension_mm: 8\nspeed_mm_s: 5e1\nmembrane: no\n")
    other = tmp_path / "other.yaml"
    other.write_text("channel: achilles\nextension_mm: 5\nvacuum_kpa: 0\n")
    words = ("tensile", "--params", str(file), "--params", str(other), "--membrane", "yes")
    options = options_of(tmp_path, *words)
    assert options["mounting_error_m"] == 0.0015
    assert options["extension_m"] == 0.005
    assert options["speed_m_s"] == 0.05
    assert (options["membrane"], options["channel"]) == ("yes", "achilles")


def test_a_value_is_typed_even_if_it_is_the_default(file: Path, tmp_path: Path) -> None:
    """Over a file wins what was typed, whatever it is."""
    file.write_text("extension_mm: 8\n")
    assert options_of(tmp_path, "tensile", "--params", str(file), "--extension-mm", "20")["extension_m"] == 0.02


def test_a_run_is_repeated_from_its_bag_or_run_sheet(tmp_path: Path, pull: Bag, file: Path) -> None:
    """Message for message; a run sheet has SI units, and may know a part alone."""
    first, again, sheet = tmp_path / "first", tmp_path / "again", tmp_path / "sheet"
    assert main([*SHORT_PULL, "-o", str(first)]) == 0
    assert main(["rig", "tensile", "--params", str(first), "-o", str(again)]) == 0
    file.write_text("rig: tensile\noptions: {vacuum_pa: 50000, extension_m: 1e-2, speed_m_s: 0.05}\n")
    assert main(["rig", "tensile", "--params", str(file), "-o", str(sheet)]) == 0
    assert Bag(again).data == Bag(sheet).data == pull.data


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("leg_mm: 500", ": leg_mm is 500; it must be 120 to 400 mm"),
        ("leg_mm: long", ": leg_mm is 'long'; it must be a number"),
        ("seed: 1.5", ": seed is 1.5; it must be a whole number"),
        ("foot: clown", ": foot is 'clown'; it must be one of rigid_ankle, jammed, unjammed"),
        (
            "edge_fricton: 0.2",
            ": edge_fricton is 0.2; rig slip has no option of this name: 'edge_friction' is the nearest",
        ),
        ("mass_kg: 2", ": mass_kg is 2; rig slip has no option of this name: there are foot, vacuum_kpa,"),
        ("leg_m: 0.2", ": leg_m is 0.2; a file of options has the units that are typed: write 'leg_mm: 200.0'"),
        ("options: {leg_mm: 200}", ": leg_mm is 200; a run sheet has SI units: write 'leg_m: 0.2'"),
        ("options: {leg_m: 0.5}", ": leg_m is 0.5; it must be 0.12 to 0.4 m"),
        ("rig: drop", " is the run sheet of rig drop, and this is rig slip; run `jammkle rig drop --params"),
        ("robot: leg", " is the run sheet of robot leg, and this is rig slip; run `jammkle robot leg --params"),
        ("foot: rigid_ankle\nslope_deg: 25", ": edge_friction is 0.3; the rigid foot wedges from 0.154"),
        ("[1, 2]", " holds a list, [1, 2], and no mapping; write NAME: VALUE, one a line"),
        ("seed: " + "9" * 400, ": seed is 999999999999999999...9999999999999999999; it must be 0 to 2147483647"),
        (
            "vacuum_kpa: " + "9" * 400,
            ": vacuum_kpa is 999999999999999999...9999999999999999999; it must be 5 to 75 kPa",
        ),
        (
            "vacuum_pa: " + "9" * 400,
            ": vacuum_pa is 999999999999999999...9999999999999999999; it must be 5000 to 75000",
        ),
        ("seed: 2020-99-99", ": seed is '2020-99-99'; it must be a whole number"),
        ("seed: '2'", ": seed is '2', a text; it must be a whole number"),
        ("vacuum_pa: .nan", ": vacuum_pa is nan; it must be a finite number"),
        ("vacuum_pa: [1]", ": vacuum_pa is [1]; it must be a number"),
        ("leg_m: long", ": leg_m is 'long'; it must be a number"),
        ("seed: 1\nseed: 2", ": 'seed' stands in line 1 and again in line 2; leave one of them"),
        ("rig: slip\nseed: 1", ": seed is 1, and stands beside 'options'; write it below 'options:' as seed"),
        (
            "rig: slip\nleg_mm: 200",
            ": leg_mm is 200, and stands beside 'options'; write it below 'options:' as leg_m, in m",
        ),
        ("rig: slip\ntimestep_s: 0.001", ": timestep_s is 0.001, and stands beside 'options'; write it below"),
        ("rig: slip\noption: {seed: 1}", ": option is {'seed': 1}; a run sheet has rig, robot, options, and no such"),
        (
            "rig: slip\nsede: 1",
            ": sede is 1; a run sheet has rig, robot, options, and no such name: 'seed' is the nearest",
        ),
        ("option: {seed: 1}", ": option is {'seed': 1}; rig slip has no option of this name: 'options' is the nearest"),
        ("rig: nonsense", ": rig is 'nonsense', which does not exist; there are tensile,"),
        ("rig: [1]", ": rig is '[1]', which does not exist; there are tensile,"),
        ("robot: biped", ": robot is 'biped', which does not exist; there are leg, quadruped"),
        ("a: [", " is not YAML"),
        ("\x80", " is no text; give a YAML file, or the folder of a bag"),
    ],
)
def test_a_bad_file_gets_one_line(
    text: str, line: str, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, the file, the value and the way out; nothing is written."""
    file.write_text(text, encoding="latin-1")
    assert main(["rig", "slip", "--params", str(file), "-o", str(tmp_path / "bag")]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(f"jammkle: --params {file}{line}")
    assert list(tmp_path.iterdir()) == [file]


def test_a_whole_number_may_be_written_with_a_point(file: Path) -> None:
    """2.0 and 2e0 are 2."""
    for text in ("2.0", "2e0"):
        file.write_text(f"cycles: {text}")
        found = options_in(file, RIGS["pressure"].options, "rig pressure")
        assert (found, type(found["cycles"])) == ({"cycles": 2}, int)


def test_yes_and_no_are_said_where_a_number_stands(file: Path) -> None:
    """And not that a text is wanted."""
    file.write_text("sides: 0")
    with pytest.raises(InputError, match=r"sides is 0; it must be one of yes, no \(or true, false\)$"):
        options_in(file, RIGS["press"].options, "rig press")


@pytest.mark.parametrize("rig", RIGS)
def test_what_a_bag_holds_may_be_given_as_a_file(rig: str, file: Path) -> None:
    """Rig, options, and all constants that are recorded beside them."""
    built, _ = RIGS[rig].build(RIGS[rig].options())
    file.write_text(yaml.safe_dump({**built.description(), "effects": {"friction.scale": 1.2}}))
    assert options_in(file, RIGS[rig].options, f"rig {rig}") == dataclasses.asdict(built.options)


def test_what_is_no_file_of_options_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An empty name; a file of a bag instead of its folder; a number that is typed and has no end."""
    (tmp_path / "bag_0.mcap").write_bytes(b"\x89MCAP0")
    for words, line in (
        (["--params", ""], "'--params': it is empty; give a file, or the folder of a bag (see --help)"),
        (["--params", str(tmp_path / "bag_0.mcap")], f"is a file of a bag; give its folder, {tmp_path}"),
        (["--seed", "9" * 400], "--seed is 999999999999999999...9999999999999999999; it must be 0 to 2147483647"),
    ):
        assert main(["rig", "slip", *words, "-o", str(tmp_path / "bag")]) == 2
        assert capsys.readouterr().err.endswith(f"{line}\n")


def test_a_folder_without_a_run_sheet_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, with the folder."""
    assert main(["rig", "slip", "--params", str(tmp_path), "-o", str(tmp_path / "bag")]) == 2
    assert f"--params {tmp_path}: {tmp_path} is not a bag" in capsys.readouterr().err


def test_an_option_without_a_flag_says_where_it_is_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Typed all the same, and in an error that advises it."""
    assert main(["rig", "slip", "--leg-mm", "200", "-o", str(tmp_path / "bag")]) == 2
    assert "--leg-mm 200 is no option: write 'leg_mm: 200' into a file" in capsys.readouterr().err
    words = ["rig", "slip", "--foot", "rigid_ankle", "--slope-deg", "25", "-o", str(tmp_path / "bag")]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert "give edge_friction of 0.04 or less or --slope-deg of 40 or more" in said
    assert said.endswith("(edge_friction: in a file, --params FILE)\n")
