"""The command: help, bad input, a signal while it loads, and what `info` shows."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
from mcap.writer import CompressionType, Writer

from jammkle_common.command.main import main
from jammkle_common.command.options import ON_BAGS, ON_THE_BOARD, ON_THE_GAP, ON_THE_GRAPH, WITHOUT_A_ROBOT
from jammkle_common.names import normalised, relative, resolved

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

COMMANDS = (
    "up", "jam", "unjam", "call", "status", "record", "info", "recover", "export", "plot", "rig", "rig tensile",
    "demo", "gap", "gap diagnose", "gap effects",
)  # fmt: skip

LONG = "x" * 300

PARAMETERS = {
    "no_path.yaml": 'library: "a\\0b"\n',
    "typing_error.yaml": "driver:\n  ros__parameters:\n    max_vacum_pa: 1.0\n",
    "unknown_node.yaml": "/**/drvier:\n  ros__parameters:\n    max_vacuum_pa: 50000.0\n",
    "elsewhere.yaml": "/rf_ankle/driver:\n  ros__parameters:\n    max_vacuum_pa: 50000.0\n",
    "out_of_range.yaml": "/**/sim:\n  ros__parameters:\n    speed: -3.0\n",
    "text.yaml": "just text",
    "broken.yaml": "a: [",
    "twice.yaml": "/**/sim:\n  ros__parameters:\n    imu_rate_hz: 400\n    speed: 2\n    speed: 3\n",
    "list.yaml": "/**/sim:\n  ros__parameters: [1, 2]\n",
    "number.yaml": "/**/sim:\n  ros__parameters: 5\n",
    "no_divisor.yaml": "/**/sim:\n  ros__parameters:\n    imu_rate_hz: 300\n",
    "small_limit.yaml": "/**/driver:\n  ros__parameters:\n    max_vacuum_pa: 20000.0\n",
    "odd_step.yaml": "timestep_s: 0.0007\n",
    "wedge.yaml": "edge_friction: 0.8\n",
}


def test_every_verb_stands_in_a_group_of_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    """None is left over under `Commands`, which is where a verb without a group goes."""
    assert main(["--help"]) == 0
    said = capsys.readouterr().out
    for group in (ON_THE_GRAPH, ON_BAGS, ON_THE_BOARD, WITHOUT_A_ROBOT, ON_THE_GAP):
        assert f" {group} " in said
    assert " Commands " not in said


@pytest.mark.parametrize("arguments", [["--help"], [], *([*name.split(), "--help"] for name in COMMANDS)])
def test_help_exits_with_zero(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """The command and every subcommand explain themselves."""
    assert main(arguments) == 0
    assert "Usage" in capsys.readouterr().out


def test_help_loads_neither_ros_nor_the_number_crunchers() -> None:
    """`jammkle --help` is quick because it loads nothing heavy."""
    heavy = ["rclpy", "numpy", "matplotlib", "rosbags", "mujoco", "numba"]
    code = (
        "import sys; from jammkle_common.command.main import main; main(['--help']); "
        f"sys.exit(str(set(sys.modules) & set({heavy})) if set(sys.modules) & set({heavy}) else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("jam soleus", ("soleus", "peroneal_left, peroneal_right, achilles")),
        ("unjam achilles soleus", ("soleus", "achilles")),
        ("jam --vacuum-kpa nan", ("nan", "above 0")),
        ("jam --vacuum-kpa inf", ("inf",)),
        ("jam --vacuum-kpa 0", ("0", "above 0")),
        ("jam --vacuum-kpa=-5", ("-5", "above 0")),
        ("jam --vacuum-kpa much", ("--vacuum-kpa",)),
        ("status --namespace 1st", ("1st", "lf_ankle")),
        ("status --json {folder}/no/where.json", ("where.json", "no folder")),
        ("status --json {folder}", ("--json", "is a folder")),
        ("up --robot frog", ("frog", "ankle")),
        ("up --robot hexapod", ("hexapod", "quadruped")),
        ("up -p sim:behaviour:=walk", ("behaviour", "known are")),
        ("up --robot leg --monitor", ("--monitor", "ankle")),
        ("up --hardware serial", ("serial", "modbus", "sim")),
        ("up --hardware modbus --speed 2", ("--speed", "sim")),
        ("up --port /dev/ttyUSB0", ("--port", "modbus")),
        ("up --port /dev/ttyUSB0 --hardware fake", ("--port", "fake has none")),
        ("up --speed -1", ("-1", "0 to 100")),
        ("up --speed nan", ("nan",)),
        ("up --record {folder}", ("{folder}", "exists")),
        ("up --params {folder}/none.yaml", ("none.yaml", "No such file")),
        ("up --params {folder}/typing_error.yaml", ("typing_error.yaml", "max_vacum_pa", "max_vacuum_pa")),
        ("up --params {folder}/unknown_node.yaml", ("drvier", "driver")),
        ("up --params {folder}/elsewhere.yaml --namespace lf_ankle", ("/lf_ankle", "/rf_ankle/driver")),
        ("up --params {folder}/out_of_range.yaml", ("speed", "-3", "0 to 100")),
        ("up --params {folder}/text.yaml", ("text.yaml", "ros__parameters")),
        ("up --params {folder}/broken.yaml", ("broken.yaml", "not YAML")),
        ("up --params {folder}/twice.yaml", ("twice.yaml", "'speed' stands in line 4 and again in line 5")),
        ("up --params {folder}/list.yaml", ("list.yaml", "ros__parameters", "[1, 2]")),
        ("up --params {folder}/number.yaml", ("number.yaml", "ros__parameters", "5")),
        ("up --params {folder}/no_divisor.yaml", ("no_divisor.yaml", "sim", "300 Hz", "250 or 400 Hz")),
        ("up --params {folder}/small_limit.yaml", ("small_limit.yaml", "driver", "default_vacuum_pa")),
        (f"up --namespace {LONG}", ("301", "200")),
        (f"up --record {{folder}}/{LONG}", ("too long",)),
        (f"record -o {{folder}}/{LONG}", ("too long",)),
        (f"info {{folder}}/{LONG}", ("too long",)),
        (f"status --json {{folder}}/{LONG}/x", ("--json", "too long")),
        ("record -o {folder}", ("{folder}", "exists")),
        ("record -o {folder}/bag --clock sundial", ("sundial", "auto, sim, system")),
        ("record", ("--output",)),
        ("info {folder}/none", ("none", "does not exist")),
        ("info {folder}", ("{folder}", "metadata.yaml")),
        ("info {folder}/broken_bag", ("broken_bag", "cannot be read")),
        ("info {folder}/text.yaml", ("text.yaml", "cannot be read")),
        ("recover {folder}/none", ("none", "does not exist")),
        ("recover {folder}", ("{folder}", "not a bag")),
        ("export {folder}/none -o {folder}/out", ("none", "does not exist")),
        ("export {folder}/none -o {folder}", ("{folder}", "exists")),
        ("export {folder}/none -o {folder}/out --csv --parquet", ("--csv", "--parquet", "one of them")),
        ("export {folder}/none -o {folder}/out --rate-hz 0", ("--rate-hz 0", "1e-06 to 10000 Hz")),
        ("export {folder}/none -o {folder}/out --rate-hz 1e-308", ("--rate-hz 1e-308", "1e-06 to 10000 Hz")),
        ("plot {folder}/none -o {folder}/out", ("none", "does not exist")),
        ("rig sled -o {folder}/bag", ("sled",)),
        ("rig tensile", ("--output", "--save-mjcf")),
        ("rig tensile -o {folder}", ("{folder}", "exists")),
        ("rig tensile -o {folder}/text.yaml/bag", ("{folder}/text.yaml/bag cannot be made", "is no folder")),
        ("rig tensile -o {folder}/bag --material a50", ("--material", "a50", "multi, a30, a85")),
        ("rig tensile -o {folder}/bag --vacuum-kpa 1e3", ("--vacuum-kpa is 1000", "0 to 75 kPa")),
        ("rig tensile -o {folder}/bag --vacuum-kpa nan", ("--vacuum-kpa", "nan")),
        ("rig tensile -o {folder}/bag --vacuum-kpa much", ("--vacuum-kpa",)),
        ("rig tensile -o {folder}/bag --vacuum-pa 50000", ("--vacuum-pa is --vacuum-kpa now", "50 for 50000 Pa")),
        ("rig tensile -o {folder}/bag --extension-m=0.01", ("--extension-m is --extension-mm now", "20 for 0.02 m")),
        ("jam --vacuum-pa 50000", ("--vacuum-pa is --vacuum-kpa now",)),
        ("hardware check --port /dev/null --output x.yaml", ("--output is --save-board-file now",)),
        ("rig tensile -o {folder}/bag --vacuum-kpa 50 --membrane no", ("--vacuum-kpa is 50;", "membrane")),
        ("rig tensile -o {folder}/bag --foot jammed", ("--foot",)),
        ("rig tensile -o {folder}/bag --repeats 0", ("--repeats", "0", "1 to 1000")),
        ("rig tensile -o {folder}/bag --seed -1", ("--seed", "-1")),
        (
            "rig tensile -o {folder}/bag --params {folder}/odd_step.yaml",
            ("odd_step.yaml: timestep_s", "0.0007", "divide"),
        ),
        ("rig tensile -o {folder}/bag --json {folder}/no/where.json", ("where.json", "no folder")),
        ("rig drop -o {folder}/bag --foot clown", ("--foot", "clown", "squash_ball")),
        ("rig drop --save-mjcf {folder}/no/drop.xml", ("--save-mjcf", "drop.xml", "no folder")),
        (
            "rig slip -o {folder}/bag --foot rigid_ankle --params {folder}/wedge.yaml",
            ("wedge.yaml: edge_friction is 0.8", "wedges", "give edge_friction of 0.31"),
        ),
        ("rig slip -o {folder}/bag --namespace 1st", ("1st", "lf_ankle")),
        ("rig drop -o {folder}/bag --effects {folder}/no_path.yaml", ("no_path.yaml", "embedded null byte")),
        ("hardware check --port tcp://[::1", ("tcp://[::1", "tcp://HOST:PORT")),
        ("exercise cycle -o {folder}/text.yaml/out", ("folder {folder}/text.yaml", "cannot be made")),
        ("gap session {folder}/text.yaml", ("folder {folder}/text.yaml", "cannot be made")),
        ("dance", ("dance",)),
        ("jam --fast", ("--fast",)),
    ],
)
def test_bad_input_gets_one_line_and_two(
    arguments: str,
    words: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Exit code 2, one line on stderr that names the value and what would be right, and nothing was started."""
    (tmp_path / "broken_bag").mkdir()
    (tmp_path / "broken_bag" / "metadata.yaml").write_text("no: bag\n")
    for name, text in PARAMETERS.items():
        (tmp_path / name).write_text(text)
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.setattr("subprocess.Popen", lambda *_, **__: pytest.fail("a process was started"))
    code = main([part.format(folder=tmp_path) for part in arguments.split()])
    captured = capsys.readouterr()
    assert code == 2, captured.err
    assert len(captured.err.strip().splitlines()) == 1, captured.err
    assert captured.out == ""
    for word in words:
        assert word.format(folder=tmp_path) in captured.err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(("target", "code"), [("> /dev/full", 1), (">&-", 0), ("2>&-", 0)])
