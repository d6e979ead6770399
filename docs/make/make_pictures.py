"""Create the pictures of README and docs/ from the included synthetic data: python docs/make/make_pictures.py."""

from pathlib import Path

from eightpost.ident import fit_shock, plot_force_velocity
from eightpost.rig import read_dyno_test

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    """Fit three laws to record A and draw them."""
    test = read_dyno_test(ROOT / "examples" / "data" / "dyno_A.csv")
    laws = ("polylinear", "lpnl2", "hysteresis")
    fits = [fit_shock(test, law, gas="included", name="build A (synthetic)") for law in laws]
    plot_force_velocity(fits, ROOT / "docs" / "pictures" / "fit.png")


if __name__ == "__main__":
    main()
