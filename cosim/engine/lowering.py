"""Machine code for a function of the loop: lowered by numba, optimised by LLVM for this processor.

This module is the program that `machine_code.object_file` runs: the request is pickled on standard input, the object
file goes to standard output. It has its own process because numba's optimisation must be switched off for the whole
process: numba would optimise every function with all functions that it calls, and again in each of its callers, which
triples the time.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numba
from numba.extending import overload

from cosim.engine.compiled import SHARED
from cosim.engine.machine_code import Request, optimised
from cosim.engine.numba_types import block_type  # and it registers the calls of FMI functions with numba


def main() -> None:
    """Process one request."""
    request: Request = pickle.load(sys.stdin.buffer)
    sys.stdout.buffer.write(optimised(*_lowered(request)))


def _lowered(request: Request) -> tuple[str, str]:
    """Return the intermediate code of a function with all functions that it calls, and its name in the code."""
    _register(SHARED, request.instead)
    signature = (*map(block_type, request.kinds), *[numba.int64] * request.numbers)
    machine: Any = numba.njit(nogil=True, _nrt=False)(request.function)
    machine.compile(signature)
    return machine.inspect_llvm(signature), machine.overloads[signature].fndesc.llvm_func_name


def _register(functions: Sequence[Callable[..., Any]], instead: dict[str, Callable[..., int]]) -> None:
    """Make the marked functions callable from compiled code."""
    options = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    for function in functions:
        taken = instead.get(function.__name__, function)
        overload(function, jit_options=options, strict=False)(lambda *_, taken=taken: taken)


if __name__ == "__main__":
    main()
