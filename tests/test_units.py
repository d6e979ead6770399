"""Units of vehicle dynamics are converted by their definitions."""

import subprocess
import sys

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from eightpost import units
from eightpost.__main__ import main
from eightpost.errors import InputError, UnknownUnitError

#: Definitions: the inch, the pound and standard gravity are exact.
INCH, POUND, GRAVITY = 0.0254, 0.45359237, 9.80665


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("in", "m", INCH), ("in/s", "m/s", INCH), ("ips", "m/s", INCH), ("mm/s", "m/s", 1e-3), ("kN", "N", 1e3),
        ("lb", "N", POUND * GRAVITY), ("lbs", "N", POUND * GRAVITY), ("lbf", "N", POUND * GRAVITY),
        ("lbm", "kg", POUND), ("lbf/in", "N/m", POUND * GRAVITY / INCH),
        ("lbf/(in/s)", "N.s/m", POUND * GRAVITY / INCH),
        ("lbf.s/in", "N.s/m", POUND * GRAVITY / INCH), ("lbm.in2", "kg.m2", POUND * INCH**2), ("g", "m/s2", GRAVITY),
        ("deg", "rad", 3.141592653589793 / 180), ("ms", "s", 1e-3), ("psi", "Pa", POUND * GRAVITY / INCH**2),
        ("lbf.in", "N.m", POUND * GRAVITY * INCH),
        ("Nm", "N.m", 1.0), ("Hz", "Hz", 1.0), ("1", "1", 1.0), ("clicks", "1", 1.0),
    ],
)  # fmt: skip
def test_a_unit_of_the_field_has_its_si_unit_and_factor(unit, si, factor):
    assert units.si_unit(unit) == si
    assert units.conversion(unit, si) == (pytest.approx(factor, rel=1e-12), 0.0)


# Only units of the table: pint rounds a conversion differently after it has computed another one.
@pytest.mark.parametrize("si", [si for si, shown in units.DISPLAY_UNITS.items() if {si, *shown} <= set(units.COMMON)])
def test_display_units_have_the_dimension_of_their_si_unit(si):
    assert all(units.compatible(si, shown) for shown in units.DISPLAY_UNITS[si])
    assert units.conversion(si, units.us_customary(si))[1] == 0.0  # RMS values and differences are shown in it


def test_temperatures_have_an_offset():
    assert units.convert(110.0, "degF", "K") == pytest.approx(316.483333, abs=1e-6)
    assert units.convert(25.0, "C", "K") == pytest.approx(298.15)


@given(st.floats(-1e6, 1e6), st.sampled_from([("lbf", "N"), ("in/s", "mm/s"), ("degF", "degC")]))
def test_a_conversion_undoes_itself(value, pair):
    there, back = pair
    assert units.convert(units.convert(value, there, back), back, there) == pytest.approx(value, rel=1e-9, abs=1e-6)


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("N", {"kg": 1, "m": 1, "s": -2}), ("m/s2", {"m": 1, "s": -2}), ("N.m", {"kg": 1, "m": 2, "s": -2}),
        ("N.s/m", {"kg": 1, "s": -1}), ("rad", {"rad": 1}), ("1", {}), ("W", {"kg": 1, "m": 2, "s": -3}),
    ],
)  # fmt: skip
def test_si_exponents_are_those_of_the_base_units(unit, exponents):
    assert units.si_exponents(unit) == exponents


@pytest.mark.parametrize("unit", ["furlong/fortnit", "velocity", "x", "N/", "m//s"])
def test_an_unknown_unit_is_refused_with_examples(unit):
    with pytest.raises(UnknownUnitError, match="examples of units"):
        units.si_unit(unit)


def test_other_dimensions_are_refused():
    with pytest.raises(UnknownUnitError, match="dimensions differ"):
        units.convert(1.0, "N", "m")


@pytest.mark.parametrize(
    ("text", "value"), [("70 in", (70.0, "in")), ("1.5e6 lbm.in2", (1.5e6, "lbm.in2")), ("150psi", (150.0, "psi"))]
)
def test_a_quantity_is_a_value_with_its_unit(text, value):
    assert units.quantity(text) == value


@pytest.mark.parametrize("text", ["in", "seventy in", "70 sideways", "", "30"])
def test_an_invalid_quantity_is_refused(text):
    with pytest.raises(UnknownUnitError):
        units.quantity(text)


def test_a_unit_with_an_unsupported_dimension_is_refused():
    with pytest.raises(UnknownUnitError, match="is not supported"):
        units.si_unit("count")


