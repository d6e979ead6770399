"""All readers of files, each with a valid sample and suitable changes."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from random import Random
from typing import Any

from click.testing import CliRunner

from benchmarks.fuzz import damage
from benchmarks.fuzz.damage import BINARY, TEXT, Change
from eightpost.__main__ import main
from eightpost.errors import InputError, StepError


@dataclass(frozen=True)
class Reader:
    """A reader of one kind of file."""

    name: str  #: Name of the reader in the table.
    sample: str  #: Path of the sample in the folder of samples, where the mutant replaces it.
    function: str | Callable[[Path], Any]  #: Function that reads the file at a path, or its module and name.
    changes: tuple[Change, ...]  #: Functions of a random generator and the sample's bytes that return a mutant's bytes.
    share: float = 1.0  #: Share of the campaign's mutants, relative to the other readers.
    neighbours: tuple[str, ...] = ()  #: Other files that the reader needs, which the error message may name instead.

    def read(self, path: Path) -> Any:
        """Read a file. Modules are imported here, so that a campaign over one reader does not load the others."""
        function = resolve_name(self.function) if isinstance(self.function, str) else self.function
        return function(path)


# ==== Changes =========================================================================================================


def _in_archive(*likely: str) -> tuple[Change, ...]:
    def document(rng: Random, name: str, content: bytes) -> bytes:
        changes = (*(damage.change_xml,) * 6, *TEXT[:8]) if name.endswith((".xml", ".ssd", ".ssv", ".ssm")) else BINARY
        return rng.choice(changes)(rng, content)

    def member(rng: Random, content: bytes) -> bytes:
        return damage.change_member(rng, content, document, likely)

    return (*(member,) * 10, *(damage.change_entries,) * 2, *(damage.change_heads,) * 2, damage.change_around, *BINARY)


def _in_member(changes: tuple[Change, ...], *likely: str) -> tuple[Change, ...]:
    def change(rng: Random, content: bytes) -> bytes:
        return damage.change_member(rng, content, lambda rng, _, member: rng.choice(changes)(rng, member), likely)

    return (change,)


_JSON = (*(damage.change_json,) * 16, *TEXT)
_TOML = (*(damage.change_toml,) * 16, *TEXT)
_PARQUET = (*BINARY, *(damage.change_parquet,) * 5)
_FMU = _in_archive("modelDescription.xml")
_FMU_3 = _in_archive("modelDescription.xml", "buildDescription.xml", "terminalsAndIcons.xml")

# ==== Functions that read more than one file, or use what they read ===================================================


def _record(path: Path) -> Any:
    records = resolve_name("eightpost.signals.formats:read_records")(path)
    return records if len(records) > 1 else resolve_name("eightpost.signals:read_series")(path)


def _words(path: Path) -> Any:
    """Read a record with options of `inspect` from a file, a word on each line, as a command line can contain them."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace").replace("\0", "")
    except OSError as error:
        raise InputError(f"{path}: {error}") from error
    ran = CliRunner().invoke(main, ["inspect", str(path.with_name("record.csv")), *text.split("\n")])
    if ran.exception is not None and not isinstance(ran.exception, SystemExit):
        raise ran.exception
    if ran.exit_code == 2:
        raise InputError(f"{path}: {ran.output}")
    return ran.output


def _map(path: Path) -> Any:
    channels = resolve_name("eightpost.signals:ChannelMap").read(path)
    return resolve_name("eightpost.signals:read_series")(path.with_name("record.csv"), channel_map=channels)


def _shock(path: Path) -> Any:
    law = resolve_name("eightpost.shock:read_shock")(path).law
    return [law.force(float(v)) for v in (-0.5, 0.0, 0.5)] if hasattr(law, "force") else law


def _shock_origin(path: Path) -> Any:
    """Read a shock file as a build does: create its product and its documents."""
    resolve_name("builder.build:product_of")(path)
    return resolve_name("builder.documents:open_shock_origin")(resolve_name("eightpost.shock:read_shock")(path))


def _fit(path: Path) -> Any:
    return resolve_name("eightpost.ident.vehicle.vehicle_fit:read_fit")(path.with_name("fitted.json"))


def _fmu(path: Path) -> Any:
    """Read an FMU as a run and `inspect` do, with its verdict, ranges and uncertainty."""
    with tempfile.TemporaryDirectory(prefix="fuzz_fmu_") as folder:
        fmu = resolve_name("cosim.components.fmu_file:FmuFile").unpack(path, folder)
        found = fmu.variables, fmu.capabilities, fmu.sources, fmu.names_in_log, fmu.rows.references, fmu.log_categories
        known = fmu.validity
        return found, known and (known.verdict.headline, [str(one) for one in known.ranges], known.uncertainty)


