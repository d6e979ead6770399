"""Fits of shocks, simulation of their force, identification of vehicles, and FMUs of both."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast, overload

from eightpost.api.reading import a, channel_map_of, check_options, existing, existing_toml
from eightpost.errors import InputError, check_number

if TYPE_CHECKING:
    import pandas as pd

    from builder.build import Built
    from eightpost.api.reading import ColumnMap
    from eightpost.ident import ShockFit
    from eightpost.ident.preparation import Preparation
    from eightpost.ident.shock.force import GasTreatment
    from eightpost.ident.shock.law_fit import LawName, RecipeName
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.least_squares import Robust
    from eightpost.progress import Progress
    from eightpost.rig import DynoTest, RigTest
    from eightpost.shock import Shock, ShockLaw
    from eightpost.signals import ChannelMap, TimeSeries
    from eightpost.vehicle import IdentifiedVehicle

    Columns: TypeAlias = Mapping[str, Any] | pd.DataFrame
    Test: TypeAlias = str | Path | DynoTest | Columns
    Tests: TypeAlias = Test | Sequence[Test]
    Source: TypeAlias = str | Path | Shock | ShockFit | VehicleFit | IdentifiedVehicle


# ---- Shocks ---------------------------------------------------------------------------------------------------------


def fit(
    tests: Tests,
    law: LawName | None = None,
    *,
    gas: GasTreatment = "estimate",
    channel_map: ColumnMap = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
    name: str | None = None,
    recipe: RecipeName = "joint",
    robust: Robust = "auto",
    segment: tuple[float, float] | None = None,
    cutoff: float | None = None,
    progress: Progress | None = None,
) -> ShockFit:
    """Fit a shock law to dynamometer tests.

    Args:
        tests: A test, its file, or its columns as a pandas DataFrame or a mapping, with units in their names such as
            "Force [lbf]"; or several of one shock, which are fitted together.
        law: Name of the law; default `hysteresis`, with `boggs` `lpnl2`.
        gas: Treatment of the gas force: `estimate`, `included` (the static load of the car counts it) or `subtracted`.
        channel_map: Columns by channel for files and columns with other names, as in `read`; {"bridge": "20"} replaces
            up to 20 samples in a row that are NaN or empty by a straight line.
        units: Units by channel or column, for columns without a unit in their name.
        flip: Channels whose sign is changed.
        name: Name of the shock; default: the build, else the name of the file.
        recipe: `joint` or `boggs`.
        robust: Weighting of outliers: `auto`, `none`, `huber` or `tukey`.
        segment: Start and end of the fitted part of each record [s].
        cutoff: Cut-off frequency of the low-pass [Hz].
        progress: Callback that receives the amount of work done and the total.

    Returns:
        The fit: `.shock`, `.verdict`, `.predict(record)`, `.score(record)`, `.parameter(name)`, `.to_pandas()`
        (parameters), `.plot()`, `.write(path)`.

    Raises:
        ParameterError: The law or an option is unknown, or does not suit the record.
        InputError: There is no test.
        DataError: A record has a fault.

    Example:
        >>> fit = ep.fit("dyno.csv", "lpf1", gas="included")
        >>> fit.plot()
        >>> fit.write("shock.json")
        >>> ep.fit(pd.DataFrame({"time [s]": t, "velocity [mm/s]": v, "force [N]": force}))
    """
    from eightpost.ident import fit_shock
    from eightpost.progress import reported_to
    from eightpost.shock.laws import named_law

    check_number("cutoff", cutoff, "Hz")
    _check_segment(segment)
    check_options(units, flip)
    law = None if law is None else named_law(law)
    given = tests if isinstance(tests, Sequence) and not isinstance(tests, str) else [tests]
    if not given:
        raise InputError("fit needs at least one dynamometer test; the list is empty")
    reading = {"channel_map": channel_map_of(channel_map), "units": units, "flip": flip}
    with reported_to(progress):
        return fit_shock(
            [test for one in given for test in _tests(one, reading)],
            law,
            recipe=recipe,
            gas=gas,
            robust=robust,
            name=name,
            segment=segment,
            cutoff=cutoff,
        )


def _check_segment(segment: object) -> None:
    if segment is None:
        return
    if isinstance(segment, str) or not isinstance(segment, Sequence) or len(segment) != 2:
        raise InputError(f"segment is {segment!r}; give its start and end in seconds, such as (1.0, 10.0)")
    for name, time in zip(("start", "end"), segment, strict=True):
        check_number(f"the {name} of segment", time, "s")


def _tests(given: Test, reading: Mapping[str, Any]) -> Sequence[DynoTest]:
    from eightpost.rig import DynoTest, dyno_test_of, read_dyno_tests

    if isinstance(given, DynoTest):
        return (given,)
    if isinstance(given, str | Path):
        return read_dyno_tests(existing(given), **reading)
    if isinstance(given, Mapping):
        return (dyno_test_of(given, **reading),)
    if hasattr(given, "columns"):
        return (dyno_test_of({str(name): given[name] for name in given.columns}, **reading),)
    raise InputError(f"fit takes dynamometer tests and their files, not {a(given)}")


@overload
def simulate(model: Shock | ShockFit | ShockLaw, record: TimeSeries | DynoTest | RigTest) -> TimeSeries: ...
@overload
def simulate(
    model: VehicleFit | IdentifiedVehicle,
    record: TimeSeries | RigTest,
    shocks: Mapping[str, Shock | ShockFit | ShockLaw] | Shock | ShockFit | ShockLaw,
) -> TimeSeries: ...
def simulate(
    model: Shock | ShockFit | ShockLaw | VehicleFit | IdentifiedVehicle,
    record: TimeSeries | DynoTest | RigTest,
    shocks: Mapping[str, Shock | ShockFit | ShockLaw] | Shock | ShockFit | ShockLaw | None = None,
) -> TimeSeries:
    """Simulate a shock over a record, or an identified vehicle with shocks at its ports, without FMUs.

    Args:
        model: Shock, or identified vehicle.
        record: Record of the motion. A shock needs `velocity` [m/s], and `displacement` [m] if the gas spring counts; a
            vehicle needs its roads and loads without means.
        shocks: Shock of every port of the vehicle by its name ("lf"), or one for all.

    Returns:
        For a shock: the channel `force` [N]; for a vehicle: its outputs.

    Raises:
        MissingChannelError: The record lacks a channel.
        InputError: The model is neither, or a port of the vehicle has no shock.

    Example:
        >>> force = ep.simulate(ep.fit("dyno.csv"), ep.read("other.csv", "dyno"))["force"]
    """
    from eightpost.ident import ShockFit
    from eightpost.ident import simulate as force_of
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.shock import Shock, ShockLaw
    from eightpost.signals import TimeSeries
    from eightpost.vehicle import IdentifiedVehicle

    series = record if isinstance(record, TimeSeries) else getattr(record, "series", None)
    if not isinstance(series, TimeSeries):
        raise InputError(f"simulate takes a TimeSeries or a test as its record, not {a(record)}")
    if isinstance(model, Shock | ShockFit | ShockLaw):
        if shocks is not None:
            raise InputError("shocks belong to a vehicle, and the model is a shock; omit them")
        return TimeSeries.from_channels(series.time, {"force": ("N", force_of(_law(model), series))})
    if isinstance(model, VehicleFit | IdentifiedVehicle):
        return _with_shocks(model.vehicle if isinstance(model, VehicleFit) else model, series, shocks)
    raise InputError(f"simulate takes a shock or an identified vehicle, not {a(model)}")


def _with_shocks(vehicle: IdentifiedVehicle, series: TimeSeries, shocks: object) -> TimeSeries:
    from eightpost.ident.vehicle.simulation import closed_at_ports, ports_of

    ports = ports_of(vehicle.state_space)
    given = dict(shocks) if isinstance(shocks, Mapping) else dict.fromkeys(ports, shocks)
    if shocks is None or set(given) != set(ports):
        listed = ", ".join(port or "'' (the only port)" for port in ports)
        raise InputError(f"{vehicle.name} needs the shock of every port, and no other: shocks for {listed}")
    return closed_at_ports(vehicle, series, {port: _law(shock) for port, shock in given.items()})


def _law(shock: object) -> ShockLaw:
    from eightpost.ident import ShockFit
    from eightpost.shock import Shock, ShockLaw

    known = shock.shock if isinstance(shock, ShockFit) else shock
    law = known.law if isinstance(known, Shock) else known
    if not isinstance(law, ShockLaw):
        raise InputError(f"a shock must be a Shock, a fit of one or a law, not {a(shock)}; read its file with ep.read")
    return law


@overload
def build(  # type: ignore[overload-overlap]  # a text is a source, not a sequence of sources
    sources: Source,
    folder: str | Path,
    *,
    target: str = "native",
    fmi: str | int = "2",
    confidential: bool = False,
    temperature_input: bool = False,
    progress: Progress | None = None,
) -> Built: ...
@overload
def build(
    sources: Sequence[Source],
    folder: str | Path,
    *,
    target: str = "native",
    fmi: str | int = "2",
    confidential: bool = False,
    temperature_input: bool = False,
    progress: Progress | None = None,
) -> list[Built]: ...
def build(
    sources: Source | Sequence[Source],
    folder: str | Path,
    *,
    target: str = "native",
    fmi: str | int = "2",
    confidential: bool = False,
    temperature_input: bool = False,
    progress: Progress | None = None,
) -> Built | list[Built]:
    """Build FMUs of shocks and vehicles.

    Args:
        sources: Shock or vehicle, as an object or as its file (.json, .toml), or several of them. The file of an object
            is written to `folder` under its name.
        folder: Folder of the FMUs, each named after its source.
        target: `native`, `python` or `all`.
        fmi: FMI version: `2`, `3` or `all`.
        confidential: Whether to leave out the sources and the static curve.
        temperature_input: Whether the temperature of shocks that were fitted over it is an input.
        progress: Callback that receives the number of compiled binaries and the total number.

    Returns:
        The FMU (its file is `.path`) of one source with one target and version, otherwise a list of FMUs.

    Raises:
        FmuError: A source cannot become an FMU, or there is no compiler.
        InputError: A source cannot be read.

    Example:
        >>> shock, car = ep.build([fit, "car.toml"], "fmus")
        >>> shock.path
    """
    from builder.build import build as build_fmus
    from builder.reference import Disclosure

    several = isinstance(sources, Sequence) and not isinstance(sources, str)
    if several and not sources:
        raise InputError("build needs at least one shock or vehicle; the list is empty")
    given = cast("Sequence[Source]", sources if several else [sources])
    built = build_fmus(
        [_source_file(source, Path(folder)) for source in given],
        folder,
        target=target,
        fmi=str(fmi),
        disclosure=Disclosure.CONFIDENTIAL if confidential else Disclosure.FULL,
        temperature_input=temperature_input,
        progress=progress,
    )
    return built if several or len(built) > 1 else built[0]


def _source_file(source: object, folder: Path) -> Path:
    """Return the file of a source; that of an object is written first."""
    from builder.build import fmu_identifier
    from eightpost.ident import ShockFit
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.shock import Shock, write_shock
    from eightpost.vehicle import IdentifiedVehicle, write_vehicle

    if isinstance(source, str | Path):
        return existing_toml(source, "vehicle")
    if isinstance(source, ShockFit | VehicleFit):
        return _source_file(source.shock if isinstance(source, ShockFit) else source.vehicle, folder)
    if not isinstance(source, Shock | IdentifiedVehicle):
        raise InputError(f"build takes shocks, identified vehicles and their files, not {a(source)}")
    path = folder / f"{fmu_identifier(source.name)}.json"
    if isinstance(source, Shock):
        write_shock(source, path)
    else:
        write_vehicle(path, source)
    return path


# ---- Vehicles -------------------------------------------------------------------------------------------------------


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
    shocks: Sequence[str | Path | Shock] = (),
    outputs: Sequence[str] = (),
    channel_map: ColumnMap = None,
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
        shocks: Shocks of the tests or their files; measured forces are brought in step with their laws.
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
    from eightpost.ident.vehicle.plan import recipe as recipe_of
    from eightpost.progress import portion, reported_to
    from eightpost.shock import Shock, read_shock

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
            prepared = prepare(_rig_tests(tests, mapped), how)
        plan = plan_identification(
            prepared,
            name=name,
            baseline=baseline,
            damping=damping,
            outputs=outputs,
            static=_rig_tests(static, mapped),
            shocks=[one if isinstance(one, Shock) else read_shock(existing(one)) for one in shocks],
        )
        with portion(0.15, 1.0):
            return plan.identify(recipe)


def _rig_tests(given: Sequence[str | Path | RigTest], channel_map: ChannelMap | None) -> Iterator[RigTest]:
    """Yield tests; files are read one by one, because a whole car's test takes much memory."""
    from eightpost.progress import parts
    from eightpost.rig import RigTest, read_rig_test

    for one in given:
        if isinstance(one, str | Path):
            existing(one)
        elif not isinstance(one, RigTest):
            raise InputError(f"identify takes rig tests and their files, not {a(one)}")
    for one in parts(given):
        yield one if isinstance(one, RigTest) else read_rig_test(one, channel_map=channel_map)
