"""Physics and rigs run without ROS and without a display; compiled laws run without a cache folder."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import numba

from jammkle_sim.physics.kernels import compiled

if TYPE_CHECKING:
    import pytest

SCRIPT = """
import os, sys
sys.modules["rclpy"] = None
import jammkle_sim.kinds  # as the node does
from jammkle_sim.rigs.landing import LandingOptions, landing_built
from jammkle_sim.rigs.simulation import Simulation
Simulation(landing_built(LandingOptions())).advance(10)
assert "MUJOCO_GL" not in os.environ, "MUJOCO_GL was left behind for child processes"
graphics = ("glfw", "opengl", "mujoco.egl", "osmesa")
loaded = sorted(name for name in sys.modules if any(word in name.lower() for word in graphics))
messages = sorted(name for name in sys.modules if name.startswith("jammkle_msgs") or name.endswith("_msgs"))
scipy = sorted({"scipy.ndimage", "scipy.optimize", "scipy.spatial"} & set(sys.modules))
print(loaded + messages + scipy)
"""


def test_runs_without_ros_and_without_graphics() -> None:
    """A landing can be built and run with rclpy blocked and no display, and loads no GL, messages or SciPy."""
    environment = {name: value for name, value in os.environ.items() if name not in {"DISPLAY", "MUJOCO_GL"}}
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == "[]"


def test_compiles_where_nothing_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where numba finds no folder for its cache, the function is compiled without one."""
    real_njit = numba.njit

    def njit_without_folder(*arguments: object, **options: object) -> object:
        if options.get("cache"):
            message = "cannot cache function: no locator available"
            raise RuntimeError(message)
        return real_njit(*arguments, **options)

    monkeypatch.setattr(numba, "njit", njit_without_folder)

    def twice(value: float) -> float:
        return 2.0 * value

    assert compiled(twice)(1.5) == 3.0
