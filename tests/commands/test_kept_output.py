"""What the verbs print about shipped files: no number and no word changes unseen."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main

EXAMPLES = Path(__file__).parents[2] / "examples"

COMMANDS = (
    "inspect bank/AA_B.json -v",
    "inspect data/dyno_A.csv",
    "inspect data/dyno_A.csv -v",
    "inspect data/track.parquet",
    "inspect settings/rebound_07.csv",
    "inspect car.toml -v",
    "inspect identified/car.json -v",
    "inspect corner.toml",
    "inspect none.csv",
    "export car.toml -o {folder}/car.mat",
    "export bank/AA_B.json -o {folder}/shock.csv",
    "export bank/AA_B.json bank/B_B.json --over clicks=0,4 -o {folder}/shocks.txt",
    "report bank/AA_B.json bank/B_B.json --car car.toml --corner lf=AA_B -o {folder}/report.html",
    "reproduce none",
    "study none.toml",
    "fit data/dyno_A.csv --law none -o {folder}/x.json",
    "fit data/track.parquet --law lpnl2 -o {folder}/x.json",
    "fit data/dyno_A.csv --law polylinear -o {folder}/x.json",
    "fit data/dyno_A.csv settings/rebound_07.csv --law lpf1 -o {folder}/x.json",
    "validate bank/AA_B.json data/dyno_B.csv -o {folder}/v.html -v",
    "validate bank/AA_B.json -o {folder}/v.html",
    "report data/dyno_A.csv bank/AA_B.json -o {folder}/r.html -v",
    "report data/dyno_A.csv --limits data/dyno_B.csv --set tolerance='5 %' -o {folder}/r.html",
    "identify data/dyno_A.csv -o {folder}/car.json",
    "drivefile next none",
    "build none.json -o {folder}",
    "build bank/AA_B.json bank/AA_B.json -o {folder}",
    "check none.fmu",
    "run none.toml",
    "new {folder}/starter",
)


def _printed(words: list[str], monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.chdir(EXAMPLES)
    ran = CliRunner().invoke(main, words, env={"COLUMNS": "120", "NO_COLOR": "1"})
    return {"exit code": ran.exit_code, "printed": [line.rstrip() for line in ran.output.splitlines()]}


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.partition(" -o")[0].replace("/", " "))
def test_a_command_prints_the_same(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    words = [word.format(folder=tmp_path) for word in shlex.split(command)]
    unchanged(_printed(words, monkeypatch))


@pytest.mark.parametrize("name", ["seven_dof", "hysteresis"])
def test_inspect_prints_the_same_about_an_fmu(
    name: str, fmus: Mapping[str, Path], monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    shown = _printed(["inspect", str(fmus[name]), "-v"], monkeypatch)
    unchanged([line for line in shown["printed"] if "platforms" not in line])
