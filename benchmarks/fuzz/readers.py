"""All readers of files, each with a valid sample and suitable changes."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from benchmarks.fuzz.damage import (
    BINARY,
    SLOW,
    TEXT,
    Change,
    bomb,
    change_around,
    change_entries,
    change_heads,
    change_json,
    change_mat,
    change_member,
    change_npz,
    change_parquet,
    change_toml,
    change_xml,
    overwrite_head,
    overwrite_links,
)


@dataclass(frozen=True)
class Reader:
    """A reader of one kind of file."""

    name: str  #: Name of the reader in the table.
    sample: str  #: Path of the sample in the folder of samples, where the mutant replaces it.
    read: Callable[[Path], Any]  #: Function that reads the file at a path in the folder of samples.
    changes: tuple[Change, ...]  #: Functions of a random generator and the sample's bytes that return a mutant's bytes.
    share: float = 1.0  #: Share of the campaign's mutants, relative to the other readers.
    neighbours: tuple[str, ...] = ()  #: Other files that the reader needs, which the error message may name instead.


def _xml(rng: Random, name: str, content: bytes) -> bytes:
    if not name.endswith((".xml", ".ssd", ".ssv", ".ssm")):
        return rng.choice(BINARY)(rng, content)
    return rng.choice((*(change_xml,) * 6, *TEXT[:8]))(rng, content)


def _in_archive(*likely: str) -> tuple[Change, ...]:
    def member(rng: Random, content: bytes) -> bytes:
        return change_member(rng, content, _xml, likely)

    around = (change_entries, change_entries, change_heads, change_heads,
              change_around)  # fmt: skip
    return (*(member,) * 10, *around, *BINARY)


_TEXT, _BINARY = TEXT, BINARY
_JSON = (*(change_json,) * 16, *_TEXT)
_TOML = (*(change_toml,) * 16, *_TEXT)
_FMU = _in_archive("modelDescription.xml")
_FMU_3 = _in_archive("modelDescription.xml", "buildDescription.xml", "terminalsAndIcons.xml")


# The readers import their modules when they are called, so that a campaign over one reader does not load the others.


def _record(path: Path) -> Any:
    from eightpost.signals import read_series  # noqa: PLC0415
    from eightpost.signals.formats import read_records  # noqa: PLC0415

    records = read_records(path)
    if len(records) == 1:
        read_series(path)
    return records


def _dyno(path: Path) -> Any:
    from eightpost.rig.dyno_test import read_dyno_tests  # noqa: PLC0415

    return read_dyno_tests(path)


def _peaks(path: Path) -> Any:
    from eightpost.rig.peak_velocity import read_peak_velocity  # noqa: PLC0415

    return read_peak_velocity(path)


def _rig(path: Path) -> Any:
    from eightpost.rig.rig_test import read_rig_test  # noqa: PLC0415

    return read_rig_test(path)


def _drive(path: Path) -> Any:
    from eightpost.signals import Drivefile  # noqa: PLC0415

    return Drivefile.read(path)


def _map(path: Path) -> Any:
    from eightpost.signals import ChannelMap, read_series  # noqa: PLC0415

    return read_series(path.with_name("record.csv"), channel_map=ChannelMap.read(path))


def _shock(path: Path) -> Any:
    from eightpost.shock import read_shock  # noqa: PLC0415

    shock = read_shock(path)
    return [shock.law.force(float(v)) for v in (-0.5, 0.0, 0.5)] if hasattr(shock.law, "force") else shock


def _shock_origin(path: Path) -> Any:
    """Read a shock file as a build does: create its product and its documents."""
    from builder.build import product_of  # noqa: PLC0415
    from builder.documents import open_shock_origin  # noqa: PLC0415
    from eightpost.shock import read_shock  # noqa: PLC0415

    product_of(path)
    return open_shock_origin(read_shock(path))


def _vehicle(path: Path) -> Any:
    from eightpost.vehicle import read_vehicle  # noqa: PLC0415

    return read_vehicle(path)


def _fit(path: Path) -> Any:
    from eightpost.ident.vehicle.vehicle_fit import read_fit  # noqa: PLC0415

    return read_fit(path.with_name("fitted.json"))


def _preparation(path: Path) -> Any:
    from eightpost.ident.preparation.preparation import read_preparation  # noqa: PLC0415

    return read_preparation(path)


def _response(path: Path) -> Any:
    from eightpost.ident.vehicle.frequency_response import read_response  # noqa: PLC0415

    return read_response(path)


def _fmu(path: Path) -> Any:
    from cosim.components.fmu_file import FmuFile  # noqa: PLC0415

    with tempfile.TemporaryDirectory(prefix="fuzz_fmu_") as folder:
        fmu = FmuFile.unpack(path, folder)
        return fmu.variables, fmu.capabilities, fmu.sources, fmu.names_in_log, fmu.rows.references, fmu.log_categories


def _check(path: Path) -> Any:
    from builder.check.archive import read_subject  # noqa: PLC0415
    from builder.check.description import static_findings  # noqa: PLC0415

    return list(static_findings(read_subject(path)))


def _own_document(path: Path) -> Any:
    """Read an FMU as a run and `inspect` do: its verdict, ranges and uncertainty."""
    from cosim.components.fmu_file import FmuFile  # noqa: PLC0415

    with tempfile.TemporaryDirectory(prefix="fuzz_fmu_") as folder:
        found = FmuFile.unpack(path, folder).validity
        return found and (found.verdict.headline, [str(one) for one in found.ranges], found.uncertainty)


def _parts(path: Path) -> Any:
    from builder.assembly.plan import read_parts  # noqa: PLC0415

    return read_parts({"lf": path})


def _ssp(path: Path) -> Any:
    from cosim.ssp import Given, read_ssp  # noqa: PLC0415

    return read_ssp(path, given=Given(stop=1.0))


def _system(path: Path) -> Any:
    from cosim.system_file import read_case  # noqa: PLC0415

    return read_case(path)


def _study(path: Path) -> Any:
    from cosim.study.study_file import read_study, source_files  # noqa: PLC0415

    return source_files(path), read_study(path)


def _results(path: Path) -> Any:
    from cosim.study.table import StudyResult  # noqa: PLC0415

    result = StudyResult.load(path)
    return result.ranking(), [result.values(measure.name) for measure in result.measures]


def _sound_result(path: Path) -> Any:
    from cosim.study.table import StudyResult  # noqa: PLC0415

    return StudyResult.load(path.with_name("results.parquet"))


def _selection(path: Path) -> Any:
    from cosim.study.choice.rig_day import read_selection  # noqa: PLC0415

    return read_selection(path, _sound_result(path))


def _run_list(path: Path) -> Any:
    from cosim.study.choice.rig_day import read_run_list  # noqa: PLC0415

    return read_run_list(path, _sound_result(path).study)


def _uncertainty(path: Path) -> Any:
    from cosim.study.choice.robust import read_uncertainty  # noqa: PLC0415

    return read_uncertainty(path, _sound_result(path))


def _comparison(path: Path) -> Any:
    from cosim.study.choice.compare import read_run_to_run  # noqa: PLC0415

    return read_run_to_run(path)


def _result(path: Path) -> Any:
    from cosim.session.result import SavedRun  # noqa: PLC0415

    return SavedRun.load(path.parent)


def _chunks(path: Path) -> Any:
    from cosim.study.running.sweep import ChunkFolder  # noqa: PLC0415
    from cosim.study.table import study_schema  # noqa: PLC0415

    result = _sound_result(path.parents[1])
    units = {measure.name: result.unit(measure.name) for measure in result.measures}
    folder = ChunkFolder(path.parents[2], "0" * 64, study_schema(result.study, units))
    return folder.coupling(), folder.table()


def _iteration(path: Path) -> Any:
    from eightpost.drivefile import IterationFolder  # noqa: PLC0415

    folder = IterationFolder.read(path.parent if path.parent.name == "lap" else path.parents[1])
    return folder.outcome(), folder.limit_hits(1)


def _window(path: Path) -> Any:
    from eightpost.window.folder import Folder  # noqa: PLC0415

    opened = Folder.opened(path.parent)
    return opened.reading(path.parent / "dyno/a.csv"), opened.words([path.parent / "dyno/a.csv"])


def _table(path: Path) -> Any:
    from eightpost.ident.shock.settings_table import read_settings_table  # noqa: PLC0415

    return read_settings_table(path)


def readers() -> tuple[Reader, ...]:
    """Return all readers."""
    return tuple(_records()) + tuple(_models()) + tuple(_fmus()) + tuple(_studies()) + tuple(_states())


def _records() -> Iterator[Reader]:
    yield Reader("record .csv", "record.csv", _record, _TEXT, 2.0)
    yield Reader("record .csv, preamble", "german.csv", _record, _TEXT)
    yield Reader("record .csv, 10 MB field", "record.csv", _record, SLOW, 0.05)
    yield Reader("dyno record", "record.csv", _dyno, _TEXT)
    yield Reader("peak-velocity table", "peaks.csv", _peaks, _TEXT)
    yield Reader("record .parquet", "record.parquet", _record, (*_BINARY, change_parquet))
    yield Reader("record .mat", "record.mat", _record, (*_BINARY, *(change_mat,) * 8), 2.0)
    yield Reader("record .mf4", "record.mf4", _record, (*_BINARY, overwrite_links), 1.5)
    yield Reader("record .mdf", "record.mdf", _record, (*_BINARY, overwrite_head), 0.5)
    yield Reader("record .rsp", "record.rsp", _record, (*_BINARY, *(overwrite_head,) * 3, *_TEXT[-6:]))
    yield Reader("record .vbo", "lap.vbo", _record, _TEXT)
    yield Reader("record .json", "record.json", _record, _JSON)
    yield Reader("rig record", "rig.parquet", _rig, (*_BINARY, *(change_parquet,) * 5), 0.5)
    yield Reader("drivefile", "drive.parquet", _drive, (*_BINARY, *(change_parquet,) * 5), 0.5)
    yield Reader("channel map", "map.toml", _map, _TOML, neighbours=("record.csv",))


def _models() -> Iterator[Reader]:
    yield Reader("shock file", "shock.json", _shock, _JSON, 2.0)
    yield Reader("shock file, built", "shock.json", _shock_origin, _JSON)
    yield Reader("vehicle .toml", "seven_dof.toml", _vehicle, _TOML)
    yield Reader("vehicle .json", "vehicle.json", _vehicle, _JSON)
    yield Reader("fit of a vehicle", "fitted.fit.json", _fit, _JSON, 0.5)
    yield Reader("preparation", "preparation.toml", _preparation, _TOML)
    npz = (*_in_archive(".npy"), change_npz, change_npz, change_npz)
    yield Reader("response .npz", "response.npz", _response, npz, 1.5)


def _fmus() -> Iterator[Reader]:
    yield Reader("FMU", "fmus/shock.fmu", _fmu, _FMU, 2.0)
    yield Reader("FMU, bomb", "plain.fmu", _fmu, (bomb,), 0.02)
    yield Reader("FMU, checked", "fmus/shock.fmu", _check, _FMU)
    yield Reader("FMU of FMI 3.0, checked", "arrays.fmu", _check, _FMU_3)
    yield Reader("FMU, checked, bomb", "plain.fmu", _check, (bomb,), 0.02)
    yield Reader("FMU, binary checked", "fmus/shock.fmu", _check, (_binaries,), 0.5)
    yield Reader("FMU, assembled", "fmus/shock.fmu", _parts, _FMU, 0.5)
    yield Reader("SSP package", "package.ssp", _ssp, _in_archive(".ssd", ".ssv", ".ssm"), 2.0)
    yield Reader("system file", "system.toml", _system, _TOML, 1.5)


def _binaries(rng: Random, content: bytes) -> bytes:
    def change(rng: Random, _: str, member: bytes) -> bytes:
        return rng.choice((*_BINARY, *(overwrite_head,) * 5))(rng, member)

    return change_member(rng, content, change, (".so", ".dll", ".dylib"))


def _own(rng: Random, _: str, member: bytes) -> bytes:
    return rng.choice(_JSON)(rng, member)


def _in_own(rng: Random, content: bytes) -> bytes:
    return change_member(rng, content, _own, ("resources/eightpost.json",))


def _states() -> Iterator[Reader]:
    yield Reader("FMU, own document", "fmus/shock.fmu", _own_document, (_in_own,))
    yield Reader("state of an iteration", "lap/iteration.json", _iteration, _JSON, 1.5)
    yield Reader("limits of an iteration", "lap/pass_01/limits.json", _iteration, _JSON, 0.5)
    yield Reader("target of an iteration", "lap/target.parquet", _iteration, (*_BINARY, *(change_parquet,) * 5), 0.5)
    yield Reader("state of the window", "window/window.json", _window, _JSON)
    yield Reader("table of settings", "table.toml", _table, _TOML, neighbours=("record.csv",))


def _studies() -> Iterator[Reader]:
    yield Reader("study file", "study.toml", _study, _TOML, 1.5)
    yield Reader("study results", "results.parquet", _results, (*_BINARY, *(change_parquet,) * 8), 1.5)
    yield Reader("selection", "selection.csv", _selection, _TEXT)
    yield Reader("list of runs", "selection.csv", _run_list, _TEXT)
    yield Reader("uncertainty file", "uncertain.toml", _uncertainty, _TOML)
    yield Reader("comparison", "comparison.json", _comparison, _JSON)
    yield Reader("result of a run", "run/result.json", _result, _JSON)
    chunks = f"chunks/{'0' * 16}"
    yield Reader("chunk of a study", f"{chunks}/chunk_0000000_3.parquet", _chunks, _BINARY, 0.5)
    yield Reader("coupling of a study", f"{chunks}/coupling.json", _chunks, _JSON, 0.5)
