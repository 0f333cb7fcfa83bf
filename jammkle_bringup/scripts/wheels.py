"""Build the wheels of a release into dist: `make wheels`.

`jammkle` holds all packages in pure Python: the command, rigs and the diagnosis work without ROS. `jammkle-msgs` holds
the compiled interfaces for this Python and machine; the extra `ros` asks for it, and for ROS 2 Jazzy from wheels.

The packages are those of colcon, and what they say of themselves (entry points, data) is taken from their setup.py.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from distutils.core import run_setup
from pathlib import Path
from typing import TYPE_CHECKING, Any

from set_up import OLDEST_PYTHON, PACKAGES, ROOT, VENV

from jammkle_common import VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator

DIST = ROOT / "dist"
INTERFACES, *NODES = PACKAGES
COMMON = NODES[0]
COMMAND = "jammkle"
BASE = "base"
EXTRAS = ("ros", "view", "bags", "foxglove")
"""Sections of requirements.in that are extras of the wheel, as far as they are there."""


def requirements() -> dict[str, list[str]]:
    """Requirements by section of requirements.in: what was tried or newer, and of ROS, which is compiled, just that.

    The versions are those of requirements.lock, which has one for each range of Python.
    """
    locked: dict[str, list[tuple[str, str]]] = {}
    for line in (ROOT / "requirements.lock").read_text().splitlines():
        if found := re.match(r"([a-z0-9.-]+)==(\S+)(?: ; (.*?))?(?: \\)?$", line):
            locked.setdefault(found[1], []).append((found[2], found[3] or ""))
    sections: dict[str, list[str]] = {}
    section = ""
    for line in (ROOT / "requirements.in").read_text().splitlines():
        if heading := re.match(r"# \[(\w+)\]", line):
            section = heading[1]
        elif found := re.match(r"([A-Za-z0-9_.-]+)(\S*)", line):
            name = found[1].lower().replace("_", "-")
            exactly = name.startswith("ros-") or found[2].startswith("==")
            sections.setdefault(section, []).extend(
                f"{name}{'==' if exactly else '>='}{version}{f' ; {marker}' if marker else ''}"
                for version, marker in locked[name]
            )
    return sections


def described(package: str) -> Any:
    """Return what a package's setup.py says, without doing it."""
    os.chdir(ROOT / package)  # its paths are relative
    try:
        return run_setup("setup.py", stop_after="init")
    finally:
        os.chdir(ROOT)


def copied(source: Path, target: Path) -> None:
    """Copy the files of a folder that belong into a wheel, links followed."""
    ignored = shutil.ignore_patterns("__pycache__", "*.c", "*.pyc")
    shutil.copytree(source, target, ignore=ignored, dirs_exist_ok=True)


