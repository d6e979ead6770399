"""What the examples of `--help` find in their folder, and which of them no test runs, with the reason.

The code of a verb runs in the folder before its examples, with the functions of tests/docs/given.py: `record` copies a
shipped dynamometer record, `take` brings what several verbs need, `call` runs a command line of eightpost.
"""

from __future__ import annotations

_IDENTIFY = "compares two recipes for minutes: tests/ident_response/test_identify_command.py"

#: Examples that are not run, by their first words, and why.
NOT_RUN = {
    "app": "serves until it is closed: tests/window/test_window_in_browser.py",
    "virtual dyno --configuration 1 --test all": "writes every test: tests/virtual/test_dynamometer_drives.py",
    "inspect run7.mf4": "needs an MDF record: tests/signals/test_mdf_file.py reads them",
    "inspect rig.csv --channel": "needs a channel map of a rig: tests/commands/test_inspect.py",
    "virtual rig --program all": "simulates half an hour of rig tests; the same program is run for identification",
    "identify rig/*.parquet -o": _IDENTIFY,
    "identify rig/*.parquet --static": _IDENTIFY,
    "identify base.parquet": _IDENTIFY,
    "drivefile": "needs an iteration on a rig: tests/drivefile/test_stand_in.py",
    "export c0.json": "needs shocks of one law at three settings: tests/ident/exports/test_shock_tables.py",
    "run car.ssp": "needs a package whose road is open: tests/cosim/ssp/test_reading.py",
    "study examples/study.toml -o out/ --trace": "names a setup of 2401: tests/commands/test_study.py",
    "study shapes": "optimises for minutes: tests/commands/test_shapes.py",
    "study whatif": "needs a study of shocks with adjusters: tests/commands/test_shapes.py",
    "study robust": "needs an uncertainty file of your own: tests/cosim/study/test_robust.py",
    "study confirm": "needs rig runs: tests/cosim/study/test_compare_commands.py",
    "study compare": "needs rig runs or two studies: tests/cosim/study/test_compare_commands.py",
    "validate vehicle.json rig/ --shock": "needs named shocks: tests/ident/vehicle_validation/test_validate_command.py",
    "study select": "needs a study of many setups: tests/cosim/study/test_selection.py",
    "reproduce --all": "the page docs/evidence/reproduce.md runs it",
}

#: Replacements in examples that would take too long.
SHORTER = {"'100 s'": "'10 s'"}

#: Examples that simulate a rig without a stated duration, and get one.
RIG = " --set duration='10 s'"

#: Exit codes of verbs whose verdict on these data may be negative.
CODES = {
    "inspect": (0, 1),
    "validate": (0, 1),
    "identify": (0, 1),
    "fit": (0, 1),
    "check": (0, 1),  # FMUs for this platform only
}

_RECORDS = """
record('dyno_A', 'run1.csv', 'dyno.csv', 'a.csv', 'A.csv', 'day.csv', 'data/a.csv')
record('dyno_B', 'run2.csv', 'b.csv')
"""

#: A record whose force has no unit and the opposite sign.
_RUN7 = """
lines = Path("run1.csv").read_text(encoding="utf-8").splitlines()
at = next(number for number, line in enumerate(lines) if line.startswith("Time"))
column = [name.strip().startswith("Force") for name in lines[at].split(",")].index(True)
for number in range(at + 1, len(lines)):
    cells = lines[number].split(",")
    cells[column] = repr(-float(cells[column]))
    lines[number] = ",".join(cells)
lines[at] = lines[at].replace("Force [lbf]", "Force")
Path("run7.csv").write_text("\\n".join(lines) + "\\n", encoding="utf-8")
"""

_SINES = (
    "call(\"virtual dyno --configuration 5 --test sine --set amplitude='1 in' --set speed='10 in/s' -o sines.csv\")\n"
)

_PEAKS = """
Path("peak_velocities.csv").write_text(
    "speed (mm/s),comp 3 (N),reb 3 (N),comp 6 (N),reb 6 (N)\\n"
    "50,200,250,120,160\\n150,420,560,300,400\\n300,600,840,450,640\\n500,760,1150,600,900\\n")
"""

_SETTINGS = "shutil.copytree('examples/settings', '.', dirs_exist_ok=True)\n"

