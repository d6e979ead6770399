"""Use of the API, for a type checker: tests/api/test_names.py runs pyrefly on this file, which is never executed."""

from typing import assert_type

import eightpost as ep
from builder.build import Built
from cosim import Result
from cosim.session.parameter_sweep import ParameterSweep
from cosim.study.choice.compare import RunComparison
from eightpost.api.study_folder import AssessedStudy
from eightpost.ident import ShockFit
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.rig import DynoTest, RigTest

test = ep.read("dyno.csv", "dyno")
assert_type(test, DynoTest)
assert_type(ep.read("rig.parquet", "rig"), RigTest)
assert_type(ep.read("lap.parquet", "drive"), ep.Drivefile)
fit = ep.fit([test, "other.csv"], "lpf1")
assert_type(fit, ShockFit)
assert_type(ep.build(fit, "fmus"), Built)
assert_type(ep.build([fit, "car.toml"], "fmus"), list[Built])
assert_type(ep.simulate(fit, test), ep.TimeSeries)
system = ep.System.load({"car": "car.fmu", "lf": ep.build(fit, "fmus")}, bonds=[("car.lf", "lf")])
scenario = ep.Scenario(stop=1.0, drive=ep.read("lap.parquet", "drive"))
result = ep.run(system, scenario, parameters={"lf.compression_scale": 1.2}, progress=lambda done, total: None)
assert_type(result, Result)
assert_type(ep.sweep(system, scenario, parameters={"lf.compression_scale": [0.8, 1.2]}), ParameterSweep)
assert_type(ep.compare([result, "out"]), RunComparison)
car = ep.identify(["a.parquet", "b.parquet"])
assert_type(car, VehicleFit)
assert_type(ep.simulate(car, test.series, fit), ep.TimeSeries)
assert_type(ep.study("study.toml", "out"), AssessedStudy)
ep.run(system, scenario, algorithm="gauss")  # type: ignore[arg-type]
