"""Build of jammkle_controller, for colcon."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "jammkle_controller"
VERSION = re.search("<version>(.*)</version>", Path(__file__).resolve().with_name("package.xml").read_text())[1]

setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(exclude=["test"]),
    package_data={f"{NAME}.core": ["learned.json", "ankle.json"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},  # tells colcon what runs the tests
    zip_safe=True,
    maintainer="Jammkle maintainers",
    maintainer_email="maintainers@jammkle.example",
    description="Slip and impact detection and the jamming policy of a jammable ankle.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["controller = jammkle_controller.__main__:main"],
        "jammkle.commands": ["detect = jammkle_controller.commands:app"],
    },
)