#: A second adjuster, of compression: 4 clicks instead of 8 raise its forces by 30 %.
_ADJUSTABLE = (
    _SETTINGS
    + """
lines = Path("rebound_14.csv").read_text(encoding="utf-8").splitlines()
at = next(number for number, line in enumerate(lines) if line.startswith("Time"))
column = [name.strip().startswith("Force") for name in lines[at].split(",")].index(True)
for number in range(at + 1, len(lines)):
    cells = lines[number].split(",")
    cells[column] = repr(float(cells[column]) * (1.3 if float(cells[column]) > 0.0 else 1.0))
    lines[number] = ",".join(cells)
Path("stiff.csv").write_text("\\n".join(lines) + "\\n", encoding="utf-8")
with Path("rebound.toml").open("a", encoding="utf-8") as table:
    table.write('[adjuster.compression]\\ncounted = "from full hard"\\nlowest = 0\\nhighest = 16\\nreference = 8\\n')
    table.write('[[file]]\\npath = "stiff.csv"\\nclicks.compression = 4\\n')
call("fit rebound.toml --law lpf1 -o shock.json", (0, 1))
shutil.copy("examples/bank/B_B.json", "other_shock.json")
Path("target.csv").write_text("velocity [m/s],force [N]\\n-0.2,-900\\n-0.1,-600\\n0,0\\n0.1,400\\n0.2,700\\n")
"""
)

_CAR = "take('rig')\ntake('car.json', 'vehicle.json')\n"

_BUILDS = "shutil.copy('examples/bank/B_B.json', 'A.json')\nshutil.copy('examples/bank/C_C.json', 'B.json')\n"

#: Preparation by verb.
BEFORE = {
    "inspect": "record('dyno_A', 'run7.csv')\ntake('dist')\nshutil.copy('dist/dyno_A.fmu', 'dist/shock.fmu')\n"
    "shutil.copy('examples/car.toml', 'car.toml')\n" + """
for road in ("lf.road", "rf.road"):
    call(f"virtual rig --test single --set only={road} --set duration='60 s' -o rig/{road.replace('.', '_')}.parquet")
""",
    "fit": _RECORDS + _RUN7 + _SINES + _PEAKS + _SETTINGS + "record('dyno_A', '0.3A.csv')\n" + """
for number, name in enumerate(("0.9A", "1.6A"), 1):
    lines = Path("0.3A.csv").read_text(encoding="utf-8").splitlines()
    Path(f"{name}.csv").write_text("\\n".join(lines[: -10 * number]) + "\\n", encoding="utf-8")
""",
    "report": _RECORDS + "take('out')\nrecord('dyno_B', 'B.csv')\ntake('shock.json')\n" + _BUILDS + """
Path("bank").mkdir()
for name in "AB":
    shutil.copy(f"{name}.json", "bank")
shutil.copy("examples/car.toml", "car.toml")
call("virtual dyno --configuration 5 --test sine --set amplitude='1 in' --set speed='10 in/s' -o day.csv")
""",
    "validate": _RECORDS + _CAR + _BUILDS + """
take("shock.json")
call("fit data/a.csv --law polylinear --gas included -o static.json")
shutil.copy("shock.json", "lpnl2.json")
call("virtual dyno --configuration 5 --test sine --set amplitude='1 in' --set speed='10 in/s' -o run7.csv")
call("virtual dyno --build C/B --set duration='61 s' -o track.csv")
""",
    "identify": """
for name, damping in {"q1": 31.03, "q5": 15.0}.items():
    rig = f"virtual rig --car quarter_car --shock '{damping} lbf.s/in'"
    call(f"{rig} --set duration='30 s' -o {name}.csv")
""",
    "export": _CAR + "take('shock.json')\ntake('dist')\n" + _SETTINGS + """
shutil.copy("vehicle.response.npz", "response.npz")
call("fit rebound.toml --law lpf1 -o adjustable.json", (0, 1))
""",
    "build": "take('shock.json')\ntake('dist')\ntake('system.toml')\nshutil.copy('examples/car.toml', 'car.toml')\n",
    "check": "take('dist')\nshutil.copy('dist/car.fmu', 'supplier.fmu')\n",
    "run": "take('dist')\n",
    "study": _ADJUSTABLE + "take('out')\n",
}  # fmt: skip
