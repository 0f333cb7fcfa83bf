"""The house: which way the imports point, and what the cores need."""

from __future__ import annotations

import ast
import graphlib
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from command_tree import long_name, options, subcommands

from jammkle_common.messages import ROS_MODULES
from jammkle_sim.rigs.catalogue import RIGS

if TYPE_CHECKING:
    from collections.abc import Iterable

ROOT = Path(__file__).parents[1]
PACKAGES = (
    "jammkle_common",
    "jammkle_driver",
    "jammkle_controller",
    "jammkle_sim",
    "jammkle_gap",
    "jammkle_view",
    "jammkle_bringup",
)
PURE = (
    "jammkle_common.bags",
    "jammkle_common.command",
    "jammkle_common.constants",
    "jammkle_common.messages",
    "jammkle_common.names",
    "jammkle_common.parameters",
    "jammkle_common.processes",
    "jammkle_driver.board",
    "jammkle_driver.core",
    "jammkle_driver.fake",
    "jammkle_controller.core",
    "jammkle_sim.physics",
    "jammkle_sim.rigs",
    "jammkle_sim.robots",
    "jammkle_sim.core",
    "jammkle_sim.commands",
    "jammkle_gap.core",
    "jammkle_gap.ankle",
    "jammkle_gap.mujoco",
    "jammkle_gap.monitor.followers",
    "jammkle_gap.monitor.twin",
    "jammkle_gap.report",
    "jammkle_view.core",
    "jammkle_view.page",
    "jammkle_view.playback",
    "jammkle_bringup.core",
)
ALLOWED = {
    "jammkle_common": {"jammkle_common", "jammkle_msgs"},
    "jammkle_driver": {"jammkle_driver", "jammkle_common", "jammkle_msgs"},
    "jammkle_controller": {"jammkle_controller", "jammkle_common", "jammkle_msgs"},
    "jammkle_sim": {"jammkle_sim", "jammkle_common", "jammkle_msgs"},
    "jammkle_sim.physics": {"jammkle_sim.physics", "jammkle_common"},
    "jammkle_sim.rigs": {"jammkle_sim.rigs", "jammkle_sim.physics", "jammkle_common"},
    "jammkle_sim.robots": {"jammkle_sim.robots", "jammkle_sim.rigs", "jammkle_sim.physics", "jammkle_common"},
    "jammkle_gap": {"jammkle_gap", "jammkle_sim", "jammkle_common", "jammkle_msgs"},
    "jammkle_gap.core": {"jammkle_gap.core"},
    "jammkle_gap.ankle": {
        "jammkle_gap.ankle",
        "jammkle_gap.core",
        "jammkle_sim.rigs",
        "jammkle_sim.physics",
        "jammkle_common",
    },
    "jammkle_gap.mujoco": {
        "jammkle_gap.mujoco",
        "jammkle_gap.core",
        "jammkle_gap.report",
        "jammkle_gap.backend",
        "jammkle_sim.physics",
        "jammkle_common",
    },
    "jammkle_view": {"jammkle_view", "jammkle_gap", "jammkle_sim", "jammkle_common", "jammkle_msgs"},
    "jammkle_view.core": {
        "jammkle_view.core",
        "jammkle_sim.rigs",
        "jammkle_sim.robots",
        "jammkle_sim.physics",
        "jammkle_common",
    },
    "jammkle_view.page": {"jammkle_view.page", "jammkle_view.core", "jammkle_view.parameters", "jammkle_common"},
    "jammkle_bringup": {
        "jammkle_bringup",
        "jammkle_view",
        "jammkle_gap",
        "jammkle_sim",
        "jammkle_driver",
        "jammkle_controller",
        "jammkle_common",
        "jammkle_msgs",
    },
}
SHARED_OPTIONS = {"--output", "--namespace", "--json"}
"""Options of many verbs, with one meaning: a page says each once."""
LARGEST_COUNT = 10
"""Most options that a verb has of its own."""
OWN = ("jammkle_sim.commands", "jammkle_bringup")
"""Verbs and pages: nobody's but their package's."""
IMPORT_PURE = f"""
import importlib, pkgutil, sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {ROS_MODULES!r}:
            raise ModuleNotFoundError(name + " is blocked", name=name)
        return None

sys.meta_path.insert(0, Blocker())
count = 0
for core in sys.argv[1:]:
    package = importlib.import_module(core)
    for module in pkgutil.walk_packages(getattr(package, "__path__", []), package.__name__ + "."):
        importlib.import_module(module.name)
        count += 1
    count += 1
print(count)
"""


def folder_of(module: str) -> Path:
    """Folder of the sources of a package named with dots."""
    top = module.split(".", maxsplit=1)[0]
    return ROOT / top / Path(*module.split("."))


