"""Choice between common-poles and grey-box by a left-out test."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from eightpost.corners import CORNERS
from eightpost.errors import StepError
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.fit_validity import with_validity
from eightpost.ident.vehicle.held_out import HeldOutError
from eightpost.ident.vehicle.recipe_choice import RecipeChoice, RecipeTrial
from eightpost.ident.vehicle.recipes import auto, recipe
from eightpost.ident.vehicle.recipes.auto import Auto
from eightpost.ident.vehicle.recipes.common_poles import CommonPoles
from eightpost.ident.vehicle.vehicle_fit import VehicleFit, read_fit, write_fit
from eightpost.ident.vehicle.verdict import CHOSEN
from eightpost.signals import TimeSeries
from tests.ident.friction.conftest import BASELINE, rig_tests

if TYPE_CHECKING:
    from collections.abc import Mapping

CAR = Experiment("car", tuple(f"{c}.road" for c in CORNERS), tuple(f"{c}.force" for c in CORNERS),
                 tuple(f"{c}.velocity" for c in CORNERS), dict.fromkeys(CORNERS, 3000.0))  # fmt: skip


@pytest.fixture(scope="module")
def quarter() -> VehicleFit:
    """Return a fit of a quarter car by auto, which can only use common-poles."""
    tests = rig_tests(0.0, 20)
    experiment = Experiment("corner", ("road", "aero_force"), ("force",), ("velocity", "tire_force"), {"": BASELINE})
    return Auto(CommonPoles(samples=0, friction=None, springs=None)).identify(tests, experiment)


def test_a_quarter_car_is_identified_with_common_poles_and_the_fit_says_why(quarter: VehicleFit) -> None:
    assert quarter.recipe == "common-poles"
    assert quarter.choice is not None
    assert "needs the corners" in quarter.notes[0]
    assert recipe("auto") == Auto()


@dataclass(frozen=True)
class Poles:
    """Recipe that returns a known vehicle, and counts nothing."""

    fit: VehicleFit

    def vehicle(self, _tests: object, _experiment: object) -> str:
        return "poles"

    def identify(self, _tests: object, _experiment: object) -> VehicleFit:
        return self.fit


@dataclass(frozen=True)
class Grey:
    """Recipe with the interface of the grey box; `values` must come back as the start of the final fit."""

    fit: VehicleFit
    error: str = ""

    def explain(
        self, tests: list[TimeSeries], _experiment: object, *, start: Mapping[str, float] | None = None
    ) -> Grey:
        if self.error:
            raise StepError(self.error)
        assert (start is None) is (len(tests) == 4)  # the trial leaves one test out
        return self

    @property
    def values(self) -> Mapping[str, float]:
        return {"mass": 1.0}

    def vehicle(self, _fit: object, _experiment: object) -> str:
        return "grey"

    def vehicle_fit(
        self, _fit: object, _tests: object, _experiment: object, _started: float, *, without_first: object
    ) -> VehicleFit:
        assert without_first is self  # the fit of the trial, which needs not be repeated
        return replace(self.fit, recipe="grey-box")


def chosen(fit: VehicleFit, errors: dict[str, float], monkeypatch: pytest.MonkeyPatch, failure: str = "") -> VehicleFit:
    def held_out(vehicle: str, tests: list[TimeSeries], _experiment: object, _band: object) -> HeldOutError:
        assert tests[0].name_of_test == "baseline"
        return HeldOutError({"v": errors[vehicle]}, {"v": 0.001})

    monkeypatch.setattr(auto, "held_out_error", held_out)
    monkeypatch.setattr(auto, "_first", lambda series, _seconds: series)
    quick = Auto(common_poles=CommonPoles(), grey_box=Grey(fit, failure))  # type: ignore[arg-type]
    monkeypatch.setattr(CommonPoles, "vehicle", Poles(fit).vehicle)
    monkeypatch.setattr(CommonPoles, "identify", lambda _self, *given: Poles(fit).identify(*given))
    tests = [Named(name) for name in ("baseline", *CORNERS)]
    return quick.identify(tests, CAR)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Named:
    """Test with a name."""

    name_of_test: str


@pytest.mark.parametrize(
    ("poles", "grey", "expected"),
    [(0.02, 0.01, "grey-box"), (0.02, 0.0199, "common-poles"), (0.01, 0.05, "common-poles")],
)
def test_the_smaller_error_on_the_baseline_decides_and_a_tie_is_common_poles(
    quarter: VehicleFit, poles: float, grey: float, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = chosen(quarter, {"poles": poles, "grey": grey}, monkeypatch)
    assert fit.recipe == expected
    assert fit.choice is not None
    assert fit.choice.recipe == expected
    assert f"{expected} was chosen" in fit.notes[0]
    assert [trial.error for trial in fit.choice.trials] == [poles, grey]


def test_a_grey_box_that_fails_is_named_with_its_message(quarter: VehicleFit, monkeypatch: pytest.MonkeyPatch) -> None:
    fit = chosen(quarter, {"poles": 0.5}, monkeypatch, failure="it diverged")
    assert fit.recipe == "common-poles"
    assert "grey-box failed (it diverged)" in fit.notes[0]


def test_the_choice_is_in_the_files_and_in_the_verdict_of_the_vehicle(quarter: VehicleFit, tmp_path: Path) -> None:
    trials = (RecipeTrial("common-poles", 0.02, 0.001), RecipeTrial("grey-box", 0.01, 0.002))
    choice = RecipeChoice(trials, "grey-box was chosen: it predicts the left-out test better", "grey-box")
    fit = with_validity(replace(quarter, choice=choice))
    write_fit(tmp_path / "corner.json", fit)
    again = read_fit(tmp_path / "corner.json")
    assert again.choice == choice
    assert again.vehicle.validity is not None
    reason = next(one for one in again.vehicle.validity.verdict.reasons if one.rule == CHOSEN.name)
    assert "grey-box 1 %" in reason.figure
