"""Run shocks with any numbers in lanes with sanitizers; a finding ends this process."""

import sys
from collections.abc import Iterator

import numpy as np

from eightpost.machine import LAWS, SIGNALS, Batch, Drive, LinearCar, Port, Quantity, Run, ShockData, Vehicle, car

#: A mass on a spring: states are travel and velocity, inputs the force and the road's velocity.
CAR = Vehicle(
    np.array([[0.0, 1.0], [-400.0, -1.0]]),
    np.array([[0.0, 1.0], [-0.02, 0.0]]),
    np.array([[0.0, 1.0], [1.0, 0.0]]),
    np.array([[0.0, 1.0], [0.0, 0.0]]),
    np.zeros(2),
    at_rest=True,
)

ODD = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, 5e-324, 0.0, -0.0, -1.0, 1.0)


def any_numbers(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return numbers of any size, one in eight an odd one."""
    numbers = rng.uniform(-1.0, 1.0, count) * 10.0 ** rng.uniform(-6.0, rng.choice([4.0, 300.0]), count)
    return np.where(rng.random(count) < 0.125, rng.choice(ODD, count), numbers)


def shocks(rng: np.random.Generator) -> Iterator[ShockData]:
    """Yield shocks of every law with plausible numbers, some of which are then any numbers."""
    while True:
        values = {"curve.knot_velocity": np.sort(rng.uniform(-2.0, 2.0, 25)), "time_constant": [1e-3] * 3}
        numbers = ShockData.of(
            rng.choice(list(LAWS)),
            lambda name, count, values=values: list(values.get(name, rng.uniform(0.5, 1.5, count))[:count]),
        )
        changed, places = numbers.parameters.copy(), rng.integers(0, numbers.parameters.size, rng.integers(0, 6))
        changed[places] = any_numbers(rng, places.size)
        yield ShockData(numbers.law, changed)


def runs(rng: np.random.Generator) -> Iterator[Batch]:
    """Yield batches on drives of any numbers, with and without friction at the port."""
    times = np.arange(65) * 10.0 ** rng.uniform(-5.0, -1.0)
    channels = {"velocity": (-1, 0)} | {name: (0, k) for k, name in enumerate(SIGNALS)}
    quantities = [Quantity(("velocity", name), (1.0, 1.0), (3, 60), product=True, limits=True) for name in SIGNALS]
    while True:
        rubbing = Port(0, 0, 1, (40.0, 0.01, 60.0, 1e-4, 1.2, 0.01, float(rng.choice([0.0, 1e5]))))
        port = rubbing if rng.random() < 0.5 else Port(0, 0, 1)
        inputs = np.stack([np.zeros(65), rng.uniform(-1.0, 1.0, 65)], axis=1)
        if rng.random() < 0.5:
            inputs[rng.integers(0, 65, 3), 1] = any_numbers(rng, 3)
        car = LinearCar.of(CAR, [port], np.array([60.0]))
        drive, single = Drive(times, 1, times, inputs), bool(rng.random() < 0.5)
        yield Batch(Run(car, drive, channels, quantities=quantities, series=tuple(channels), single=single))


def main() -> None:
    """Run as many batches as the first argument says, with the compiler options that follow."""
    car._FLAGS = ("-std=gnu11", "-O1", "-g", "-w", "-shared", "-fPIC", "-fvisibility=hidden", *sys.argv[2:])
    rng = np.random.default_rng(1)
    given, ended = shocks(rng), 0
    with np.errstate(all="ignore"):
        for call, batch in zip(range(int(sys.argv[1])), (b for each in runs(rng) for b in [each] * 50), strict=False):
            found = batch.run([[next(given)] for _ in range(batch.lanes)])
            ended += int((found.ended >= 0).sum())
            assert found.ended.max() <= 64, call
    print(f"no finding, {ended} setups ended")


if __name__ == "__main__":
    main()