def imports_of(path: Path) -> set[str]:
    """Every module of this project that a file imports, wherever in the file it does, and be it for types alone."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if is_module(name) else node.module for name in inside}
    return {name for name in found if name.startswith("jammkle_")}


def is_module(name: str) -> bool:
    """Whether a name with dots is a module of this project, and not something in one."""
    folder = folder_of(name)
    return folder.is_dir() or folder.with_suffix(".py").is_file()


def is_within(name: str, packages: Iterable[str]) -> bool:
    """Whether a module is one of some packages, or in one."""
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def name_of(path: Path) -> str:
    """Name with dots of the module in a file."""
    parts = path.relative_to(ROOT).with_suffix("").parts[1:]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@pytest.mark.parametrize("package", sorted({name.split(".")[0] for name in PURE}))
def test_cores_import_with_rclpy_and_messages_blocked(package: str) -> None:
    """The pure cores work without ROS; those of a package share a process, since each start takes seconds."""
    cores = [name for name in PURE if is_within(name, (package,))]
    result = subprocess.run(
        [sys.executable, "-c", IMPORT_PURE, *cores], capture_output=True, text=True, check=False, cwd="/"
    )
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) >= len(cores)


@pytest.mark.parametrize("module", ALLOWED)
def test_the_arrows_point_one_way(module: str) -> None:
    """Driver, controller and sim meet on topics only; physics knows nothing of rigs. A part goes by its own line."""
    parts = [name for name in ALLOWED if name.startswith(f"{module}.")]
    for path in folder_of(module).rglob("*.py"):
        if not is_within(name_of(path), parts):
            strangers = {name for name in imports_of(path) if not is_within(name, ALLOWED[module])}
            assert not strangers, f"{path.relative_to(ROOT)} imports {strangers}"


def test_the_tests_of_each_package_run_alone() -> None:
    """Every package is imported before pytest meets the folder of the same name around it."""
    code = f"import conftest, sys; print(*(set({PACKAGES}) - set(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert result.stdout.split() == []


@pytest.mark.parametrize("package", PACKAGES)
def test_no_package_reaches_into_the_verbs_or_pages_of_another(package: str) -> None:
    """Verbs are found by entry points; of the diagnosis others use what it offers, and nothing inside it."""
    for path in (ROOT / package / package).rglob("*.py"):
        others = {name for name in imports_of(path) if not is_within(name, (package,))}
        inside = {name for name in others if is_within(name, OWN) or name.startswith("jammkle_gap.")}
        assert not inside, f"{path.relative_to(ROOT)} imports {inside}"


@pytest.mark.parametrize("package", PACKAGES)
def test_no_import_goes_in_a_circle(package: str) -> None:
    """Every package can be read from one end to the other: no module needs, by way of others, itself."""
    modules = {name_of(path): path for path in folder_of(package).rglob("*.py")}
    graph = {
        name: {found for found in imports_of(path) if found in modules and found != name}
        for name, path in modules.items()
    }
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("package", PACKAGES)
def test_no_package_knows_the_studies_that_judge_it(package: str) -> None:
    """What is installed works where there is no folder `studies`."""
    for path in folder_of(package).rglob("*.py"):
        assert not re.search(r"^\s*(from|import) studies\b", path.read_text(), re.MULTILINE), path.relative_to(ROOT)


def test_studies_take_of_the_diagnosis_what_it_offers() -> None:
    """They call its public API, and nothing inside it; nor anybody's verbs or pages."""
    for path in (ROOT / "studies").rglob("*.py"):
        if "test" not in path.parts:
            inside = {name for name in imports_of(path) if is_within(name, OWN) or name.startswith("jammkle_gap.")}
            assert not inside, f"{path.relative_to(ROOT)} imports {inside}"


def test_no_name_on_the_graph_is_written_twice() -> None:
    """Topic names with a slash stand in jammkle_common.names and nowhere else in the packages' sources."""
    from jammkle_common.names import TOPICS  # noqa: PLC0415 - after the tests that block modules

    names = {topic.name for topic in TOPICS if "/" in topic.name}
    for package in PACKAGES[1:]:
        for path in (ROOT / package / package).rglob("*.py"):
            constants = {
                node.value
                for node in ast.walk(ast.parse(path.read_text()))
                if isinstance(node, ast.Constant) and isinstance(node.value, str)
            }
            assert not constants & names, f"{path.relative_to(ROOT)} writes {constants & names} itself"


@pytest.mark.parametrize("package", PACKAGES[1:4])
def test_a_node_writes_over_nothing_of_rclpy(package: str) -> None:
    """No attribute of a node hides one that rclpy's own node classes keep for themselves."""
    script = """
import rclpy
from rclpy.lifecycle import LifecycleNode

rclpy.init()
print(sorted({*vars(LifecycleNode("bare")), *dir(LifecycleNode)}))
"""
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd="/")
    taken = set(ast.literal_eval(result.stdout))
    tree = ast.parse((ROOT / package / package / "node.py").read_text())
    assigned = {
        target.attr
        for node in ast.walk(tree)
        if isinstance(node, (ast.Assign, ast.AnnAssign))
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Attribute) and isinstance(target.value, ast.Name) and target.value.id == "self"
    }
    assert not assigned & taken


