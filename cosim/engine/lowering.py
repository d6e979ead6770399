"""Machine code of a function of the loop: lowered by numba, optimised by LLVM for this processor.

Run as a program: the request is pickled on standard input, the object file goes to standard output. It is a process of
its own because numba is told, for all of a process, not to optimise: numba would optimise every function with all that
it calls, and again in each of its callers, which takes three times as long as all the rest.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cosim.engine.blocks import Kind
from cosim.engine.compiled import SHARED
from cosim.engine.processor import optimised

#: The packages' folder: the program must find the same ones, wherever it runs.
_ROOT = Path(__file__).parents[2]

#: It ends with this process. What the package imports by itself takes longer than all that is needed of it.
_PROGRAM = """
import sys, types
sys.path.insert(0, {root!r})
from eightpost.parent_process import end_with
end_with({parent})
package = sys.modules["cosim"] = types.ModuleType("cosim")
package.__path__ = [{cosim!r}]
from cosim.engine.lowering import main
main()
"""


class Request(NamedTuple):
    """What is to be machine code.

    Args:
        function: A function of the loop.
        kinds: The kinds of its first arguments, which are blocks.
        numbers: How many integers follow.
        instead: By name of a function that is called, the one that takes its place.
    """

    function: Callable[..., int]
    kinds: tuple[Kind, ...]
    numbers: int
    instead: dict[str, Callable[..., int]]


def object_file(request: Request) -> bytes:
    """Return an object file with the function, in a process of its own.

    Raises:
        RuntimeError: numba or LLVM failed.
    """
    program = _PROGRAM.format(root=str(_ROOT), parent=os.getpid(), cosim=str(_ROOT / "cosim"))
    ran = subprocess.run(
        [sys.executable, "-P", "-c", program],
        input=pickle.dumps(request),
        capture_output=True,
        check=False,
        env=os.environ | {"NUMBA_OPT": "0", "NUMBA_DISABLE_JIT": "0"},
    )
    if ran.returncode != 0:
        said = ran.stderr.decode(errors="replace").strip()
        raise RuntimeError(
            f"{request.function.__name__} could not be compiled; engine='python' needs no compiler: {said}"
        )
    return ran.stdout


def main() -> None:
    """Answer one request."""
    request: Request = pickle.load(sys.stdin.buffer)
    sys.stdout.buffer.write(optimised(*_lowered(request)))


def _lowered(request: Request) -> tuple[str, str]:
    """Return intermediate code of a function with all that it calls, and the function's name in it."""
    import numba  # noqa: PLC0415 -- only the program needs it

    from cosim.engine.block_types import block_type  # noqa: PLC0415

    _register(SHARED, request.instead)
    signature = (*map(block_type, request.kinds), *[numba.int64] * request.numbers)
    machine: Any = numba.njit(nogil=True, _nrt=False)(request.function)
    machine.compile(signature)
    return machine.inspect_llvm(signature), machine.overloads[signature].fndesc.llvm_func_name


def _register(functions: Sequence[Callable[..., Any]], instead: dict[str, Callable[..., int]]) -> None:
    """Let compiled code call the functions that are marked; nothing else calls their machine code."""
    from numba.extending import overload  # noqa: PLC0415

    from cosim.engine import native_calls  # noqa: F401, PLC0415 -- numba then knows the calls of FMI functions

    options = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    for function in functions:
        taken = instead.get(function.__name__, function)
        overload(function, jit_options=options, strict=False)(lambda *_, taken=taken: taken)
