"""Shock FMUs of other makers are force laws: units, signs, names, and with or without ramps and states."""

import math
import subprocess
from pathlib import Path

import numpy as np
import pytest

from cosim import ExtrapolatedForce, ForceLaw, HeldForce
from eightpost.archive import extract_archive
from eightpost.compilers import find_compiler
from eightpost.errors import FmuError, StepError

from . import version_2

SOURCE = Path(__file__).with_name("foreign_shock.c")
PORTS = {"velocity": ("piston.speed", -1.0), "displacement": ("piston.travel", -1.0), "force": ("rod.force", -1.0)}

#: The constants of foreign_shock.c in SI: N.s/m, N.s/m, N/m, s.
C1, C2, K, TAU = 2000.0, 1000.0, 1e4, 0.004

VARIABLES = (
    ("piston.speed", 11, "input", 'Real unit="mm/s" start="0"'),
    ("piston.travel", 12, "input", 'Real unit="mm" start="0"'),
    ("rod.force", 40, "output", 'Real unit="kN"', "1 2"),
)
RAMPS, STATES, ANY_STEP = (
    'canInterpolateInputs="true"',
    'canGetAndSetFMUstate="true"',
    'canHandleVariableCommunicationStepSize="true"',
)


@pytest.fixture(scope="module")
def shock(foreign_compiler, tmp_path_factory):
    """Write the FMU with the given flags: shock(RAMPS, STATES)."""
    folder = tmp_path_factory.mktemp("shocks")

    def write(*flags):
        missing = [f"-D{name}" for name, flag in (("NO_SLOPES", RAMPS), ("NO_STATE", STATES)) if flag not in flags]
        key = "".join("x" if flag in flags else "o" for flag in (RAMPS, STATES, ANY_STEP))
        path = folder / f"{key}.fmu"
        if not path.exists():
            library = foreign_compiler(folder / f"{key}.so", *missing, source=SOURCE)
            version_2.write(path, library, "shock", VARIABLES, guid=f"{{shock {key}}}", flags=" ".join(flags))
        return path

    return write


def exact(x, start, end, h):
    """Lagged part after a ramp of velocity."""
    decay = math.exp(-h / TAU)
    return x * decay + C1 * start * (1.0 - decay) + C1 * (end - start) * (1.0 - (1.0 - decay) * TAU / h)


def test_units_signs_and_names_are_converted_and_ramps_are_exact(shock):
    with ForceLaw(shock(RAMPS, STATES, ANY_STEP), ports=PORTS) as law:
        assert law.start(0.0, 0.2, 0.01) == pytest.approx((C1 + C2) * 0.2 + K * 0.01, rel=1e-12)
        lagged = exact(C1 * 0.2, 0.2, -0.1, 2e-3)
        assert law.accept(2e-3, -0.1, 0.02) == pytest.approx(lagged - C2 * 0.1 + K * 0.02, rel=1e-10)
        again = exact(lagged, -0.1, 0.3, 1e-3)
        assert law.force(3e-3, 0.3, 0.0) == pytest.approx(again + C2 * 0.3, rel=1e-10)
        by_velocity, by_displacement = law.jacobian(3e-3, 0.3, 0.0)
        decay = math.exp(-1e-3 / TAU)
        assert by_velocity == pytest.approx(C2 + C1 * (1.0 - (1.0 - decay) * TAU / 1e-3), rel=1e-6)
        assert by_displacement == pytest.approx(K, rel=1e-6)


def test_without_input_derivatives_the_state_is_of_second_order_and_the_direct_part_is_exact(shock):
    """The error of one step from held inputs falls eight times when the step is halved."""
    missed = []
    with ForceLaw(shock(STATES, ANY_STEP), ports=PORTS) as law:
        for h in (2e-3, 1e-3):
            law.start(0.0, 0.2)
            lagged = exact(C1 * 0.2, 0.2, 0.2 + 40.0 * h, h)
            missed.append(law.force(h, 0.2 + 40.0 * h) - lagged - C2 * (0.2 + 40.0 * h))
    assert abs(missed[0]) < 3.0  # N, of 900 N
    assert 6.5 < missed[0] / missed[1] < 9.5


def test_without_a_displacement_input_the_displacement_is_ignored(shock):
    with ForceLaw(shock(RAMPS, STATES, ANY_STEP), ports=PORTS | {"displacement": None}) as law:
        law.start(0.0, 0.2, 0.05)
        assert law.force(1e-3, 0.2, 0.05) == pytest.approx((C1 + C2) * 0.2, rel=1e-12)
        assert law.jacobian(1e-3, 0.2, 0.05)[1] == 0.0


def test_an_fmu_without_states_is_refused_with_the_loops_that_it_can_run(shock):
    with pytest.raises(FmuError, match=r"cannot save its state .*cosim\.HeldForce \(loop A\) or cosim\.Extrapolated"):
        ForceLaw(shock(RAMPS, ANY_STEP), ports=PORTS)


