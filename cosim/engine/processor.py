"""Machine code for this processor: made from LLVM's intermediate code, and loaded."""

from __future__ import annotations

from functools import cache
from typing import Any

import llvmlite.binding as llvm

#: Name of the function in every object file.
_ENTRY = "cosim_engine_entry"

#: LLVM's engines, which own the loaded code.
_LOADED: list[Any] = []


def optimised(code: str, name: str) -> bytes:
    """Optimise intermediate code as a whole, and return an object file.

    Args:
        code: LLVM's intermediate code.
        name: Name of the entry function in the code.
    """
    module, machine = llvm.parse_assembly(code), _machine()
    for function in module.functions:
        if function.name != name and not function.is_declaration:
            function.linkage = "internal"
    module.get_function(name).name = _ENTRY
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = True
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    content: bytes = machine.emit_object(module)
    return content


def loaded(content: bytes) -> int:
    """Load an object file of `optimised`; return the function's address."""
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    _LOADED.append(engine)
    address: int = engine.get_function_address(_ENTRY)
    return address


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