def _steps(path: Path) -> Any:
    """Run an FMU in a process of its own, as it reads and executes what it carries."""
    component = resolve_name("cosim.components.isolated:IsolatedComponent")(path, "shock")
    try:
        component.begin(0.0, 1.0, {})
        component.end_initialization()
        component.step(0.0, 0.01)
    except StepError as error:
        raise InputError(f"{path}: {error}") from error
    finally:
        component.finish()


def _check(path: Path) -> Any:
    subject = resolve_name("builder.check.archive:read_subject")(path)
    return list(resolve_name("builder.check.description:static_findings")(subject))


def _parts(path: Path) -> Any:
    return resolve_name("builder.assembly.plan:read_parts")({"lf": path})


def _ssp(path: Path) -> Any:
    return resolve_name("cosim.ssp:read_ssp")(path, given=resolve_name("cosim.ssp:Given")(stop=1.0))


def _study(path: Path) -> Any:
    return [resolve_name(f"cosim.study.study_file:{name}")(path) for name in ("source_files", "read_study")]


def _results(path: Path) -> Any:
    result = resolve_name("cosim.study.table:StudyResult").load(path)
    return result.ranking(), [result.values(measure.name) for measure in result.measures]


def _sound_result(folder: Path) -> Any:
    return resolve_name("cosim.study.table:StudyResult").load(folder / "results.parquet")


def _of_result(name: str) -> Callable[[Path], Any]:
    """Return a function of the packages for choices that reads a file beside the results of a study."""
    return lambda path: resolve_name(f"cosim.study.choice.{name}")(path, _sound_result(path.parent))


def _run_list(path: Path) -> Any:
    return resolve_name("cosim.study.choice.rig_day:read_run_list")(path, _sound_result(path.parent).study)


def _result(path: Path) -> Any:
    return resolve_name("cosim.session.result:SavedRun").load(path.parent)


def _chunks(path: Path) -> Any:
    result = _sound_result(path.parents[2])
    units = {measure.name: result.unit(measure.name) for measure in result.measures}
    schema = resolve_name("cosim.study.table:study_schema")(result.study, units)
    folder = resolve_name("cosim.study.running.sweep:ChunkFolder")(path.parents[2], "0" * 64, schema)
    return folder.coupling(), list(folder.tables())


def _iteration(path: Path) -> Any:
    top = path.parent if path.parent.name == "lap" else path.parents[1]
    folder = resolve_name("eightpost.drivefile:IterationFolder").read(top)
    return folder.outcome(), folder.limit_hits(1)


def _window(path: Path) -> Any:
    folder = resolve_name("eightpost.window.parts:Folder").opened(path.parent)
    return folder.reading(path.parent / "dyno/a.csv"), folder.words([path.parent / "dyno/a.csv"])


# ==== Readers =========================================================================================================


