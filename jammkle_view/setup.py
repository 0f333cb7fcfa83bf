"""Build of jammkle_view, for colcon."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "jammkle_view"
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
    description="The page in the browser: the robot in 3D, live or from a bag, with buttons that jam and unjam.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["foxglove = jammkle_view.foxglove.__main__:main", "viewer = jammkle_view.__main__:main"],
        "jammkle.commands": ["view = jammkle_view.commands:app"],
    },
)
