"""Machine code for functions of the loop: made once per machine for its processor, loaded once per process."""

from __future__ import annotations

import ctypes
import hashlib
import os
import pickle
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm

from cosim.engine.blocks import INTEGERS, REALS, Kind, described
from eightpost.cache import keep, recall
from eightpost.workers.process import python_command, run

# ---- Object files for this processor --------------------------------------------------------------------------------

#: Name of the function in every object file.
_ENTRY = "cosim_engine_entry"

#: LLVM's engines, which own the loaded code.
_LOADED: list[Any] = []


def optimised(code: str, name: str, entries: Mapping[str, str] | None = None) -> bytes:
    """Optimise intermediate code as a whole, and return an object file.

    Args:
        code: LLVM's intermediate code.
        name: Name of the entry function in the code.
        entries: Code of C functions that call the entry function, by name; None adds no functions.
    """
    module, machine = llvm.parse_assembly(code), _machine()
    for function in module.functions:
        if function.name != name and not function.is_declaration:
            function.linkage = "internal"
    for added in (entries or {}).values():
        module.link_in(llvm.parse_assembly(added))
    module.get_function(name).name = _ENTRY
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = True
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    content: bytes = machine.emit_object(module)
    return content


def loaded(content: bytes) -> int:
    """Load an object file of `optimised`; return the function's address."""
    return _loaded_entries(content, (_ENTRY,))[0]


def _loaded_entries(content: bytes, names: Sequence[str]) -> list[int]:
    """Load an object file of `optimised`; return the addresses of the functions of these names."""
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    _LOADED.append(engine)
    return [engine.get_function_address(name) for name in names]


@cache
def description() -> tuple[str, str, str]:
    """Return the system, the processor and its features."""
    return llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _machine() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    triple, cpu, features = description()
    target = llvm.Target.from_triple(triple)
    return target.create_target_machine(
        cpu=cpu,
        features=features,
        opt=3,
        reloc="static" if target.name.startswith("x86") else "default",
        codemodel="jitdefault",
        jit=True,
    )


# ---- Compilation in a process of its own ----------------------------------------------------------------------------


class Request(NamedTuple):
    """Request for machine code."""

    function: Callable[..., int]  #: Function of the loop.
    kinds: tuple[Kind, ...]  #: Kinds of its first arguments, which are blocks.
    numbers: int  #: Number of integer arguments that follow.
    instead: dict[str, Callable[..., int]]  #: Replacements of called functions, by name.
    reals: int = 0  #: Number of real arguments after these.
    #: Kinds of the arguments of C functions that call the function with their number, by name; None adds no functions.
    entries: Mapping[str, tuple[str, ...]] | None = None


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


# ---- Functions, compiled once per machine ---------------------------------------------------------------------------

#: Folder of the cache, and the number of files in it.
_FOLDER, _KEPT = "loop", 40

_FUNCTIONS: dict[str, Callable[..., int]] = {}
_ADDRESSES: dict[str, dict[str, int]] = {}
_ONE_AT_A_TIME = threading.Lock()


def machine_code(
    function: Callable[..., int], kinds: tuple[Kind, ...], instead: dict[str, Callable[..., int]]
) -> Callable[..., int]:
    """Return a function that takes the addresses of the blocks, and integers.

    Args:
        function: Function of the loop.
        kinds: Kinds of its first arguments, which are blocks; the others are integers.
        instead: Replacements of called functions, by name.

    Raises:
        RuntimeError: The function could not be compiled.
    """
    count = function.__code__.co_argcount
    key = _key(function.__name__, *map(described, kinds), *(f"{name}: {f.__name__}" for name, f in instead.items()))
    with _ONE_AT_A_TIME:
        if key not in _FUNCTIONS:
            content = recall(_FOLDER, key)
            if content is None:
                content = object_file(Request(function, kinds, count - len(kinds), instead))
                keep(_FOLDER, key, content, most=_KEPT)
            _FUNCTIONS[key] = _callable(loaded(content), count)
    return _FUNCTIONS[key]


def c_functions(function: Callable[..., int], kind: Kind, entries: Mapping[str, tuple[str, ...]]) -> dict[str, int]:
    """Return the addresses of C functions that call a function of a block, by name.

    Args:
        function: Function of a block, the number of the C function, `INTEGERS` integers and `REALS` real numbers.
        kind: Kind of the block.
        entries: Kinds of the arguments of each C function, by name: "pointer", "size", "int", "byte", "real". The first
            one is the address of the block.

    Raises:
        RuntimeError: The functions could not be compiled.
    """
    key = _key(function.__name__, described(kind), str(entries))
    with _ONE_AT_A_TIME:
        if key not in _ADDRESSES:
            content = recall(_FOLDER, key)
            if content is None:
                content = object_file(Request(function, (kind,), 1 + INTEGERS, {}, REALS, entries))
                keep(_FOLDER, key, content, most=_KEPT)
            _ADDRESSES[key] = dict(zip(entries, _loaded_entries(content, tuple(entries)), strict=True))
    return _ADDRESSES[key]


def _callable(address: int, count: int) -> Callable[..., int]:
    """Return a function of integers in numba's calling convention, with results and errors through pointers."""
    call = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, *[ctypes.c_int64] * count)(address)

    def function(*arguments: int) -> int:
        returned, raised = ctypes.c_int64(), ctypes.c_void_p()
        if call(ctypes.addressof(returned), ctypes.addressof(raised), *arguments):
            raise ArithmeticError("the compiled loop divided by zero")
        return returned.value

    return function


def _key(*what: str) -> str:
    """Return a digest of everything that machine code depends on."""
    parts = (*what, _sources(), version("numba"), version("llvmlite"), *description())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


@cache
def _sources() -> str:
    """Return a digest of all sources of the loop."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()