def test_a_stream_that_takes_nothing_is_no_traceback(target: str, code: int) -> None:
    """A full disk behind stdout is one line; a stream that the shell has closed is written to by nobody."""
    command = f'"{sys.executable}" -m jammkle_common.command --version {target}'
    done = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == code
    lines = done.stderr.splitlines()
    assert lines == [] if code == 0 else ["No space left on device" in line for line in lines] == [True]


def test_a_client_without_a_graph_says_so(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1 and one line with namespace, domain and the way out."""
    monkeypatch.setattr("jammkle_bringup.graph_client.ANSWER_TIMEOUT_S", 0.3)
    assert main(["status", "--namespace", "lf_ankle"]) == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    for word in ("/lf_ankle", f"domain {ros_domain}", "jammkle up"):
        assert word in line


def test_info_tells_what_is_in_a_bag(
    bag_maker: Callable[[str], Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Topics, types, counts, rates and duration are those that were written."""
    maker = bag_maker("bag")
    for step in range(11):
        maker.write("/fast", 5.0 + step * 0.1, maker.make("std_msgs/msg/Float32", 0.5))
    maker.write("/once", 5.0, maker.make("std_msgs/msg/String", "hello"))
    path = maker.close()
    assert main(["info", str(path), "--json", str(tmp_path / "info.json")]) == 0
    assert "/fast" in capsys.readouterr().out
    found = json.loads((tmp_path / "info.json").read_text())
    assert (found["messages"], found["start_s"]) == (12, 5.0)
    assert found["duration_s"] == pytest.approx(1.0)
    fast, once = found["topics"]
    assert (fast["name"], fast["message_type"], fast["count"]) == ("/fast", "std_msgs/msg/Float32", 11)
    assert (fast["rate_hz"], fast["rate_by"]) == (pytest.approx(10.0), "log")
    assert (once["name"], once["count"], once["rate_hz"]) == ("/once", 1, None)


def test_info_tells_rates_by_the_clock_that_the_data_have(
    bag_maker: Callable[[str], Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a simulation at four times real time, logged by the clock of the machine: its own 100 Hz, not 400."""
    maker = bag_maker("bag")
    wall_s, speed = 1.7e9, 4.0
    for step in range(101):
        own_s = 1.0 + step * 0.01
        log_s = wall_s + step * 0.01 / speed
        maker.write("/clock", log_s, maker.clock(own_s))
        maker.write("/pressure", log_s, maker.pressure(own_s, 1e5))
        maker.write("/duty", log_s, maker.make("std_msgs/msg/Float32", 0.5))
    path = maker.close()
    assert main(["info", str(path), "--json", str(tmp_path / "info.json")]) == 0
    assert "its data span 1.000 s by their own clock" in " ".join(capsys.readouterr().out.split())
    found = json.loads((tmp_path / "info.json").read_text())
    assert {each["name"]: (round(each["rate_hz"], 6), each["rate_by"]) for each in found["topics"]} == {
        "/clock": (100.0, "stamp"),
        "/pressure": (100.0, "stamp"),
        "/duty": (100.0, "/clock"),
    }


def test_info_of_an_empty_bag_is_no_error(bag_maker: Callable[[str], Any]) -> None:
    """A bag without messages can be looked at."""
    assert main(["info", str(bag_maker("empty").close())]) == 0


def test_a_truncated_bag_gets_one_line(bag_maker: Callable[[str], Any], capsys: pytest.CaptureFixture[str]) -> None:
    """A bag whose file lost its end is reported in one line, wherever the cut is."""
    maker = bag_maker("bag")
    for step in range(50):
        maker.write("/fast", step * 0.1, maker.make("std_msgs/msg/Float32", 0.5))
    path = maker.close()
    file = path / "bag.mcap"
    whole = file.read_bytes()
    for length in (0, 5, 100, len(whole) // 2, len(whole) - 5):
        file.write_bytes(whole[:length])
        assert main(["info", str(path)]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_a_damaged_chunk_gets_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One bit that flipped inside a chunk with a checksum is noticed, though index and lengths are as they were."""
    file = tmp_path / "bag.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, chunk_size=2000)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Float32", "ros2msg", b"float32 data\n")
        channel = writer.register_channel("/fast", "cdr", schema, {"offered_qos_profiles": ""})
        for step in range(200):
            writer.add_message(channel, step * 10**7, b"\0\1\0\0MARK", step * 10**7)
        writer.finish()
    assert main(["info", str(file)]) == 0
    capsys.readouterr()
    whole = bytearray(file.read_bytes())
    whole[whole.index(b"MARK", len(whole) // 2)] ^= 1
    file.write_bytes(whole)
    assert main(["info", str(file)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"bag {file} is damaged after " in line
    assert "checksum" in line


@pytest.mark.parametrize(
    ("given", "expected"), [("", "/"), ("/", "/"), ("lf_ankle", "/lf_ankle"), ("/robot//lf/", "/robot/lf")]
)
def test_namespaces_are_normalised(given: str, expected: str) -> None:
    """However a namespace is written, names resolve into it and back."""
    namespace = normalised(given)
    assert namespace == expected
    assert relative(namespace, resolved(namespace, "imu/data")) == "imu/data"
    assert resolved(namespace, "/clock") == "/clock"


SIGNAL_WHILE_LOADING = """
import os, sys
from jammkle_common.command.__main__ import main

class Interrupter:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[-1]:
            os.kill(os.getpid(), int(sys.argv[-2]))

sys.meta_path.insert(0, Interrupter())
main()
"""


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("module", ["typer", "jammkle_common.command.main"])
@pytest.mark.parametrize(("subcommand", "code"), [("up", 0), ("record", 0), ("jam", 130), ("info", 130)])
def test_a_signal_while_loading_ends_well(subcommand: str, code: int, module: str, number: signal.Signals) -> None:
    """`up` and `record` run until a signal anyway and exit with 0, the others with 130; one line at most."""
    command = [sys.executable, "-c", SIGNAL_WHILE_LOADING, subcommand, str(int(number)), module]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == code, result.stderr
    assert result.stderr.splitlines() == ["jammkle: interrupted"]
    assert result.stdout == ""


def test_the_entry_point_loads_nothing_before_its_handlers() -> None:
    """Importing it leaves out the command, its argument parser and ROS."""
    code = (
        "import sys, jammkle_common.command.__main__; "
        "sys.exit(bool(set(sys.modules) & {'typer', 'rclpy', 'jammkle_common.command.main'}))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
