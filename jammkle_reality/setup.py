"""Build of jammkle_reality, for colcon."""

from setuptools import find_packages, setup

NAME = "jammkle_reality"

setup(
    name=NAME,
    version="0.1.0",
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
