"""Build of jammkle_driver, for colcon."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "jammkle_driver"
VERSION = re.search("<version>(.*)</version>", Path(__file__).resolve().with_name("package.xml").read_text())[1]

setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["config/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},  # tells colcon what runs the tests
    zip_safe=True,
    maintainer="Jammkle maintainers",
    maintainer_email="maintainers@jammkle.example",
    description="Pump and solenoids of a jammable ankle as topics and services.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["driver = jammkle_driver.__main__:main"],
        "jammkle.commands": ["hardware = jammkle_driver.commands:app"],
        "jammkle.hardware": [
            "sim = jammkle_driver.hardware:SimulatedHardware",
            "fake = jammkle_driver.hardware:FakeHardware",
            "modbus = jammkle_driver.board_hardware:BoardHardware",
        ],
    },
)
