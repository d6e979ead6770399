"""Reading of every kind of file that the project works with, and checks of the arguments of all functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args, overload

from eightpost.errors import EightpostError, FileFormatError, InputError, missing_file, suggestion
from eightpost.files import document_kind, toml_content

if TYPE_CHECKING:
    from cosim.session.result import SavedRun
    from cosim.session.run import Case
    from cosim.study import StudyResult
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.rig import DynoTest, PeakVelocityTable, RigTest
    from eightpost.shock import Shock
    from eightpost.signals import ChannelMap, Drivefile
    from eightpost.vehicle import Vehicle

    Readable: TypeAlias = (
        DynoTest
        | PeakVelocityTable
        | RigTest
        | Drivefile
        | Shock
        | Vehicle
        | VehicleFit
        | Case
        | StudyResult
        | SavedRun
    )
    #: Columns by channel: a channel map, its file, or the name of the column by channel.
    ColumnMap: TypeAlias = ChannelMap | Mapping[str, str] | str | Path | None


# ---- Checks of arguments, with messages for the person who wrote the call -------------------------------------------


def existing(path: str | Path) -> Path:
    """Return the path of a file or folder.

    Raises:
        InputError: It is not a path.
        FileFormatError: It does not exist; the message lists similar names in its folder.
    """
    if not isinstance(path, str | Path):
        raise InputError(f"a file is needed here, as a text or a Path, not {a(path)}")
    path = Path(path)
    if path.exists():
        return path
    raise FileFormatError(missing_file(path, f"the current folder is {Path.cwd()}"), path=path)


def toml_kind(path: Path) -> str:
    """Return what a TOML file defines: `system`, `study` or `vehicle`; an empty text for any other file.

    Raises:
        FileFormatError: It is not a TOML file.
    """
    content = toml_content(path)
    found = (
        kind for kind, key in (("study", "bank"), ("system", "components"), ("vehicle", "model")) if key in content
    )
    return next(found, "")


def is_system(path: Path) -> bool:
    """Return whether a file is a system of coupled FMUs: a system file or an SSP package."""
    suffix = path.suffix.lower()
    return suffix in (".ssp", ".ssd") or (suffix == ".toml" and path.is_file() and toml_kind(path) == "system")


#: What to do with the files of each kind.
_USES = {"system": "run it with run", "study": "run it with study", "vehicle": "make an FMU of it with build"}


def existing_toml(path: str | Path, kind: str) -> Path:
    """Return the path of a file, which may be of another format.

    Raises:
        FileFormatError: It does not exist, or is not a TOML file.
        InputError: It is a TOML file of another kind, or an FMU.
    """
    path = existing(path)
    if path.suffix.lower() == ".fmu" and kind != "vehicle":
        raise InputError(f"{path} is an FMU, not a {kind}; name it in the file of a {kind}, e.g. one of eightpost new")
    if path.suffix.lower() == ".toml" and (found := toml_kind(path)) not in ("", kind):
        raise InputError(f"{path} defines a {found}, not a {kind}; {_USES[found]}")
    return path


def channel_map_of(given: ColumnMap) -> ChannelMap | None:
    """Return the channel map of an argument: a map, a file of one, or the name of the column by channel.

    Raises:
        InputError: It is something else.
        FileFormatError: The file cannot be read.
    """
    from eightpost.rig.columns import with_channels
    from eightpost.signals import ChannelMap

    if given is None or isinstance(given, ChannelMap):
        return given
    if isinstance(given, str | Path):
        return ChannelMap.read(given)
    if not isinstance(given, Mapping) or not all(isinstance(column, str) for column in given.values()):
        raise InputError(
            f"channel_map is {given!r}; give a file, a ChannelMap, or columns by channel: {{'force': 'Load cell 2'}}"
        )
    return with_channels(None, given)


def a(value: object) -> str:
    """Return the type of a value with its article.

    >>> a(1.0), a(None)
    ('a float', 'None')
    """
    if value is None:
        return "None"
    name = type(value).__name__
    return f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"


# ---- Reading --------------------------------------------------------------------------------------------------------

Kind = Literal["dyno", "rig", "drive", "peak velocity", "shock", "vehicle", "system", "study result", "run"]

KINDS: tuple[Kind, ...] = get_args(Kind)

#: Kinds of records, which are read with a channel map and units.
_RECORDS = ("dyno", "rig", "drive", "peak velocity")


def examples() -> Path:
    """Return the folder of the shipped examples: records, a car, a bank of shocks, a system and a study.

    Example:
        >>> ep.read(ep.examples() / "data" / "dyno_A.csv").stroke
    """
    from eightpost.examples_folder import examples_folder

    return examples_folder()


@overload
def read(
    path: str | Path,
    kind: Literal["dyno"],
    *,
    channel_map: ColumnMap = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
) -> DynoTest: ...
@overload
def read(
    path: str | Path,
    kind: Literal["rig"],
    *,
    channel_map: ColumnMap = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
) -> RigTest: ...
@overload
def read(
    path: str | Path, kind: Literal["drive"], *, channel_map: ColumnMap = None, units: Mapping[str, str] | None = None
) -> Drivefile: ...
@overload
def read(
    path: str | Path, kind: Literal["peak velocity"], *, units: Mapping[str, str] | None = None
) -> PeakVelocityTable: ...
@overload
def read(path: str | Path, kind: Literal["shock"]) -> Shock: ...
@overload
def read(path: str | Path, kind: Literal["vehicle"]) -> Vehicle | VehicleFit: ...
@overload
def read(path: str | Path, kind: Literal["system"]) -> Case: ...
@overload
def read(path: str | Path, kind: Literal["study result"]) -> StudyResult: ...
@overload
def read(path: str | Path, kind: Literal["run"]) -> SavedRun: ...
@overload
def read(
    path: str | Path,
    kind: None = None,
    *,
    channel_map: ColumnMap = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
) -> Readable: ...
def read(
    path: str | Path,
    kind: Kind | None = None,
    *,
    channel_map: ColumnMap = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
) -> Readable:
    """Read a file; its content decides what it is.

    Records: a dynamometer test, a rig test (it has wheelloaders and tire forces), a drive file (wheelloaders only) or a
    peak-velocity table. Files of the project: a shock, a vehicle (with its fit, if that is beside it), a system, the
    results.parquet of a study, and the folder of a run.

    Args:
        path: Path of the file, or of the folder of a run.
        kind: Kind of the content; default: found in the file. A type checker then knows what is returned.
        channel_map: Columns by channel, for records with other column names: a file, a ChannelMap, or a mapping such as
            {"force": "Load cell 2"}.
        units: Units by channel, for columns without a unit in the header of a record.
        flip: Channels of a record whose sign is changed.

    Raises:
        InputError: The file does not exist, cannot be read, is not of that kind, or is not a record but an option of
            records is given.
        DataError: A record has a fault; the message states file, line, channel and what to do.

    Example:
        >>> test = ep.read("run7.csv", "dyno", units={"force": "lbf"})
        >>> test.plot()
    """
    path = existing(path)
    check_options(units, flip)
    if kind is not None and kind not in KINDS:
        raise InputError(f"kind is {kind!r}; {suggestion(str(kind), KINDS)}")
    found = kind or _kind_of(path, channel_map_of(channel_map))
    if found not in _RECORDS:
        if channel_map is not None or units or tuple(flip):
            raise InputError(f"{path}: channel_map, units and flip belong to records, and this file is a {found}")
        return _document(path, found)
    return _record(path, found, channel_map_of(channel_map), dict(units or {}), tuple(flip))


def check_options(units: object, flip: object) -> None:
    """Check that units and flip name channels.

    Raises:
        InputError: One of them is a text.
    """
    if isinstance(units, str):
        raise InputError(f"units is {units!r}; give units by channel: {{'force': 'lbf'}}")
    if isinstance(flip, str):
        raise InputError(f"flip is {flip!r}; give a list of channels: [{flip!r}]")


def _kind_of(path: Path, channel_map: ChannelMap | None) -> Kind:
    if path.is_dir():
        return "run"
    suffix = path.suffix.lower()
    if is_system(path):
        return "system"
    if suffix == ".toml":
        return _toml_kind(path)
    if suffix == ".json":
        return "shock" if document_kind(path) == "shock" else "vehicle"
    if suffix == ".parquet" and _is_study_result(path):
        return "study result"
    return _record_kind(path, channel_map)


def _toml_kind(path: Path) -> Kind:
    if (kind := toml_kind(path)) == "study":
        raise InputError(f"{path} defines a study; run it: study({str(path)!r}, folder)")
    return "system" if kind == "system" else "vehicle"


def _is_study_result(path: Path) -> bool:
    from eightpost.signals.parquet_file import read_metadata

    try:
        return b'"eightpost.study"' in read_metadata(path).get(b"eightpost", b"")
    except EightpostError:
        return False  # the reader of records reports the error


def _record_kind(path: Path, channel_map: ChannelMap | None = None) -> Kind:
    """Return the kind of a record, by the names of its channels."""
    from eightpost.rig.peak_velocity_columns import holds_peak_velocities
    from eightpost.signals import read_records

    records = read_records(path)
    record = records[0]
    names = {name.rpartition(".")[2] for name in (*record.names, *(channel_map.channels if channel_map else ()))}
    if "road" in names:
        return "rig" if "tire_force" in names else "drive"
    return "peak velocity" if holds_peak_velocities(records, channel_map) else "dyno"


def _record(
    path: Path, kind: str, channel_map: ChannelMap | None, units: dict[str, str], flip: tuple[str, ...]
) -> Readable:
    from eightpost.rig import read_dyno_test, read_peak_velocity, read_rig_test
    from eightpost.signals import Drivefile

    if kind == "rig":
        return read_rig_test(path, channel_map=channel_map, units=units, flip=flip)
    if kind == "dyno":
        return read_dyno_test(path, channel_map=channel_map, units=units, flip=flip)
    if flip:
        raise InputError(f"{path}: flip changes the signs of a dyno or rig test, and this file is a {kind} file")
    if kind == "drive":
        return Drivefile.read(path, channel_map=channel_map, units=units)
    tables = read_peak_velocity(path, units=units, channel_map=channel_map)
    if len(tables) > 1:
        settings = ", ".join(table.clicks or "?" for table in tables)
        raise InputError(
            f"{path}: the file has {len(tables)} tables ({settings}); read them with eightpost.rig.read_peak_velocity"
        )
    return tables[0]


def _document(path: Path, kind: str) -> Readable:
    if kind == "shock":
        from eightpost.shock import read_shock

        return read_shock(path)
    if kind == "vehicle":
        return _vehicle(path)
    if kind == "system":
        from cosim.system_file import read_case

        return read_case(path)
    if kind == "study result":
        from cosim.study import StudyResult

        return StudyResult.load(path)
    from cosim.session.result import SavedRun

    return SavedRun.load(path)


def _vehicle(path: Path) -> Vehicle | VehicleFit:
    from eightpost.ident.vehicle.vehicle_fit import fit_path, read_fit
    from eightpost.vehicle import read_vehicle

    return read_fit(path) if path.suffix == ".json" and fit_path(path).is_file() else read_vehicle(path)
