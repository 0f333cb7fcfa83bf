"""Build of jammkle_sim, for colcon."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "jammkle_sim"
VERSION = re.search("<version>(.*)</version>", Path(__file__).resolve().with_name("package.xml").read_text())[1]

setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},  # tells colcon what runs the tests
    zip_safe=True,
    maintainer="Jammkle maintainers",
    maintainer_email="maintainers@jammkle.example",
    description="Simulation of a jammable ankle, its pneumatics, rigs and sensors in MuJoCo.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["robot = jammkle_sim.robot:main", "sim = jammkle_sim.__main__:main"],
        "jammkle.commands": [
            "rig = jammkle_sim.commands:app",
            "robot = jammkle_sim.commands:app",
        ],
    },
)