def test_an_fmu_with_fixed_steps_is_refused(shock):
    with pytest.raises(FmuError, match="fixed communication points only"):
        ForceLaw(shock(RAMPS, STATES), ports=PORTS)


@pytest.mark.parametrize("flags", [(), (RAMPS,), (RAMPS, STATES)])
def test_loop_a_needs_no_optional_ability(shock, flags):
    with HeldForce(shock(*flags), ports=PORTS) as loop:
        loop.start(0.0, 0.2)
        expected = C1 * 0.1 + (C1 * 0.2 - C1 * 0.1) * math.exp(-1e-3 / TAU) + C2 * 0.1
        assert loop.step(0.0, 1e-3, 0.1) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("flags", "tolerance"), [((RAMPS, ANY_STEP), 1e-10), ((ANY_STEP,), 3e-3)])
def test_loop_b_needs_no_states(shock, flags, tolerance):
    with ExtrapolatedForce(shock(*flags), ports=PORTS, corners=("left", "right")) as loop:
        first = loop.start(0.0, [0.2, 0.1])
        loop.step(0.0, 1e-3, [0.2, 0.1])
        second = exact(C1 * 0.2, 0.2, 0.3, 1e-3) + C2 * 0.3
        found = loop.step(1e-3, 1e-3, [0.3, 0.1])
        np.testing.assert_allclose(found, [1.5 * second - 0.5 * first[0], first[1]], rtol=tolerance)


def test_a_refused_step_has_the_fmus_message_and_the_next_evaluation_works(shock):
    with ForceLaw(shock(RAMPS, STATES, ANY_STEP), ports=PORTS, corners=("left", "right")) as law:
        law.start(0.0, 0.2)
        expected = law.force(1e-3, 0.1)
        with pytest.raises(StepError, match=r"'right' .*failed to step.*the piston is too fast.*piston\.speed = -6000"):
            law.force(1e-3, [0.1, 6.0])
        np.testing.assert_array_equal(law.force(1e-3, 0.1), expected)


PROGRAM = """
#include "force_law.h"
int main(int count, char **arguments)
{
    ForceLaw law;
    double force, damping, stiffness;
    if (count < 2 || force_law_open(&law, arguments[1], "piston.speed", "piston.travel", "rod.force") != 0) {
        return 1;
    }
    law.scale[0] = law.scale[1] = -1000.0;
    law.scale[2] = -0.001;
    int failed = force_law_start(&law, 0.0, 0.2, 0.01, &force) != 0;
    failed |= force_law_accept(&law, 0.002, -0.1, 0.02, &force) != 0;
    failed |= force_law_jacobian(&law, 0.003, 0.3, 0.0, &damping, &stiffness) != 0;
    failed |= force_law_force(&law, 0.003, 0.3, 0.0, &force) != 0;
    printf("%.17g %.17g %.17g\\n%s\\n", force, damping, stiffness, failed ? law.error : "fine");
    force_law_close(&law);
    return 0;
}
"""


@pytest.fixture(scope="module")
def c_program(tmp_path_factory):
    """Compile a program that uses examples/hosts/force_law.h with the units and signs of the FMU."""
    folder, header = tmp_path_factory.mktemp("program"), Path(__file__).parents[3] / "examples" / "hosts"
    (folder / "program.c").write_text(PROGRAM)
    try:
        compiler = find_compiler()
    except FmuError:
        pytest.skip("there is no C compiler here")
    line = [*compiler, "-I", str(header), str(folder / "program.c"), "-o", str(folder / "program"), "-lm", "-ldl"]
    subprocess.run(line, check=True)
    return folder / "program"


@pytest.mark.parametrize("flags", [(RAMPS, STATES, ANY_STEP), (STATES, ANY_STEP)])
def test_the_header_for_c_gives_the_same_forces(shock, c_program, tmp_path, flags):
    path = shock(*flags)
    extract_archive(path, tmp_path / "unpacked")
    ran = subprocess.run([c_program, tmp_path / "unpacked"], capture_output=True, text=True, check=True)
    numbers, end = ran.stdout.splitlines()
    with ForceLaw(path, ports=PORTS) as law:
        law.start(0.0, 0.2, 0.01)
        law.accept(2e-3, -0.1, 0.02)
        expected = [law.force(3e-3, 0.3, 0.0), *law.jacobian(3e-3, 0.3, 0.0)]
    assert end == "fine"
    np.testing.assert_allclose([float(x) for x in numbers.split()], expected, rtol=1e-8)


def test_the_header_for_c_refuses_trial_points_without_states(shock, c_program, tmp_path):
    extract_archive(shock(RAMPS, ANY_STEP), tmp_path / "unpacked")
    ran = subprocess.run([c_program, tmp_path / "unpacked"], capture_output=True, text=True, check=True)
    assert "cannot save its state (canGetAndSetFMUstate is false); use force_law_hold" in ran.stdout
