"""What is released: its changelog, what its wheel asks for, and what works where no ROS is installed."""

from __future__ import annotations

import ast
import datetime as dt
import os
import re
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
import yaml
from release import ReleaseError, numbers, released
from rosbags.highlevel import AnyReader
from wheels import EXTRAS, PACKAGES, requirements

from jammkle_common.messages import ROS_MODULES
from readme_tables import ROOT

DAY = dt.date(2027, 1, 2)
BROUGHT = {"markupsafe": "jinja2", "llvmlite": "numba", "backports": "rosbags"}
"""Modules that a requirement brings along, and says so."""
NEWER = ("compression",)
"""Modules of a newer Python, for which an older one has a foreign module."""
WITHOUT_ROS = f"""
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {ROS_MODULES!r}:
            raise ModuleNotFoundError(name + " is blocked", name=name)

sys.meta_path.insert(0, Blocker())
from jammkle_common.command.main import main
sys.exit(main(sys.argv[1:]))
"""


def run_without_ros(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command where no module of ROS can be imported."""
    command = [sys.executable, "-c", WITHOUT_ROS, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_release_moves_what_is_unreleased_under_its_version() -> None:
    """New entries go under version and day, older releases stay, and nothing is unreleased."""
    text = "# Changelog\n\n## Unreleased\n\n### Added\n\n- A.\n\n## 0.1.0 - 2026-01-01\n\n- B.\n"
    assert released(text, "0.2.0", DAY) == (
        "# Changelog\n\n## Unreleased\n\n## 0.2.0 - 2027-01-02\n\n### Added\n\n- A.\n\n## 0.1.0 - 2026-01-01\n\n- B.\n"
    )


def test_there_is_no_release_of_nothing() -> None:
    """A changelog without new entries, or a version that is none, ends it before anything is written."""
    once = released("## Unreleased\n\n- A.\n", "0.2.0", DAY)
    with pytest.raises(ReleaseError, match="nothing to release"):
        released(once, "0.3.0", DAY)
    for version in ("", "1.2", "v1.2.3", "1.2.3rc1"):
        with pytest.raises(ReleaseError, match=r"1\.2\.3"):
            numbers(version)


def test_the_wheel_asks_for_all_that_it_imports() -> None:
    """Each foreign module that a package imports comes from a requirement of the wheel or of one of its extras."""
    sections = requirements()
    asked = {line.split("=")[0].rstrip(">") for name in ("base", *EXTRAS) for line in sections.get(name, ())}
    known = packages_distributions()
    for package in PACKAGES:
        for path in (ROOT / package).glob("jammkle_*/**/*.py"):
            for name in foreign_imports(path):
                owners = {BROUGHT.get(name), *(each.lower() for each in known[name])}
                assert owners & asked, f"{path.relative_to(ROOT)} imports {name}"


def foreign_imports(path: Path) -> set[str]:
    """Top-level names of foreign modules that a file imports while it runs: not of Python, ROS or this project."""
    found: set[str] = set()
    pending: list[ast.AST] = [ast.parse(path.read_text())]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            pending += node.orelse
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
        pending += ast.iter_child_nodes(node)
    ours = {name for name in found if name.startswith("jammkle")}
    return found - ours - {*sys.stdlib_module_names, *NEWER} - set(ROS_MODULES)


def test_a_rig_writes_the_same_messages_without_ros(tmp_path: Path) -> None:
    """Where no ROS is installed, a bag holds the same messages, byte by byte, with the same hashes of their types."""
    for folder, run in (("with", run_with_ros), ("without", run_without_ros)):
        done = run("rig", "drop", "-o", str(tmp_path / folder))
        assert done.returncode == 0, done.stderr
    assert content(tmp_path / "with") == content(tmp_path / "without")


def run_with_ros(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command as it is."""
    command = [sys.executable, "-m", "jammkle_common.command", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def content(bag: Path) -> list[tuple[str, str, int, bytes]]:
    """Every message of a bag, with its topic, the hash of its type and its time."""
    with AnyReader([bag]) as reader:
        return [(each.topic, each.digest, time_ns, data) for each, time_ns, data in reader.messages()]


def test_a_verb_that_needs_ros_says_so() -> None:
    """Without ROS, a verb of the graph ends with one line that tells how to get it."""
    done = run_without_ros("status")
    assert done.returncode == 1
    assert "pip install 'jammkle[ros]'" in done.stderr
    assert done.stderr.count("\n") == 1


WITHOUT = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(name + " is blocked", name=name)

sys.meta_path.insert(0, Blocker())
from jammkle_common.command.main import main
sys.exit(main(sys.argv[1:]))
"""
EXTRA_MODULES = ("plotly", "pyarrow", "sklearn", "foxglove", "distributed", "dask", "psutil", "hypothesis", "cmake")
"""Of what `make demo` does not install."""


def run_as_in_the_demo(*arguments: str, at: Path) -> subprocess.CompletedProcess[str]:
    """Run the command where no module can be imported that `make demo` does not install."""
    command = [sys.executable, "-c", WITHOUT.format(blocked=EXTRA_MODULES), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=at)


def test_what_the_demo_installs_is_enough_for_all_but_named_verbs(tmp_path: Path) -> None:
    """Rigs, bags and detection work without the extras; plot and export say what they lack, and where it is."""
    done = run_as_in_the_demo("rig", "pressure", "--cycles", "1", "-o", "bag", at=tmp_path)
    assert done.returncode == 0, done.stderr
    assert run_as_in_the_demo("info", "bag", at=tmp_path).returncode == 0
    for verb, missing in (("plot", "plotly"), ("export", "pyarrow")):
        refused = run_as_in_the_demo(verb, "bag", "-o", verb, at=tmp_path)
        assert refused.returncode == 1
        assert missing in refused.stderr
        assert "jammkle[bags]" in refused.stderr
        assert "`make extras`" in refused.stderr
        assert not (tmp_path / verb).exists()


def test_the_demo_has_the_versions_of_all_else() -> None:
    """Its lock is a part of the whole one, with what runs the graph and without the extras."""

    def pins(name: str) -> set[str]:
        return set(re.findall(r"^([a-z0-9.-]+==\S+)", (ROOT / name).read_text(), re.MULTILINE))

    demo, whole = pins("requirements-demo.lock"), pins("requirements.lock")
    assert demo < whole
    named = {pin.partition("==")[0] for pin in demo}
    assert {"ros-jazzy-rclpy", "mujoco", "numba", "rosbags", "viser", "matplotlib"} <= named
    assert not named & {"plotly", "pyarrow", "scikit-learn", "foxglove-sdk", "cmake", "mypy", "ruff", "hypothesis"}


def test_a_release_is_one_commit_with_a_tag(tmp_path: Path) -> None:
    """Version, manifests and changelog change together; the tag is on it; the same version is not released twice."""
    clone = tmp_path / "clone"

    def git(*arguments: str, at: Path = clone) -> str:
        return subprocess.run(["git", "-C", at, *arguments], capture_output=True, text=True, check=True).stdout.strip()  # noqa: S607

    git("clone", "--quiet", str(ROOT), str(clone), at=tmp_path)
    for key, value in (("user.name", "A maintainer"), ("user.email", "maintainer@jammkle.example")):
        git("config", key, value)
    notes = clone / "CHANGELOG.md"
    notes.write_text(notes.read_text().replace("## Unreleased\n", "## Unreleased\n\n- A new entry.\n", 1))
    script, version = clone / "jammkle_bringup/scripts/release.py", "99.0.0"

    def release() -> subprocess.CompletedProcess[str]:
        environment = {**os.environ, "PYTHONPATH": str(clone / "jammkle_common")}
        command = [sys.executable, str(script), version]
        return subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=clone)

    refused = release()
    assert refused.returncode == 2
    assert "not committed" in refused.stderr
    git("commit", "--all", "--quiet", "--message", "Add an entry")
    done = release()
    assert done.returncode == 0, done.stderr
    assert git("cat-file", "-t", f"v{version}") == "tag"
    assert git("rev-list", "-1", f"v{version}") == git("rev-parse", "HEAD")
    assert git("log", "-1", "--format=%s") == f"Release {version}"
    assert git("status", "--porcelain") == ""
    assert f"## {version} - " in notes.read_text()
    for package in PACKAGES:
        assert f"<version>{version}</version>" in (clone / package / "package.xml").read_text()
    again = release()
    assert again.returncode == 2
    assert "is not newer" in again.stderr


def test_what_is_checked_before_a_commit_is_what_lint_checks() -> None:
    """Every hook of pre-commit starts a tool of the environment, and make lint uses the same ones."""
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    lint = (ROOT / "Makefile").read_text()
    tools = {hook["entry"].split()[0] for hook in hooks}
    assert {Path(tool).name for tool in tools} == {"ruff", "mypy", "python"}
    for tool in tools:
        assert (Path(sys.prefix) / "bin" / Path(tool).name).exists()
        assert f"$(BIN)/{Path(tool).name}" in lint
