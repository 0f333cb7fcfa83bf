"""Build of jammkle_contact, for colcon."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "jammkle_contact"
VERSION = re.search("<version>(.*)</version>", Path(__file__).resolve().with_name("package.xml").read_text())[1]

setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(exclude=["test"]),
    package_data={f"{NAME}.trial": ["*.j2"], NAME: ["*.j2"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},  # tells colcon what runs the tests
    zip_safe=True,
    maintainer="Jammkle maintainers",
    maintainer_email="maintainers@jammkle.example",
    description="Driver, controller and simulation in one process: detection on recordings, and the trial of contact.",
    license="Apache-2.0",
    entry_points={
        "jammkle.commands": [f"{verb} = jammkle_contact.commands:app" for verb in ("contact", "detect")],
    },
)