def test_common_units_are_converted_without_pint_by_a_table_that_agrees_with_it():
    """To the last bit, in a process of its own: the last bits of pint depend on what it has converted before.

    `python -m eightpost.units` writes the table again.
    """
    words = "convert(1.0, 'lbf.s/in', 'N.s/m'); si_unit('in/s'); si_factor('g'); assert 'pint' not in sys.modules"
    program = f"import sys; from eightpost.units import *; from eightpost import units; {words}"
    program += "; assert units.read_table() == units._make_table() and 'pint' in sys.modules"
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.fixture
def choice(tmp_path, monkeypatch):
    """Path of the user's choice, which is not that of the developer."""
    monkeypatch.delenv(units.CHOICE)
    monkeypatch.setattr(units, "choice_path", lambda: tmp_path / "user" / "units")
    return tmp_path / "user" / "units"


@pytest.mark.parametrize(
    ("environment", "file", "columns", "system"),
    [
        (None, None, (), "us"),
        (None, None, ("s", "mm", "N"), "si"),
        (None, None, ("s", None, "lbf"), "us"),
        (None, "si", ("in", "lbf"), "si"),
        ("us", "si", ("mm", "N"), "us"),
        ("file", "us", ("mm", "N"), "si"),
    ],
)
def test_results_are_in_the_users_units_or_else_in_those_of_the_file(
    choice, monkeypatch, environment, file, columns, system
):
    if environment:
        monkeypatch.setenv(units.CHOICE, environment)
    if file:
        choice.parent.mkdir()
        choice.write_text(f"{file}\n")
    with units.following_files():
        units.note_file(columns)
        if columns:
            units.note_file(("V", "ft") if system == "si" else ("kN",))  # the first file decides
        assert units.shown_system() == system
        assert units.shown(4.4482216, "N") == ((4.4482216, "N") if system == "si" else (pytest.approx(1.0), "lbf"))


@pytest.mark.parametrize(
    ("system", "pressure", "heat"), [("us", "100 psi", "32 to 50 degF"), ("si", "6.89 bar", "0 to 10 degC")]
)
def test_a_range_is_in_the_units_of_the_user_and_a_single_value_stands_alone(system, pressure, heat, monkeypatch):
    monkeypatch.setenv(units.CHOICE, system)
    assert units.shown_range(689475.7, 689475.7, "Pa") == pressure
    assert units.shown_range(273.15, 283.15, "K") == heat


def test_a_study_or_system_file_counts_before_the_choice_and_after_the_environment(choice, monkeypatch):
    choice.parent.mkdir()
    choice.write_text("us\n")
    with units.following_files():
        units.state("si")
        assert units.shown_system() == "si"
        units.state("")  # a file that states none changes nothing
        assert units.shown_system() == "si"
        with units.stated_by("us"):
            assert units.shown_system() == "us"
        with units.stated_by(""):
            assert units.shown_system() == "si"
        monkeypatch.setenv(units.CHOICE, "us")
        assert units.shown_system() == "us"
        monkeypatch.delenv(units.CHOICE)
    assert units.shown_system() == "us"
    units.state("si")  # outside of a command a file states nothing
    assert units.shown_system() == "us"


def test_a_stated_display_unit_counts_unless_the_user_chose_a_system(choice, monkeypatch):
    assert units.shown_unit("m", "ft") == "ft" and units.shown_unit("m", "") == "m"
    monkeypatch.setenv(units.CHOICE, "si")
    assert units.shown_unit("m", "ft") == "mm"
    monkeypatch.setenv(units.CHOICE, "us")
    assert units.shown_unit("N", "kN") == "lbf"


@pytest.mark.parametrize(
    ("system", "shown", "difference"), [("us", 80.6, (18.0, "degF")), ("si", 27.0, (10.0, "degC"))]
)
def test_a_temperature_is_shown_in_degrees_and_a_difference_has_no_offset(
    system, shown, difference, choice, monkeypatch
):
    monkeypatch.setenv("EIGHTPOST_UNITS", system)
    value, unit = difference
    assert units.shown(300.15, "K") == (pytest.approx(shown), unit)
    assert units.display_unit("K") == "K"  # of a difference
    assert units.shown_difference(10.0) == (pytest.approx(value), unit)


def test_files_outside_of_a_command_decide_nothing(choice):
    units.note_file(("mm", "N"))
    assert units.shown_system() == "us"


def test_a_choice_that_is_no_system_is_refused(choice, monkeypatch):
    monkeypatch.setenv(units.CHOICE, "metric")
    with pytest.raises(InputError, match="states 'metric'; it must be one of us, si, file"):
        units.shown_system()


def test_the_command_stores_the_choice_and_states_it(choice):
    assert "units of results: file (nothing was chosen)" in CliRunner().invoke(main, ["units"]).output
    assert f"units of results: si ({choice})" in CliRunner().invoke(main, ["units", "SI"]).output
    assert choice.read_text() == "si\n" and units.shown_system() == "si"
