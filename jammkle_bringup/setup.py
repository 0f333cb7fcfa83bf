"""Build of jammkle_bringup, for colcon."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "jammkle_bringup"
VERSION = re.search("<version>(.*)</version>", Path(__file__).resolve().with_name("package.xml").read_text())[1]


def files_in(folder: str) -> tuple[str, list[str]]:
    """Install everything in `folder` under the package's share directory."""
    return f"share/{NAME}/{folder}", [str(path) for path in sorted(Path(folder).iterdir()) if path.is_file()]


setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        files_in("launch"),
        files_in("config"),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},  # tells colcon what runs the tests
    zip_safe=True,
    maintainer="Jammkle maintainers",
    maintainer_email="maintainers@jammkle.example",
    description="The jammkle command, launch files, parameters and viewer layouts.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "composed = jammkle_bringup.composed:main",
            "jammkle = jammkle_common.command.__main__:main",
            "robot_names = jammkle_bringup.robot_names:main",
        ],
        "jammkle.commands": [
            *(f"{verb} = jammkle_bringup.commands:app" for verb in ("up", "jam", "unjam", "call", "status", "record")),
            *(f"{verb} = jammkle_bringup.commands:app" for verb in ("demo", "exercise")),
            *(f"{verb} = jammkle_bringup.commands:app" for verb in ("info", "recover", "export", "plot", "rename")),
        ],
        "jammkle.exercise": [
            "record = jammkle_bringup.exercise:exercise",
            "is_simulated = jammkle_bringup.exercise:is_simulated",
        ],
    },
)
