"""Machine code for a function of the loop: lowered by numba, optimised by LLVM for this processor.

The module runs as a program: the request is pickled on standard input, the object file goes to standard output. It runs
in its own process because numba's optimisation must be switched off for the whole process: numba would optimise every
function with all functions that it calls, and again in each of its callers, which triples the time.
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from cosim.engine.blocks import Kind
from cosim.engine.compiled import SHARED
from cosim.engine.machine_code import optimised
from eightpost.workers.process import python_command, run


class Request(NamedTuple):
    """Request for machine code.

    Args:
        function: Function of the loop.
        kinds: Kinds of its first arguments, which are blocks.
        numbers: Number of integer arguments that follow.
        instead: Replacements of called functions, by name.
    """

    function: Callable[..., int]
    kinds: tuple[Kind, ...]
    numbers: int
    instead: dict[str, Callable[..., int]]


def object_file(request: Request) -> bytes:
    """Return an object file with the function, compiled in a separate process.

    Raises:
        RuntimeError: numba or LLVM failed.
    """
    ran = run(
        python_command("cosim.engine.lowering", bare="cosim"),
        environment=os.environ | {"NUMBA_OPT": "0", "NUMBA_DISABLE_JIT": "0"},
        question=pickle.dumps(request),
    )
    if ran.code != 0:
        fault = ran.errors.decode(errors="replace").strip()
        raise RuntimeError(
            f"{request.function.__name__} could not be compiled; engine='python' needs no compiler: {fault}"
        )
    return ran.output


def main() -> None:
    """Process one request."""
    request: Request = pickle.load(sys.stdin.buffer)
    sys.stdout.buffer.write(optimised(*_lowered(request)))


def _lowered(request: Request) -> tuple[str, str]:
    """Return the intermediate code of a function with all functions that it calls, and its name in the code."""
    import numba  # noqa: PLC0415 -- needed by the program only

    from cosim.engine.numba_types import block_type  # noqa: PLC0415

    _register(SHARED, request.instead)
    signature = (*map(block_type, request.kinds), *[numba.int64] * request.numbers)
    machine: Any = numba.njit(nogil=True, _nrt=False)(request.function)
    machine.compile(signature)
    return machine.inspect_llvm(signature), machine.overloads[signature].fndesc.llvm_func_name


def _register(functions: Sequence[Callable[..., Any]], instead: dict[str, Callable[..., int]]) -> None:
    """Make the marked functions callable from compiled code."""
    from numba.extending import overload  # noqa: PLC0415

    from cosim.engine import numba_types  # noqa: F401, PLC0415 -- registers the calls of FMI functions with numba

    options = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    for function in functions:
        taken = instead.get(function.__name__, function)
        overload(function, jit_options=options, strict=False)(lambda *_, taken=taken: taken)


if __name__ == "__main__":
    main()
