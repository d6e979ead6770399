"""Probes on constructed FMUs: what one does wrong with a freed state is named; only fixed parameters are locked."""

import ctypes
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from builder.check.probes.instances import _freed
from builder.check.probes.misuse import _locked

OK, WARNING, ERROR = 0, 1, 3
KEPT, NULL = "the pointer is not NULL after fmi2FreeFMUstate", "fmi2FreeFMUstate of NULL is rejected"


class Fmu:
    """An FMU that frees a state with a status, keeps the pointer or not, and frees NULL with a status."""

    def __init__(self, status, keeps, status_of_null):
        self.status, self.keeps, self.status_of_null = status, keeps, status_of_null

    def state(self):
        self.pointer = ctypes.c_void_p(1)
        return self.pointer

    def call(self, function, _, note=""):
        if self.pointer.value is None:
            return self.status_of_null
        self.pointer.value = 1 if self.keeps else None
        return self.status


@pytest.mark.parametrize(
    ("fmu", "messages"),
    [
        (Fmu(OK, False, OK), []),
        (Fmu(WARNING, False, WARNING), []),
        (Fmu(OK, True, OK), [KEPT]),
        (Fmu(ERROR, False, OK), [KEPT]),
        (Fmu(ERROR, True, OK), [KEPT]),
        (Fmu(OK, False, ERROR), [NULL]),
    ],
)
def test_a_state_must_be_freed_with_its_pointer_and_null_be_ignored(fmu, messages):
    bench = SimpleNamespace(running=lambda: nullcontext(fmu))
    assert list(_freed(bench)) == [("state-freed", message) for message in messages]


def test_setting_a_fixed_parameter_between_steps_is_tried_and_a_tunable_one_not():
    def parameters(_):
        return [SimpleNamespace(name=f"{v}_gain", variability=v, number=lambda _: 1.0) for v in ("tunable", "fixed")]

    bench = SimpleNamespace(
        description=SimpleNamespace(of=parameters), outputs=[SimpleNamespace(name="force")], running=None
    )
    titles = [misuse.title for misuse in _locked(bench)]
    assert titles == ["setting the fixed fixed_gain between steps", "setting the output force"]
