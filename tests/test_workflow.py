"""The workflow of .github runs the tests on each push, and the nightly ones every night, by make alone."""

import re
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
WORKFLOW = yaml.safe_load((ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8"))
TRIGGERS = WORKFLOW[True]  # YAML reads the key `on` as true


def commands(job):
    return [step["run"] for step in WORKFLOW["jobs"][job]["steps"] if "run" in step]


def test_every_push_and_pull_request_runs_make_test_and_every_night_make_nightly():
    assert set(TRIGGERS) == {"push", "pull_request", "schedule"}
    assert re.fullmatch(r"\d+ \d+ \* \* \*", TRIGGERS["schedule"][0]["cron"])
    jobs = {name: (job["if"], commands(name)) for name, job in WORKFLOW["jobs"].items()}
    assert jobs == {
        "test": ("github.event_name != 'schedule'", ["make test"]),
        "nightly": ("github.event_name == 'schedule'", ["make nightly"]),
    }


def test_its_targets_are_in_the_makefile_and_its_python_is_the_oldest_that_is_supported():
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert {command.split()[1] for job in WORKFLOW["jobs"] for command in commands(job)} <= targets
    versions = {
        step["with"]["python-version"] for job in WORKFLOW["jobs"].values() for step in job["steps"] if "with" in step
    }
    assert versions == {"3.11"}
    assert 'requires-python = ">=3.11"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
