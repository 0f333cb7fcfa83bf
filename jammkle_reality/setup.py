"""Build of jammkle_reality, for colcon."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "jammkle_reality"
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
    description="An independent machine that the gap diagnosis is tried on: a jammable ankle built of numbers alone.",
    license="Apache-2.0",
)
