"""No process of a study continues after its main process was killed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import psutil
import pytest

#: A study on two processes that prints its progress, which shows that the workers are working.
MAIN = """
import sys
from pathlib import Path
from cosim.study import Study
from cosim.study.running.sweep import run_study
from cosim.study.running.workers import ProcessWorkers

if __name__ == "__main__":
    study, folder = Study.from_json(Path(sys.argv[1]).read_text()), sys.argv[2]
    run_study(study, folder, ProcessWorkers(2), lambda done, total: print(done, flush=True))
"""


@pytest.mark.nightly
def test_no_worker_outlives_a_study_that_is_killed(small_study, tmp_path: Path) -> None:
    (tmp_path / "study.json").write_text(small_study().to_json())
    (tmp_path / "main.py").write_text(MAIN)
    command = [sys.executable, str(tmp_path / "main.py"), str(tmp_path / "study.json"), str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as main:
        assert main.stdout is not None
        assert main.stdout.readline() == "0\n"
        assert main.stdout.readline() not in ("", "16\n")
        workers = psutil.Process(main.pid).children(recursive=True)
        main.kill()
    _, alive = psutil.wait_procs(workers, timeout=5.0)
    for process in alive:
        process.kill()
    assert len(workers) >= 2
    assert not alive