def toml(value: Any) -> str:
    """Return text, numbers, lists and tables as they stand in TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f'"{key}" = {toml(each)}' for key, each in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml(each) for each in value) + "]"
    return '"' + str(value).replace("\\", "\\\\").replace('"', '\\"') + '"'


def command_tree(folder: Path) -> None:
    """Lay out the source tree of `jammkle`: every package, the definitions of its messages, and its description."""
    for kind in ("msg", "srv"):
        copied(ROOT / INTERFACES / kind, folder / COMMON / "share" / INTERFACES / kind)
    packages: list[str] = []
    package_data: dict[str, list[str]] = {}
    data: dict[str, list[str]] = {}
    groups: dict[str, dict[str, str]] = {}
    for name in NODES:
        about = described(name)
        copied(ROOT / name / name, folder / name)
        packages += about.packages
        package_data |= about.package_data
        for target, files in about.data_files:
            for file in files:
                here = Path("data") / name / file
                (folder / here).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(ROOT / name / file, folder / here)
                data.setdefault(target, []).append(str(here))
        for group, lines in about.entry_points.items() if about.entry_points else ():
            groups.setdefault(group, {}).update(re.split(r"\s*=\s*", line, maxsplit=1) for line in lines)
    package_data[COMMON].append("share/**/*")
    scripts = groups.pop("console_scripts")
    sections = requirements()
    extras = {name: sections[name] for name in EXTRAS if name in sections}
    extras["ros"] = [*extras["ros"], f"jammkle-msgs=={VERSION}"]
    shutil.copy(ROOT / "LICENSE", folder)
    (folder / "README.md").write_text(readme_alone())
    lines = [
        "[build-system]",
        'requires = ["setuptools>=77"]',
        'build-backend = "setuptools.build_meta"',
        "[project]",
        f"name = {toml(COMMAND)}",
        f"version = {toml(VERSION)}",
        'description = "Legged robots with jammable ankles: driver, controller, simulation, and where it is wrong."',
        'readme = "README.md"',
        'license = "Apache-2.0"',
        'license-files = ["LICENSE"]',
        'authors = [{ name = "Jammkle maintainers", email = "maintainers@jammkle.example" }]',
        f"requires-python = {toml('>={}.{}'.format(*OLDEST_PYTHON))}",
        f"dependencies = {toml(sections[BASE])}",
        f"optional-dependencies = {toml(extras)}",
        # Of the nodes only the command is put on the path: `driver` and `sim` are names of ROS packages' folders.
        f"scripts = {toml({COMMAND: scripts[COMMAND]})}",
        f"entry-points = {toml(groups)}",
        "[tool.setuptools]",
        f"packages = {toml(packages)}",
        f"package-data = {toml(package_data)}",
        f"data-files = {toml(data)}",
    ]
    (folder / "pyproject.toml").write_text("\n".join(lines) + "\n")


def readme_alone() -> str:
    """Return the README without what only leads somewhere inside the checkout."""
    text = (ROOT / "README.md").read_text()
    return re.sub(r"!?\[([^\]]*)\]\((?!https?:)[^)]*\)", r"\1", text)


def subpackages(folder: Path, name: str) -> Iterator[str]:
    """Names with dots of the packages below one."""
    for init in sorted(folder.glob("*/**/__init__.py")):
        yield ".".join((name, *init.parent.relative_to(folder).parts))


def interfaces_tree(folder: Path) -> None:
    """Lay out the source tree of `jammkle-msgs` from what the set-up has built into the environment."""
    site = next(VENV.glob("lib/python*/site-packages"))
    copied(site / INTERFACES, folder / INTERFACES)
    found = [*VENV.glob(f"lib/lib{INTERFACES}__*.so"), *VENV.glob(f"share/ament_index/resource_index/*/{INTERFACES}")]
    found += [path for top in ("share", "include") for path in (VENV / top / INTERFACES).rglob("*") if path.is_file()]
    data: dict[str, list[str]] = {}
    for path in found:
        place = path.relative_to(VENV)
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, folder / place)
        data.setdefault(str(place.parent), []).append(str(place))
    shutil.copy(ROOT / "LICENSE", folder)
    runtime = [each for each in requirements()["ros"] if not each.startswith("ros-jazzy-rmw")]
    (folder / "setup.py").write_text(f'''
from setuptools import Distribution, setup


class Compiled(Distribution):
    """What is inside was compiled for one Python and one kind of machine."""

    def has_ext_modules(self):
        return True


setup(
    name="jammkle-msgs",
    version={VERSION!r},
    description="Compiled ROS 2 Jazzy interfaces of Jammkle.",
    license="Apache-2.0",
    packages={[INTERFACES, *subpackages(folder / INTERFACES, INTERFACES)]!r},
    package_data={{{INTERFACES!r}: ["*.so"]}},
    data_files={list(data.items())!r},
    install_requires={runtime!r},
    distclass=Compiled,
)
''')


def main() -> int:
    """Build both wheels, and of the pure one its source distribution."""
    DIST.mkdir(exist_ok=True)
    for lay_out in (command_tree, interfaces_tree):
        with tempfile.TemporaryDirectory() as folder:
            lay_out(Path(folder))
            pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", "--quiet"]
            subprocess.run([*pip, "--no-deps", "--no-build-isolation", "--wheel-dir", DIST, folder], check=True)
            if lay_out is command_tree:
                source = f"from setuptools.build_meta import build_sdist; build_sdist({str(DIST)!r})"
                subprocess.run([sys.executable, "-c", source], check=True, cwd=folder, stdout=subprocess.DEVNULL)
    for file in sorted(DIST.glob(f"*-{VERSION}[-.]*")):
        sys.stdout.write(f"{file.relative_to(ROOT)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