def test_the_rigs_regulate_as_the_driver_does() -> None:
    """A rig that runs without the graph takes the driver's own default gains, and its word for what is vented."""
    from jammkle_driver.parameters import DriverParameters  # noqa: PLC0415 - after the tests that block modules
    from jammkle_sim.rigs import pressure, vacuum  # noqa: PLC0415 - as above

    driver = DriverParameters()
    assert driver.regulator_gain_per_pa == vacuum.GAIN_PER_PA
    assert driver.regulator_integral_time_s == vacuum.INTEGRAL_TIME_S
    assert driver.manifold_lead_pa == vacuum.MANIFOLD_LEAD_PA
    assert driver.vented_vacuum_pa == pressure.VENTED_PA


def test_the_driver_knows_the_simulated_ankle_as_it_is_built() -> None:
    """What the driver declares of air, valves and pump by default is what the simulation is made of."""
    from jammkle_driver.parameters import DriverParameters  # noqa: PLC0415 - after the tests that block modules
    from jammkle_sim.physics.pneumatics import PneumaticParameters  # noqa: PLC0415 - as above

    driver, sim = DriverParameters(), PneumaticParameters()
    dm3_s_bar = 1e-8
    assert driver.manifold_volume_m3 == sim.manifold_volume_m3
    assert driver.tendon_volume_m3 == sim.tendon_volume_m3
    assert driver.valve_conductance_m3_s_pa == pytest.approx(sim.valve_conductance_dm3_s_bar * dm3_s_bar)
    assert driver.leak_conductance_m3_s_pa == pytest.approx(sim.leak_conductance_dm3_s_bar * dm3_s_bar)
    assert driver.pump_free_flow_m3_s == pytest.approx(sim.pump_free_flow_l_min * 1e-3 / 60.0)
    assert driver.pump_ultimate_vacuum_pa == sim.pump_ultimate_vacuum_pa
    assert driver.valve_dead_time_s == sim.valve_dead_time_s


def test_the_robot_description_lets_ask_for_what_the_driver_takes() -> None:
    """The bound of a channel's command in the URDF is the driver's own default."""
    from jammkle_driver.parameters import DriverParameters  # noqa: PLC0415 - after the tests that block modules
    from jammkle_sim.robots.urdf import LARGEST_VACUUM_PA  # noqa: PLC0415 - as above

    assert DriverParameters().max_vacuum_pa == LARGEST_VACUUM_PA


def test_the_lock_file_names_all_that_it_takes() -> None:
    """It is installed as it stands, so that what it does not name is missing."""
    result = subprocess.run([sys.executable, "-m", "pip", "check"], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout


def test_a_verb_has_at_most_ten_options_of_its_own() -> None:
    """What is set more rarely stands in a file: parameters of a node, or options of a rig or robot."""
    verbs = subcommands()
    assert {"up", "detect", "gap diagnose", "robot", *(f"rig {name}" for name in RIGS)} <= set(verbs)
    for words, command in verbs.items():
        own = {long_name(option) for option in options(command)} - SHARED_OPTIONS
        assert len(own) <= LARGEST_COUNT, f"jammkle {words}: {sorted(own)}"


def code_of(name: str) -> str:
    """Return the source of a function or class that is named with dots.

    Raises:
        LookupError: there is none of that name.

    """
    module, rest = name, []
    while not is_module(module):
        module, _, last = module.rpartition(".")
        rest.insert(0, last)
        if not module:
            raise LookupError(name)
    text = folder_of(module).with_suffix(".py").read_text()
    found: ast.AST = ast.parse(text)
    for each in rest:
        body = [node for node in getattr(found, "body", []) if getattr(node, "name", None) == each]
        if not body:
            raise LookupError(name)
        found = body[0]
    return str(ast.get_source_segment(text, found))


def test_the_ways_through_the_code_are_as_the_page_has_them() -> None:
    """Every name on the page is in the code, and every indented one is called by the one that it stands under."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    blocks = re.findall(r"<!-- calls -->\n```\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 2
    callers: list[str] = []
    for line in "\n\n".join(blocks).split("\n"):
        if not line.strip():
            continue
        depth, name = (len(line) - len(line.lstrip())) // 4, line.split()[0]
        code_of(name)
        if depth:
            caller, called = callers[depth - 1], name.rpartition(".")[2]
            calls = code_of(caller).replace("diagnose_recordings(", "diagnose(")  # as it is imported there
            # Or has another process call it, as in delayed(name)(...).
            assert re.search(rf"\b{called}\b\)?\(", calls), f"{caller} does not call {name}"
        callers = [*callers[:depth], name]