def readers() -> tuple[Reader, ...]:
    """Return all readers."""
    npz = (*_in_archive(".npy"), *(damage.change_npz,) * 3)
    settings = "eightpost.ident.shock.settings_table:read_settings_table"
    binary = _in_member((*BINARY, *(damage.overwrite_head,) * 5), ".so", ".dll", ".dylib")
    chunks = f"chunks/{'0' * 16}"
    return (
        Reader("record .csv", "record.csv", _record, TEXT, 2.0),
        Reader("record .csv, preamble", "german.csv", _record, TEXT),
        Reader("record .csv, 10 MB field", "record.csv", _record, (damage.long_field,), 0.05),
        Reader("dyno record", "record.csv", "eightpost.rig.dyno_test:read_dyno_tests", TEXT),
        Reader("peak-velocity table", "peaks.csv", "eightpost.rig.peak_velocity:read_peak_velocity", TEXT),
        Reader("record .parquet", "record.parquet", _record, (*BINARY, damage.change_parquet)),
        Reader("record .mat", "record.mat", _record, (*BINARY, *(damage.change_mat,) * 8), 2.0),
        Reader("record .mf4", "record.mf4", _record, (*BINARY, damage.overwrite_links), 1.5),
        Reader("record .mdf", "record.mdf", _record, (*BINARY, damage.overwrite_head), 0.5),
        Reader("record .rsp", "record.rsp", _record, (*BINARY, *(damage.overwrite_head,) * 3, *TEXT[-6:])),
        Reader("record .drv, integers", "integers.drv", _record, (*BINARY, *(damage.overwrite_head,) * 3, *TEXT[-6:])),
        Reader("record .ld", "run.ld", _record, (*BINARY, *(damage.overwrite_head,) * 3)),
        Reader("record .lvm", "record.lvm", _record, TEXT),
        Reader("record .tdms", "record.tdms", _record, (*BINARY, damage.overwrite_head)),
        Reader("record .xlsx", "record.xlsx", _record, _in_archive("sheet1.xml", "sharedStrings.xml")),
        Reader("record .m", "record.m", _record, TEXT),
        Reader("options of inspect", "words.txt", _words, TEXT, neighbours=("record.csv",)),
        Reader("record .vbo", "lap.vbo", _record, TEXT),
        Reader("record .json", "record.json", _record, _JSON),
        Reader("rig record", "rig.parquet", "eightpost.rig.rig_test:read_rig_test", _PARQUET, 0.5),
        Reader("drivefile", "drive.parquet", "eightpost.signals:Drivefile.read", _PARQUET, 0.5),
        Reader("channel map", "map.toml", _map, _TOML, neighbours=("record.csv",)),
        Reader("shock file", "shock.json", _shock, _JSON, 2.0),
        Reader("shock file, built", "shock.json", _shock_origin, _JSON),
        Reader("vehicle .toml", "seven_dof.toml", "eightpost.vehicle:read_vehicle", _TOML),
        Reader("vehicle .json", "vehicle.json", "eightpost.vehicle:read_vehicle", _JSON),
        Reader("fit of a vehicle", "fitted.fit.json", _fit, _JSON, 0.5),
        Reader("preparation", "preparation.toml", "eightpost.ident.preparation:read_preparation", _TOML),
        Reader("response .npz", "response.npz", "eightpost.ident.vehicle.frequency_response:read_response", npz, 1.5),
        Reader("table of settings", "table.toml", settings, _TOML, neighbours=("record.csv",)),
        Reader("FMU", "fmus/shock.fmu", _fmu, _FMU, 2.0),
        Reader("FMU, bomb", "plain.fmu", _fmu, (damage.bomb,), 0.02),
        Reader("FMU, own document", "fmus/shock.fmu", _fmu, _in_member(_JSON, "resources/eightpost.json")),
        Reader("FMU, resources", "fmus/shock.fmu", _steps, _in_member((*_JSON, *TEXT * 4), ".py", ".json"), 0.1),
        Reader("FMU, checked", "fmus/shock.fmu", _check, _FMU),
        Reader("FMU of FMI 3.0, checked", "arrays.fmu", _check, _FMU_3),
        Reader("FMU, checked, bomb", "plain.fmu", _check, (damage.bomb,), 0.02),
        Reader("FMU, binary checked", "fmus/shock.fmu", _check, binary, 0.5),
        Reader("FMU, assembled", "fmus/shock.fmu", _parts, _FMU, 0.5),
        Reader("SSP package", "package.ssp", _ssp, _in_archive(".ssd", ".ssv", ".ssm"), 2.0),
        Reader("system file", "system.toml", "cosim.system_file:read_case", _TOML, 1.5),
        Reader("study file", "study.toml", _study, _TOML, 1.5),
        Reader("study results", "results.parquet", _results, (*BINARY, *(damage.change_parquet,) * 8), 1.5),
        Reader("certainty", "certainty.parquet", "cosim.study.choice.certainty:read_certainty", _PARQUET),
        Reader("selection", "selection.csv", _of_result("rig_day:read_selection"), TEXT),
        Reader("list of runs", "selection.csv", _run_list, TEXT),
        Reader("uncertainty file", "uncertain.toml", _of_result("robust:read_uncertainty"), _TOML),
        Reader("comparison", "comparison.json", "cosim.study.choice.compare:read_run_to_run", _JSON),
        Reader("result of a run", "run/result.json", _result, _JSON),
        Reader("chunk of a study", f"{chunks}/chunk_0000000_3.parquet", _chunks, BINARY, 0.5),
        Reader("coupling of a study", f"{chunks}/coupling.json", _chunks, _JSON, 0.5),
        Reader("state of an iteration", "lap/iteration.json", _iteration, _JSON, 1.5),
        Reader("limits of an iteration", "lap/pass_01/limits.json", _iteration, _JSON, 0.5),
        Reader("target of an iteration", "lap/target.parquet", _iteration, _PARQUET, 0.5),
        Reader("state of the window", "window/window.json", _window, _JSON),
    )
