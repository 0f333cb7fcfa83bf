"""Door to numba: loops compiled at their first call and kept on disk until any file of this package changes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

import numba

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of numbers, arrays and tuples of them; functions compiled so may call one another.

    They are written into their callers: handing over tuples of arrays takes longer than what most of them compute.
    Numba itself looks only at the age of the file that holds a function. Here the loops of one file call those of
    others, so what is kept is thrown away when any source of this package is another one.
    """
    try:
        kept: Any = numba.njit(function, cache=True, error_model="numpy", nogil=True, forceinline=True)
        kept._cache._cache_file._source_stamp = _stamp()  # noqa: SLF001  # numba has no other way to say it
    except RuntimeError:  # "no locator available": no folder for what is kept
        kept = numba.njit(function, error_model="numpy", nogil=True, forceinline=True)
    return cast("Callable[P, R]", kept)


def _stamp() -> tuple[tuple[str, int, int], ...]:
    """Name, age and size of every source of this package."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return tuple((file.name, status.st_mtime_ns, status.st_size) for file in files for status in (file.stat(),))
