"""Every example that README and pages show runs: shell, Python and parameter files, in order, page by page."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from shown import DOCUMENTS, ELSEWHERE, NOT_HERE, SHORTER, UNTIL_CTRL_C, Block, blocks, blocks_of, reason, shorter

from browser import wait_until
from graph import TIMEOUT_S, environment
from jammkle_bringup.core.node_table import Robot, check_parameter_files, nodes_for, robot_names_for
from jammkle_common.command.main import main
from readme_tables import EXAMPLES, ROOT

ROBOT_OF_SOMEBODY = """
<mujoco>
  <option timestep="0.0005"/>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body name="left_shank" pos="0 0 0.5">
      <joint name="hip" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="1"/>
    </body>
  </worldbody>
  <actuator><position joint="hip" kp="50"/></actuator>
</mujoco>
"""
LEAK = "line_leak_achilles: {conductance_dm3_s_bar: 0.003}\n"
READY = {"up": "jammkle: up", "view": "http://localhost"}


def runs(block: Block) -> bool:
    """Whether something of a block is run here."""
    if block.language == "bash":
        return any(not reason(line) for line in block.lines)
    return block.language == "python" and not any(block.text in path.read_text() for path in EXAMPLES.glob("*.py"))


@pytest.fixture(scope="module")
def landing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a landing, for pages that begin with a bag."""
    bag = tmp_path_factory.mktemp("landing") / "my_bag"
    assert main(["rig", "landing", "--jam", "before", "-o", str(bag)]) == 0
    return bag


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return an empty folder that has what a clone has: the environment and the examples."""
    place = tmp_path / "clone"
    (place / "docs").mkdir(parents=True)
    (place / ".venv").symlink_to(Path(sys.prefix))
    (place / "docs" / "examples").symlink_to(EXAMPLES)
    return place


def prepare(page: str, folder: Path, landing: Path) -> None:
    """Make what a page takes for granted: a bag, a table, a robot of somebody's, a diagnosis."""
    if page in {"controller.md", "start.md", "view.md"}:
        shutil.copytree(landing, folder / "runs" / "my_bag")
    if page in {"diagnose.md", "view.md"}:
        (folder / "runs" / "gap").mkdir(parents=True)
        (folder / "runs" / "gap" / "corrected.yaml").write_text(LEAK)
    if page == "controller.md":
        times_s = np.arange(0.0, 3.0, 0.002)
        force_g, rate_deg_s = np.tile([0.0, 0.0, 1.0], (times_s.size, 1)), np.zeros((times_s.size, 3))
        noise = np.random.default_rng(1).normal(0.0, 0.01, (times_s.size, 6))
        table = np.column_stack([times_s, np.hstack([force_g, rate_deg_s]) + noise])
        np.savetxt(folder / "walk.csv", table, delimiter=",")
    if page == "robots.md":
        (folder / "robot.xml").write_text(ROBOT_OF_SOMEBODY)
    if page == "bags.md":
        foreign_bag(folder / "runs" / "theirs")
    if page == "integration.md":
        names = next(block for block in blocks("yaml") if "robot_names" in block.text)
        (folder / "names.yaml").write_text(names.text)


def foreign_bag(path: Path) -> None:
    """Record joints and a pressure under names of a robot's own."""
    store = get_typestore(Stores.ROS2_JAZZY)
    make, none = store.types, np.array([])
    path.parent.mkdir(parents=True)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = {"/joint_states": "sensor_msgs/msg/JointState", "/valves/two/pressure": "sensor_msgs/msg/FluidPressure"}
        topics = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
        for step in range(10):
            header = make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](step, 0), "")
            angles = np.array([0.1, 0.2])
            joints = make[kinds["/joint_states"]](header, ["lf_foot_pitch", "lf_foot_roll"], angles, none, none)
            pressure = make[kinds["/valves/two/pressure"]](header, 101325.0, 0.0)
            for topic, message in (("/joint_states", joints), ("/valves/two/pressure", pressure)):
                writer.write(topics[topic], step * 10**9, store.serialize_cdr(message, kinds[topic]))


