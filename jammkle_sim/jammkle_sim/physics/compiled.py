"""Typed door to numba: `compiled` for the laws that run every step, `call_with_two_pointers` for C functions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

import numba
from llvmlite import ir  # type: ignore[import-untyped]  # carries no types
from numba import types
from numba.extending import intrinsic

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of scalars and arrays at its first call, and keep the result on disk for the next process.

    Numba keeps it beside the source or, where that is read-only, in the user's cache folder. Where neither can be
    written the function is compiled anew in every process. Numba looks only at the age of the file that holds the
    function, so compiled functions that call one another stand in one module.
    """
    try:
        return cast("Callable[P, R]", numba.njit(function, cache=True, error_model="numpy", nogil=True))
    except RuntimeError:  # "no locator available": no folder for the cache
        return cast("Callable[P, R]", numba.njit(function, error_model="numpy", nogil=True))


def _call_with_two_pointers(_context: Any, _function: Any, _first: Any, _second: Any) -> Any:
    """Write the machine code of `call_with_two_pointers`; numba's interface for that."""
    signature = types.void(types.intp, types.intp, types.intp)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        function_type = ir.FunctionType(ir.VoidType(), [pointer, pointer])
        function = builder.inttoptr(arguments[0], function_type.as_pointer())
        builder.call(function, [builder.inttoptr(argument, pointer) for argument in arguments[1:]])
        return context.get_dummy_value()

    return signature, generate


call_with_two_pointers = cast("Callable[[int, int, int], None]", intrinsic(_call_with_two_pointers))
"""Call the C function `void f(void*, void*)` at an address, from compiled code: address, first and second pointer.

Addresses come as arguments, not as constants, so that the compiled code can be kept for other processes.
"""
