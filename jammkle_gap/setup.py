"""Build of jammkle_gap, for colcon."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "jammkle_gap"
VERSION = re.search("<version>(.*)</version>", Path(__file__).resolve().with_name("package.xml").read_text())[1]

setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(exclude=["test"]),
    package_data={
        f"{NAME}.ankle": ["library/*.yaml"],
        f"{NAME}.report": ["*.j2"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},  # tells colcon what runs the tests
    zip_safe=True,
    maintainer="Jammkle maintainers",
    maintainer_email="maintainers@jammkle.example",
    description="Where simulation and robot disagree, and why: diagnosis, pages, blind trials, live monitor.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["gap_monitor = jammkle_gap.monitor.__main__:main"],
        "jammkle.commands": ["gap = jammkle_gap.commands:app"],
        "jammkle.effects_file": ["load = jammkle_gap.ankle.corrected:load_change"],
    },
)
