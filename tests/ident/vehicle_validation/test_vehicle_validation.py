"""Tests of the validation of vehicles: good and bad cars are recognised, for the right reason."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eightpost.corners import CORNERS
from eightpost.errors import MissingChannelError, ParameterError
from eightpost.ident.validation.comparison import StaticOutput
from eightpost.ident.validation.vehicle_page import write_vehicle_page
from eightpost.ident.validation.vehicles import Limits, validate_vehicle, vehicle_verdict
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.rig import RigTest
from eightpost.shock import Shock
from eightpost.uncertainty import MeasureUncertainty
from eightpost.vehicle import Friction, StateSpace, read_vehicle, shipped
from eightpost.verdict import Grade
from tests.drawn import figures_of, rows_of_page

from .conftest import COULOMB, INCH, fit_of, quarter_test, records_of, seven_test, truth_fit
from .test_page_parts import TRUST


@pytest.fixture(scope="module")
def good(corner: VehicleFit, setups: list[RigTest], others: list[RigTest]):  # type: ignore[no-untyped-def]
    return validate_vehicle(corner, records_of(corner, *setups, *others), against=read_vehicle(shipped("quarter_car")))


def test_every_record_is_recognised_by_what_drives_it(good) -> None:  # type: ignore[no-untyped-def]
    assert [case.record.kind for case in good.cases] == ["random"] * 4 + ["sine"] * 2 + ["bump"]
    assert [case.record.frequency for case in good.of_kind("sine")] == pytest.approx([6.0, 10.0], rel=0.01)


def test_the_exact_car_predicts_the_rig_within_noise(good) -> None:  # type: ignore[no-untyped-def]
    cases = good.of_kind("random")
    assert cases and all(case.judged for case in cases)
    for case in cases:
        for output in case.judged:
            # White noise of 1 % at 1250 Hz has 0.2 % below 20 Hz; the measured force has the same noise.
            assert abs(output.level) < 0.003, (case.record.name, output.name)
            assert output.error < 0.01, (case.record.name, output.name)


def test_the_page_of_a_validation_and_its_figures(good, tmp_path: Path, unchanged: Callable[..., None]) -> None:  # type: ignore[no-untyped-def]
    """One record has a result without friction, and another one is static."""
    first, *_, last = good.cases
    smooth = tuple(replace(one, predicted=0.9 * one.predicted) for one in first.outputs)
    load, levels = np.arange(-2.0, 3.0) * 100.0, np.array([-3.0, -1.0, 0.5, 1.0, 2.5])
    holds = tuple(StaticOutput(name, "N", load, levels, factor * levels) for name, factor in (("a", 1.1), ("b", 0.8)))
    static = replace(last, record=replace(last.record, kind="static", name="held"), holds=holds)
    vehicle = replace(good.fit.vehicle, friction={"": Friction(55.0, 0.004)})
    measures = {"velocity": MeasureUncertainty(0.01, 0.1), "tire_force": MeasureUncertainty(0.02, 0.05)}
    fit = replace(good.fit, vehicle=vehicle, trust=replace(TRUST, measures=measures))
    whole = replace(good, cases=(replace(first, without_friction=smooth), *good.cases[:0:-1], static), fit=fit)
    path = write_vehicle_page(tmp_path / "page.html", whole)
    unchanged(rows_of_page(path), "text", relative=1e-3)
    unchanged(figures_of(path), "figures", relative=1e-3)


@pytest.mark.parametrize("limits", [Limits(0.0005, 0.002), Limits(0.002, 0.004), Limits(rank=1.0)])
def test_reasons_within_tight_limits_are_kept(good, limits: Limits, unchanged: Callable[..., None]) -> None:  # type: ignore[no-untyped-def]
    """The car is not stable, was fitted to a record, and one record is gentle and goes beyond the fit."""
    first, second, *others = good.cases
    cases = (replace(first, is_fit_record=True), replace(second, is_gentle=True, extrapolations=("far",)), *others)
    study = replace(good, cases=cases, fit=replace(good.fit, stable=False))
    studies = {"whole": study, "sines": replace(good, cases=good.of_kind("sine"))}
    kept = {
        f"{name}: {one.rule}": f"{one.grade.name}; {one.figure}; {one.origin}"
        for name, one_study in studies.items()
        for one in vehicle_verdict(one_study, limits).reasons
    }
    unchanged({"limits": limits.summary(), **kept}, relative=1e-3)


def test_the_exact_car_is_usable(good) -> None:  # type: ignore[no-untyped-def]
    verdict = vehicle_verdict(good)
    assert verdict.is_acceptable, verdict.reasons
    (predicts,) = [reason for reason in verdict.reasons if reason.grade is Grade.USABLE]
    assert verdict.grade is Grade.USABLE
    assert verdict.reasons == (predicts,)
    assert "7 records" in predicts.figure
    assert "rank correlation of setups at least 1.00 over 4 records" in predicts.figure


def test_gain_and_phase_of_sines_are_those_of_the_rig(good) -> None:  # type: ignore[no-untyped-def]
    cases = good.of_kind("sine")
    assert cases and all(case.sines for case in cases)
    for case in cases:
        for found in case.sines:
            assert found.gain == pytest.approx(1.0, abs=0.01)
            assert abs(found.phase) < np.radians(0.5)


def test_modes_match_those_of_the_true_car(good) -> None:  # type: ignore[no-untyped-def]
    printed = ((3.041, 0.0610), (18.438, 0.4219))  # Table 4.2, "ideal"
    for mode, (frequency, damping) in zip(good.modes, printed, strict=True):
        assert mode.match == pytest.approx((frequency, damping), rel=1e-3)
        assert mode.mac == pytest.approx(1.0, abs=1e-9)


def test_the_95_percent_band_contains_the_true_response_95_percent_of_the_time(good) -> None:  # type: ignore[no-untyped-def]
    shares = [path.inside for path in good.paths]
    assert len(shares) == 6  # three outputs, from road and force
    assert np.mean(shares) == pytest.approx(0.95, abs=0.02)


@pytest.mark.nightly
def test_closed_ports_reproduce_the_virtual_rig(shocks: dict[str, Shock]) -> None:
    fit = truth_fit("seven_dof", ranges={})
    law = shocks["lpf1"].law
    test = seven_test((law,) * 4)
    study = validate_vehicle(fit, records_of(fit, test), shocks=dict.fromkeys(CORNERS, law))
    (case,) = study.cases
    assert case.shocks == "shock laws, ports closed"
    assert {one.name for one in case.judged} >= {"lf.velocity", "total_tire_force", "front.ride_height"}
    for one in case.judged:
        assert one.error < 0.02, one.name


def test_shocks_are_assigned_to_the_records_that_name_them(
    corner: VehicleFit, setups: list[RigTest], shocks: dict[str, Shock]
) -> None:
    study = validate_vehicle(corner, records_of(corner, *setups[:2]), shocks={"soft": shocks["lpf1"].law})
    assert [case.shocks for case in study.cases] == ["shock laws, ports closed", "measured shock forces"]
    assert "not every port has a law (the record's shocks are other)" in study.cases[1].notes[0]


def test_a_shock_with_an_unknown_name_is_rejected(
    corner: VehicleFit, setups: list[RigTest], shocks: dict[str, Shock]
) -> None:
    with pytest.raises(
        ParameterError, match="no corner and no record's shock is named 'rear'; the names are other, soft"
    ):
        validate_vehicle(corner, records_of(corner, *setups[:2]), shocks={"rear": shocks["lpf1"].law})


def test_a_record_of_another_car_is_rejected(corner: VehicleFit, setups: list[RigTest]) -> None:
    with pytest.raises(MissingChannelError, match=r"lf\.road.*is it a record of another car"):
        records_of(truth_fit("seven_dof"), setups[0])


def test_the_fits_own_records_do_not_validate_the_car(corner: VehicleFit, setups: list[RigTest]) -> None:
    own = replace(corner, vehicle=replace(corner.vehicle, sources={"run.csv": "abc"}))
    study = validate_vehicle(own, records_of(own, replace(setups[1], sha256="abc")))
    found = vehicle_verdict(study)
    assert found.grade is Grade.NOT_USABLE
    assert found.reasons[0].statement.startswith("no record validates the car")


@pytest.mark.nightly
def test_no_criterion_applies_to_a_record_on_which_friction_holds_the_car() -> None:
    fit = truth_fit("quarter_car")
    gentle = quarter_test(kind="sine", frequency=1.0, amplitude=0.02 * INCH, friction=COULOMB)
    study = validate_vehicle(fit, records_of(fit, gentle, quarter_test()))
    assert [case.is_gentle for case in study.cases] == [True, False]
    found = vehicle_verdict(study)
    assert found.is_acceptable
    assert any("barely move" in reason.statement and reason.origin == "r1" for reason in found.reasons)


@pytest.mark.nightly
def test_a_record_beyond_the_fits_tests_is_reported_and_limits_the_verdict(
    corner: VehicleFit, setups: list[RigTest]
) -> None:
    small = replace(corner, ranges={"frequency": (0.1, 20.0), "velocity": (-0.1, 0.1)})
    study = validate_vehicle(small, records_of(small, *setups[:1]))
    assert any("amplitudes beyond the fit's tests: velocity" in text for text in study.cases[0].extrapolations)
    assert vehicle_verdict(study).grade is Grade.LIMITED


@pytest.mark.slow
def test_a_car_that_ranks_setups_differently_is_not_usable(corner: VehicleFit, setups: list[RigTest]) -> None:
    # With the sign of the shock force inverted, more damping acts like less.
    model = corner.vehicle.state_space
    turned = model.B.copy()
    turned[:, model.input_names.index("force")] *= -1.0
    fit = fit_of(
        replace(corner.vehicle, state_space=StateSpace(model.A, turned, model.C, model.D, model.inputs, model.outputs))
    )
    study = validate_vehicle(fit, records_of(fit, *setups))
    assert any("ranks setups differently" in reason.statement for reason in vehicle_verdict(study).reasons)


@pytest.mark.parametrize("limits", [{"level": 0.0}, {"error": -1.0}, {"rank": 2.0}])
def test_meaningless_limits_are_rejected(limits: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match="must be above 0"):
        Limits(**limits)
