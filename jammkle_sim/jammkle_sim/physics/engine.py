"""MuJoCo, loaded without a display: the one place of the project where it is imported for simulation.

On Linux `import mujoco` loads GLFW or another OpenGL loader unless MUJOCO_GL says otherwise. A simulator that runs on a
robot or a server must not, so the variable is set for the time of the import where nobody else has set it. Who wants to
draw in the same process imports mujoco, or sets MUJOCO_GL, first.
"""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

_GL_VARIABLE = "MUJOCO_GL"

if _GL_VARIABLE in os.environ:
    import mujoco  # type: ignore[import-untyped,import-not-found,unused-ignore]  # carries no types
else:
    os.environ[_GL_VARIABLE] = "disable"
    try:
        import mujoco
    finally:
        del os.environ[_GL_VARIABLE]

__all__ = ["address_of_function", "mujoco"]


def address_of_function(name: str) -> int:
    """Address of a function of the MuJoCo library that the Python bindings already use, or 0 if it cannot be found.

    Args:
        name: Name in MuJoCo's C interface, such as `mj_step1`.

    """
    folder = Path(mujoco.__file__).parent
    libraries = sorted(folder.glob("libmujoco*.so*")) + sorted(folder.glob("libmujoco*.dylib"))
    for library in libraries:
        try:
            function = getattr(ctypes.CDLL(str(library)), name)
        except (OSError, AttributeError):
            continue
        return ctypes.cast(function, ctypes.c_void_p).value or 0
    return 0
