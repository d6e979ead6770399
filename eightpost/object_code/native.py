"""Object files for this processor: optimised and loaded by LLVM, and called in numba's calling convention."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

from eightpost.array_types import Array
from eightpost.extras import needs

with needs("fit", "machine code"):
    import llvmlite.binding as llvm

# ---- Object files for this processor --------------------------------------------------------------------------------

#: Name of the function in every object file.
ENTRY = "eightpost_entry"

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
    module.get_function(name).name = ENTRY
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = True
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    content: bytes = machine.emit_object(module)
    return content


def loaded_entries(content: bytes, names: Sequence[str] = (ENTRY,)) -> list[int]:
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


# ---- Calls in numba's calling convention ----------------------------------------------------------------------------


def function_at(address: int, count: int) -> Callable[..., int]:
    """Return a function of `count` integers that returns one, in numba's calling convention.

    Raises:
        ArithmeticError: Raised by the function: the code divided by zero.
    """
    call = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, *[ctypes.c_int64] * count)(address)

    def function(*arguments: int) -> int:
        returned, raised = ctypes.c_int64(), ctypes.c_void_p()
        if call(ctypes.addressof(returned), ctypes.addressof(raised), *arguments):
            raise ArithmeticError("the compiled loop divided by zero")
        return returned.value

    return function


def array_words(array: Array) -> tuple[int, ...]:
    """Return an array as numba's integers: no owner, no parent, size, size of an element, address, shape, strides."""
    return 0, 0, array.size, array.itemsize, array.ctypes.data, *array.shape, *array.strides
