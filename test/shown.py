"""What README and pages show: blocks of code, and what becomes of each line of a shell block when the examples run."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from readme_tables import ROOT, pages

if TYPE_CHECKING:
    from pathlib import Path

DOCUMENTS = [*pages(), ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]

SOURCED = "needs a sourced ROS 2; tried by hand, as the page says"
_FIRST_SESSION = "test/test_graph_life.py::test_the_first_session"
_LANDING = "test/test_landing.py::test_the_foot_touches_down_after_a_free_fall"
_BOARD = "test/test_board_graph.py::test_the_whole_graph_runs_on_the_board"
_CHECK = "test/test_board_check.py::test_a_healthy_board_passes_twice"
_BOARDS = "test/test_several_boards.py::test_each_ankle_has_its_own_board"
_QUADRUPED = "test/test_robot_graph.py::test_a_quadruped_stands_jams_and_is_recorded"
_LEG = "test/test_robot_graph.py::test_a_leg_that_walks_tells_its_gait_and_is_jammed_ahead"
_DIAGNOSIS = "jammkle_gap/test/test_diagnose_command.py::test_a_leak_is_named_sized_and_placed"
_STACK = "test/test_integration.py::test_a_stack_around_one_ankle"
_REMAPPED_IMU = "test/test_integration.py::test_the_controller_hears_an_imu_of_another_name"
_REMAPPED_CHANNEL = "test/test_integration.py::test_topics_of_a_channel_can_have_other_names"
_LOAD = "test/test_integration.py::test_the_load_on_a_foot_is_estimated"
_FOXGLOVE = "test/test_foxglove.py::test_the_app_gets_the_topics_it_looks_at"

ELSEWHERE: dict[str, str] = {
    r'export PATH="\$PWD/.venv/bin|until grep|sleep 3|kill -INT|jammkle up > up.log': _FIRST_SESSION,
    r"jammkle (status|unjam|jam --vacuum-kpa 45)$": _FIRST_SESSION,
    r"(\.venv/bin/)?jammkle demo": _LANDING,
    r"jammkle call": "test/test_graph_requests.py",
    r"jammkle record -o runs/(my_bag|quadruped)$": "jammkle_bringup/test/test_bringup_recorder.py",
    r"jammkle recover": "jammkle_bringup/test/test_bringup_recovery.py",
    r"jammkle gap diagnose runs/(leaking|leg)": _DIAGNOSIS,
    r"jammkle up --robot leg -p sim:behaviour:=hang|jammkle exercise|jammkle gap session": "test/test_exercises.py",
    r"jammkle gap diagnose --model": "jammkle_gap/test/test_mujoco_diagnosis.py",
    r"jammkle hardware check": _CHECK,
    r"(.*--hardware modbus --port|.*python test/board_bench.py)": _BOARD,
    r"python -m jammkle_driver .*modbus": _BOARD,
    r"jammkle up --robot quadruped --hardware modbus": _BOARDS,
    r"jammkle jam achilles --namespace lf_ankle$": _BOARDS,
    r"jammkle up --robot quadruped$": _QUADRUPED,
    r"jammkle up --robot leg -p sim:behaviour:=walk$": _LEG,
    r"python -m jammkle_driver .*valves/two": _REMAPPED_CHANNEL,
    r"python -m jammkle_driver .*autostart": _STACK,
    r"python -m jammkle_controller .*trunk/imu": _REMAPPED_IMU,
    r"python docs/examples/mission.py": _STACK,
    r"python docs/examples/foot_contact.py": _REMAPPED_IMU,
    r"python docs/examples/foot_load.py": _LOAD,
    r"python -m jammkle_bringup.robot_names": "test/test_robot_names.py",
    r"python -m jammkle_driver .*fake_faults": "jammkle_driver/test/test_driver_faults_reported.py",
    r"python -m jammkle_bringup.composed": "test/test_composed.py",
    r"jammkle up --foxglove|python -m jammkle_view.foxglove": _FOXGLOVE,
}
"""Lines of a shell block, as a pattern from their beginning, that another test runs."""

NOT_HERE: dict[str, str] = {
    r"ros2 |rviz2 |CONTROLLERS=": SOURCED,
    r"python3 -m venv|pip install mujoco|python -m colcon": SOURCED,
    r"python docs/examples/gpio_bridge.py": "needs messages of ros2_control; test_integration.py gives it such",
    r"pip install": "make try-wheels does, in clean environments",
    r"\.venv/bin/python -m pytest": "the tests themselves",
    r"git push": "publishes",
    r"make ": "a target of the Makefile: test and docs are CI, the others take long or need tools",
}
"""Lines that no test runs, and why."""

UNTIL_CTRL_C = r"jammkle (up|view) "
"""What goes on until it is asked to stop, beside the lines below it; the next such line takes its place."""

SHORTER: dict[str, str] = {
    "--duration-s 10": "--duration-s 1",
    "--repeats 5": "--repeats 2",
}
"""What would take minutes, and what is tried in its place."""


@dataclass(frozen=True)
class Block:
    """A block of code on a page.

    Attributes:
        page: File name of the page.
        language: As the page says.
        text: What is in it.

    """

    page: str
    language: str
    text: str

    @property
    def lines(self) -> tuple[str, ...]:
        """Lines of a shell block as a shell takes them, without comments."""
        whole = self.text.replace("\\\n", " ").splitlines()
        cut = (re.sub(r"\s+", " ", re.sub(r"(^|\s)#.*", "", line)).strip() for line in whole)
        return tuple(line for line in cut if line)


def blocks_of(path: Path) -> tuple[Block, ...]:
    """Return the blocks of a document, in order."""
    found = re.findall(r"^```(\w+)\n(.*?)^```", path.read_text(), re.DOTALL | re.MULTILINE)
    return tuple(Block(path.name, language, text) for language, text in found)


def blocks(language: str) -> tuple[Block, ...]:
    """Return the blocks of a language in all documents."""
    return tuple(block for path in DOCUMENTS for block in blocks_of(path) if block.language == language)


def reason(line: str) -> str:
    """Return which test runs a line, or why none does; empty where it is to be run as it stands."""
    for patterns in (NOT_HERE, ELSEWHERE):
        for pattern, why in patterns.items():
            if re.match(pattern, line):
                return why
    return ""


def shorter(line: str) -> str:
    """Return a line as it is tried."""
    for long, short in SHORTER.items():
        line = line.replace(long, short)
    return line