class Shell:
    """Runs lines of shell in a folder; what goes on until Ctrl-C goes on beside them."""

    def __init__(self, folder: Path, domain_id: int) -> None:
        self._folder = folder
        self._beside: subprocess.Popen[bytes] | None = None
        self._log = folder / "log.txt"
        path = f"{folder / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
        self._environment = {**environment(domain_id), "PATH": path, "XDG_CACHE_HOME": str(folder / "cache")}

    def run(self, line: str) -> None:
        """Run a line to its end, or until it is ready where it goes on."""
        if re.match(UNTIL_CTRL_C, line):
            self._begin(line)
            return
        done = subprocess.run(
            ["/usr/bin/env", "bash", "-c", line],
            cwd=self._folder,
            env=self._environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"

    def _begin(self, line: str) -> None:
        self.end()
        with self._log.open("wb") as said:
            command = ["/usr/bin/env", "bash", "-c", f"exec {line}"]
            process = subprocess.Popen(command, cwd=self._folder, env=self._environment, stdout=said, stderr=said)
        self._beside, ready = process, READY[line.split()[1]]
        wait_until(lambda: ready in self._log.read_text() or process.poll() is not None, line, self._log.read_text)
        assert process.poll() is None, f"{line}\n{self._log.read_text()}"

    def end(self) -> None:
        """Press Ctrl-C in what still goes on; it ends in order."""
        if self._beside is not None:
            process, self._beside = self._beside, None
            process.send_signal(signal.SIGINT)
            assert process.wait(TIMEOUT_S) == 0, self._log.read_text()

    def kill(self) -> None:
        """End what a failed test has left."""
        if self._beside is not None:
            self._beside.kill()
            self._beside.wait()


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [path for path in DOCUMENTS if any(map(runs, blocks_of(path)))],
    ids=lambda path: path.name,
)
def test_the_examples_of_a_page_run(
    path: Path, folder: Path, landing: Path, domain_id: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As they stand, one after the other, in a new clone; what is long is tried shorter."""
    prepare(path.name, folder, landing)
    monkeypatch.chdir(folder)
    shell = Shell(folder, domain_id)
    try:
        for block in filter(runs, blocks_of(path)):
            if block.language == "python":
                exec(compile(block.text, f"{path.name}, Python", "exec"), {})  # noqa: S102 - our own pages
                continue
            for line in block.lines:
                if not reason(line):
                    shell.run(shorter(line).replace("8090", str(free_port())))
            shell.end()
    finally:
        shell.kill()


def free_port() -> int:
    """Return a TCP port that nobody listens on."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


@pytest.mark.parametrize("block", blocks("yaml"), ids=lambda block: f"{block.page} {block.text.split(':')[0]}")
def test_parameters_that_are_shown_are_accepted(block: Block, tmp_path: Path) -> None:
    """A YAML block with parameters is a file that `jammkle up` takes."""
    known = yaml.safe_load(block.text)
    if not any("ros__parameters" in section for section in known.values()):
        pytest.skip("not of our nodes")
    file = tmp_path / "shown.yaml"
    file.write_text(block.text)
    check_parameter_files(
        [file], "/", (*nodes_for("modbus", Robot.QUADRUPED), *robot_names_for(Robot.QUADRUPED, [file], "/"))
    )


@pytest.mark.parametrize("table", [ELSEWHERE, NOT_HERE, SHORTER], ids=["elsewhere", "not here", "shorter"])
def test_what_is_left_out_is_still_shown(table: dict[str, str]) -> None:
    """Nothing stands in these tables that no page shows any more."""
    lines = [line for block in blocks("bash") for line in block.lines]
    for pattern in table:
        assert any(re.match(pattern, line) or (table is SHORTER and pattern in line) for line in lines), pattern


@pytest.mark.parametrize("name", sorted(set(ELSEWHERE.values())))
def test_a_test_that_runs_an_example_exists(name: str) -> None:
    file, _, function = name.partition("::")
    assert f"def {function or 'test_'}" in (ROOT / file).read_text()
