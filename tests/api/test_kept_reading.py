"""What the Python interface reads, fits and refuses: no word and no figure of it changes unseen."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

import eightpost as ep
from eightpost.errors import EightpostError

EXAMPLES = Path(__file__).parents[2] / "examples"

#: Files with options of `read`.
READ: dict[str, tuple[str, dict[str, object]]] = {
    "a record": ("data/dyno_A.csv", {}),
    "a record with another sign": ("data/dyno_A.csv", {"flip": ["force"]}),
    "a record with a map": ("data/dyno_A.csv", {"channel_map": {"force": "Force [lbf]"}}),
    "a record as a drive file": ("data/dyno_A.csv", {"kind": "drive"}),
    "a track": ("data/track.parquet", {"kind": "drive"}),
    "a shock": ("bank/AA_B.json", {}),
    "a shock as a vehicle": ("bank/AA_B.json", {"kind": "vehicle"}),
    "a shock with another sign": ("bank/AA_B.json", {"flip": ["force"]}),
    "a car": ("car.toml", {}),
    "an identified car": ("identified/car.json", {}),
    "a car as a system": ("car.toml", {"kind": "system"}),
    "a study": ("study.toml", {}),
    "an unknown kind": ("car.toml", {"kind": "vehicel"}),
    "nothing": ("none.csv", {}),
    "a folder": ("data", {}),
    "units that are a text": ("data/dyno_A.csv", {"units": "lbf"}),
    "signs that are a text": ("data/dyno_A.csv", {"flip": "force"}),
    "a map that is a number": ("data/dyno_A.csv", {"channel_map": 3}),
}


def _told(call: Callable[[], object]) -> str:
    try:
        found = repr(call())
    except EightpostError as error:
        found = f"{type(error).__name__}: {error}"
    return re.sub(r" at 0x[0-9a-f]+", "", found.replace(f"{EXAMPLES}/", ""))


def test_what_is_read_from_files_is_the_same(monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]) -> None:
    monkeypatch.chdir(EXAMPLES)
    unchanged({name: _told(lambda path=path, options=options: ep.read(EXAMPLES / path, **options))  # type: ignore[misc, call-overload]
               for name, (path, options) in READ.items()})  # fmt: skip


@pytest.fixture(scope="module")
def record() -> ep.DynoTest:
    return ep.read(EXAMPLES / "data" / "dyno_A.csv", "dyno")


def test_what_is_fitted_and_simulated_is_the_same(record: ep.DynoTest, unchanged: Callable[..., None]) -> None:
    fitted = ep.fit(record, law="polylinear")
    simulated = ep.simulate(fitted, record)
    shock = ep.read(EXAMPLES / "bank" / "AA_B.json", "shock")
    refused = {
        "no law": lambda: ep.fit(record, law="none"), "no record": lambda: ep.fit([], law="lpf1"),
        "no gas": lambda: ep.fit(record, gas="none"), "a number": lambda: ep.fit(3),
        "no shock": lambda: ep.simulate(3, record), "source": lambda: ep.build([], "x"),
        "no run": lambda: ep.run(EXAMPLES / "car.toml"), "runs": lambda: ep.compare({}),
        "rig": lambda: ep.identify([]), "one": lambda: ep.identify([record]),
    }  # fmt: skip
    unchanged({
        "fit": _told(lambda: fitted), "names": simulated.names, "shock": _told(lambda: ep.simulate(shock, record)),
        "forces": simulated["force"], **{name: _told(call) for name, call in refused.items()},
    }, relative=1e-4)  # fmt: skip
