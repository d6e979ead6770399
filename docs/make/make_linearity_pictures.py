"""Create the pictures of docs/explanation/linearity.md and print its figures; the data are SYNTHETIC."""

from collections.abc import Iterator
from pathlib import Path

from eightpost.ident.linearity import Condition, Linearity, judge_linearity
from eightpost.ident.linearity_plots import plot_conditions, plot_output
from eightpost.ident.preparation import prepare
from eightpost.rig import RigTest
from eightpost.units import convert
from eightpost.virtual import Car, LinearDamper, random_drive, run_test, stand_in_truth

ROOT = Path(__file__).resolve().parents[2]
#: Baseline and alternate shock of 6.1.4.
BASELINE, ALTERNATE = (LinearDamper(convert(rate, "lbf.s/in", "N.s/m")) for rate in (20.0, 9.0))
PEAKS = (0.4, 0.1)
OUTPUTS = ("rf.velocity", "lr.velocity", "rf.tire_force", "lr.tire_force", "front.ride_height", "rear.ride_height")


def singles(car: Car, peak: float, names: tuple[str, ...]) -> Iterator[RigTest]:
    """Yield tests with one actuator at a time, 100 s each; wheelloaders with a peak [in]."""
    for number, name in enumerate(names):
        drive = random_drive(car, 100 + number, duration=100.0, active=(name,), road_peak=convert(peak, "in", "m"))
        yield run_test(car, drive, (BASELINE,) * 4, seed=number)


def shocks(car: Car) -> Iterator[RigTest]:
    """Yield a baseline test with all actuators, and tests with an alternate shock at each corner on the same drive."""
    drive = random_drive(car, 7, duration=100.0)
    yield run_test(car, drive, (BASELINE,) * 4, seed=20)
    for corner in range(4):
        fitted = [ALTERNATE if place == corner else BASELINE for place in range(4)]
        yield run_test(car, drive, fitted, seed=21 + corner)


def tests(car: Car) -> Iterator[RigTest]:
    """Yield all tests of 6.2."""
    yield from singles(car, PEAKS[0], car.inputs)
    yield from shocks(car)


def print_counts(title: str, found: Linearity) -> None:
    """Print the counts of Table 6.4's conditions and the effects of the amplitude."""
    counts = {kind.name: sum(each.condition is kind for each in found.verdicts) for kind in Condition}
    print(title, counts)
    lowest = sorted(found.verdicts, key=lambda each: each.coherence)[:6]
    for each in lowest:
        lost = 100.0 * each.shares[Condition.III]
        values = f"{each.condition.name} {each.coherence:.3f} {each.level:.1f} dB"
        print(f"  {each.output} / {each.input}: {values}, III {lost:.2f} %")
    for effect in found.effects:
        print(
            f"  {effect.output} / {effect.input}: {100 * effect.change:.1f} % ({100 * effect.chance:.1f} % by chance)"
        )


def main() -> None:
    """Evaluate the linearity of the stand-in with and without friction."""
    for title, car in (("friction", stand_in_truth()), ("no friction", stand_in_truth().without_friction())):
        found = judge_linearity(prepare(tests(car)), outputs=OUTPUTS)
        print_counts(f"{title}, all inputs", found)
        if title == "friction":
            plot_conditions(found, ROOT / "docs" / "pictures" / "linearity.png")
            plot_output(found, "lr.velocity", ROOT / "docs" / "pictures" / "linearity_lr_velocity.png")
        roads = ("rf.road", "lr.road")
        sizes = prepare(test for peak in PEAKS for test in singles(car, peak, roads))
        near = judge_linearity(sizes, outputs=("rf.velocity", "lr.velocity", "rf.tire_force", "lr.tire_force"))
        print_counts(f"{title}, wheelloaders at {PEAKS[0]} and {PEAKS[1]} in", near)


if __name__ == "__main__":
    main()
