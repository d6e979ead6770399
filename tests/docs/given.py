"""What the reader of a page has before its first code block, made from shipped data, and how long runs are shortened.

The code of `before` runs in the folder in which the blocks of the page run; its names are known to the python blocks.
`call` runs a command line of eightpost, `take` brings what several pages need (see `SHARED`), `record` copies a shipped
dynamometer record to each of the given paths.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Given:
    """Preparation of a page."""

    before: str = ""  #: Python code that runs before the first block.
    shorter: dict[str, str] = field(default_factory=dict)  #: Replacements in commands that would take too long.
    codes: tuple[int, ...] = (0,)  #: Exit codes that the page's commands may have; 1 is a negative verdict.


#: Commands that make what several pages need, in a folder that has `examples`.
SHARED = {
    "rig": ("virtual rig --program identification --set duration='30 s' -o rig",),
    "car.json": ("identify rig/*.parquet -o car.json",),
    "shock.json": ("fit examples/data/dyno_A.csv --law lpnl2 --gas included -o shock.json",),
    "dist": (
        "fit examples/data/dyno_A.csv --law lpnl2 --gas included -o dist/dyno_A.json",
        "fit examples/data/dyno_B.csv --law lpnl2 --gas included -o dist/dyno_B.json",
        "build dist/dyno_A.json dist/dyno_B.json examples/car.toml examples/corner.toml -o dist",
    ),
    "out": ("study examples/study.toml -o out",),
}

_DYNO_TESTS = """
from eightpost.rig import read_dyno_test
tests = [read_dyno_test("examples/data/dyno_A.csv")]
"""

_RIG_TESTS = """
take("rig")
from eightpost.rig import read_rig_test
tests = [read_rig_test("rig/baseline.parquet")]
"""

_CASE = """
take("dist")
import cosim
from cosim.system_file import read_case
case = read_case(Path("examples/seven_dof.toml"))
system, scenario = case.system, case.scenario
"""

_TARGET = """
Path("target.csv").write_text("velocity [m/s],force [N]\\n-0.2,-900\\n-0.1,-600\\n0,0\\n0.1,400\\n0.2,700\\n")
"""

GIVEN = {
    "docs/evidence/reproduce.md": Given(shorter={"--all": "--all --quick"}),
    "docs/explanation/identification.md": Given("take('rig')"),
    "docs/explanation/shock_law.md": Given(
        "record('dyno_A', 'run1.csv', 'run2.csv', 'a1.csv', 'a2.csv', 'b1.csv', 'b2.csv')\n"
        "for k, name in enumerate(('run2', 'a2', 'b1', 'b2'), 1):  # a record that is given twice is refused\n"
        "    path = Path(f'{name}.csv')\n"
        "    path.write_text('\\n'.join(path.read_text().splitlines()[: -10 * k]) + '\\n')\n" + _DYNO_TESTS
    ),
    "docs/explanation/linearity.md": Given(
        _RIG_TESTS + "records, inputs, outputs = [tests[0].series], ['lf.road', 'rf.road'], ['lf.velocity']"
    ),
    "docs/explanation/rig.md": Given(
        shorter={"'100 s'": "'10 s'", "identification -o": "identification --set duration='10 s' -o"}
    ),
    "docs/explanation/vehicle_uncertainty.md": Given(
        "take('rig')\ntake('car.json')\nimport eightpost as ep\n"
        "names = list(ep.read('car.json').trust.measures)\nshares = [1 / 11] * 11\n"
        "first, second = dict.fromkeys(names, 1.0), dict.fromkeys(names, 1.05)"
    ),
    "docs/how_to/assembly.md": Given("take('dist')\ntake('system.toml')"),
    "docs/how_to/dyno_report.md": Given("record('dyno_A', 'A.csv')\nrecord('dyno_B', 'B.csv')"),
    "docs/how_to/exports.md": Given(
        "take('rig')\ntake('car.json', 'vehicle.json')\nshutil.copy('vehicle.response.npz', 'response.npz')\n"
        "take('shock.json')\nfor name, clicks in {'c0': '00', 'c4': '07', 'c8': '14'}.items():\n"
        "    call(f'fit examples/settings/rebound_{clicks}.csv --law lpf1 --gas included -o {name}.json')"
    ),
    "docs/how_to/foreign_fmus.md": Given(
        "take('dist')\ntake('system.toml')\n"
        "shutil.copy('dist/dyno_A.fmu', 'damper.fmu')\nshutil.copy('dist/car.fmu', 'car.fmu')"
    ),
    "docs/how_to/hosts.md": Given(
        "take('dist')\nimport numpy as np\nshutil.copy('dist/dyno_A.fmu', 'shock.fmu')\n"
        "t, velocity, displacement = 1e-3, np.full(4, 0.1), np.full(4, 1e-3)"
    ),
    "docs/how_to/page.md": Given("take('shock.json', 'dist/shock.json')"),
    "docs/how_to/report.md": Given(_CASE + "result = cosim.run(system, scenario)"),
    "docs/how_to/rig_data.md": Given(
        _RIG_TESTS + "for name in ('baseline', 'alternate_lf'):\n    shutil.copy(f'rig/{name}.parquet', Path.cwd())"
    ),
    "docs/how_to/settings.md": Given(_TARGET),
    "docs/how_to/ssp.md": Given("take('dist')"),
    "docs/how_to/study_report.md": Given(shorter={"examples/identified/study.toml": "examples/study.toml"}),
    "docs/how_to/validation.md": Given(
        "take('shock.json')\nrecord('dyno_A', 'data/a.csv')\nfrom eightpost.shock import read_shock\n"
        "shocks = [read_shock('shock.json')]" + _DYNO_TESTS
    ),
    "docs/how_to/vehicle_validation.md": Given(
        "take('rig')\ntake('car.json', 'vehicle.json')\npaths = ['rig/baseline.parquet', 'rig/alternate_lf.parquet']",
        codes=(0, 1),  # records that the car was fitted to do not validate it
    ),
    "docs/reference/check.md": Given("take('dist')\nshutil.copy('dist/car.fmu', 'supplier.fmu')"),
    "docs/reference/dyno_files.md": Given("record('dyno_A', 'export.csv')"),
    "docs/reference/system_file.md": Given("take('dist')"),
    "docs/reference/verdict.md": Given(_CASE),
}
