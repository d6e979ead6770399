"""Identification of vehicles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eightpost.api.arguments import a, channel_map_of, existing
from eightpost.errors import InputError, check_number

if TYPE_CHECKING:
    from eightpost.ident.preparation import Preparation
    from eightpost.ident.vehicle import VehicleFit
    from eightpost.progress import Progress
    from eightpost.rig.post import RigTest
    from eightpost.signals import ChannelMap


def identify(
    tests: Iterable[str | Path | RigTest],
    *,
    recipe: str = "common-poles",
    name: str = "vehicle",
    baseline: int | None = None,
    damping: float | None = None,
    rate: float = 125.0,
    settling: float = 0.0,
    preparation: Preparation | None = None,
    static: Sequence[str | Path | RigTest] = (),
    outputs: Sequence[str] = (),
    channel_map: ChannelMap | Mapping[str, str] | str | Path | None = None,
    progress: Progress | None = None,
) -> VehicleFit:
    """Identify a vehicle from rig tests: one with baseline shocks, one with another shock at each corner.

    Args:
        tests: Tests or their files.
        recipe: `common-poles`, `grey-box` or `boggs`.
        name: Name of the vehicle.
        baseline: Index of the baseline test in `tests`; default: found from the damping of the shocks.
        damping: Damping about which the vehicle is identified [N.s/m]; default: the slope of each baseline shock.
        rate: Sample rate to which the records are decimated [Hz].
        settling: Time left out at the start of every record [s].
        preparation: Settings that replace rate and settling.
        static: Tests with held loads, for static tire forces and ride heights.
        outputs: Outputs of the model; default: all possible ones.
        channel_map: Columns by channel, for files with other column names: a file, a ChannelMap, or a mapping.
        progress: Callback that receives the amount of work done and the total.

    Returns:
        The fit: `.vehicle`, `.verdict`, `.to_pandas()` (outputs), `.to_xarray()` (responses), `.plot(output)`,
        `.write(path)`.

    Raises:
        InputError: The tests do not separate the effects of the shocks.
        ParameterError: The recipe or an output is unknown.
        DataError: A record has a fault.

    Example:
        >>> car = ep.identify(sorted(Path("rig").glob("*.parquet")), name="car")
        >>> car.plot("lf.tire_force")
    """
    from eightpost.ident.preparation import Decimation, Preparation, prepare
    from eightpost.ident.vehicle.plan import plan_identification
    from eightpost.ident.vehicle.recipes import recipe as recipe_of
    from eightpost.progress import portion, reported_to

    for argument, value, unit in (("damping", damping, "N.s/m"), ("rate", rate, "Hz"), ("settling", settling, "s")):
        check_number(argument, value, unit)
    recipe_of(recipe)  # refuses an unknown one before the records are read
    if not isinstance(tests, Iterable):
        raise InputError(f"identify takes a list of rig tests and their files, not {a(tests)}")
    mapped = channel_map_of(channel_map)
    tests = tests if isinstance(tests, str | Path) else list(tests)
    if isinstance(tests, str | Path) or len(tests) < 2:
        raise InputError(
            "one rig test cannot separate shock forces from their causes; give a list with a baseline test, and a test "
            "with another shock at each corner"
        )
    if baseline is not None and not 0 <= baseline < len(tests):
        raise InputError(f"baseline is {baseline}, but the {len(tests)} tests have the indices 0 to {len(tests) - 1}")
    how = preparation or Preparation(Decimation(rate), settling=settling)
    with reported_to(progress):
        with portion(0.0, 0.15):
            prepared = prepare(_tests(tests, mapped), how)
        plan = plan_identification(
            prepared,
            name=name,
            baseline=baseline,
            damping=damping,
            outputs=outputs,
            static=_tests(static, mapped),
        )
        with portion(0.15, 1.0):
            return plan.identify(recipe)


def _tests(given: Sequence[str | Path | RigTest], channel_map: ChannelMap | None) -> Iterator[RigTest]:
    """Yield tests; files are read one by one, because a whole car's test takes much memory."""
    from eightpost.progress import parts
    from eightpost.rig.post import RigTest, read_rig_test

    for one in given:
        if isinstance(one, str | Path):
            existing(one)
        elif not isinstance(one, RigTest):
            raise InputError(f"identify takes rig tests and their files, not {a(one)}")
    for one in parts(given):
        yield one if isinstance(one, RigTest) else read_rig_test(one, channel_map=channel_map)
