"""A Dask cluster of processes that are started by hand, as on several machines."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from distributed import Client

ROOT = Path(__file__).resolve().parents[3]

#: Longest time that any step of a test may take [s]: the machine may be busy.
PATIENCE = 240.0


class Cluster:
    """Scheduler and workers, each a process of its own with its own folder.

    Args:
        folder: Folder of all processes.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._processes = folder, list[subprocess.Popen[bytes]]()
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.address = ""

    def start_scheduler(self) -> None:
        """Start a scheduler and wait for its address."""
        file = self._folder / f"scheduler_{len(self._processes)}.json"
        command = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
        self.scheduler = self._start(*command)
        wait_until(file.is_file)
        wait_until(lambda: file.read_text().endswith("}"))
        self.address = json.loads(file.read_text())["address"]

    def start_worker(self, *options: str, path: Path = ROOT, nanny: bool = False) -> subprocess.Popen[bytes]:
        """Start a worker of one thread.

        Args:
            options: More options of `dask worker`.
            path: Folder of its packages.
            nanny: Whether it is started again when it ends.
        """
        own = ["--nthreads", "1", "--nanny" if nanny else "--no-nanny", "--no-dashboard", "--memory-limit", "0"]
        return self._start("worker", self.address, *own, *options, path=path)

    def wait_for_workers(self, count: int) -> None:
        """Wait until a number of workers have joined."""
        with Client(self.address, timeout=PATIENCE, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=PATIENCE)

    def _start(self, *arguments: str, path: Path = ROOT) -> subprocess.Popen[bytes]:
        folder = self._folder / f"process_{len(self._processes)}"
        folder.mkdir()
        paths = [str(path), *(entry for entry in sys.path if entry and Path(entry) != ROOT)]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments], cwd=folder, env=environment, stdout=log, stderr=log
            )
        self._processes.append(process)
        return process

    def close(self) -> None:
        """Kill all processes."""
        for process in self._processes:
            kill(process)


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[Cluster, list[subprocess.Popen[bytes]]]]:
    """Yield a cluster and its workers, and kill all processes afterwards."""
    made = Cluster(folder)
    try:
        made.start_scheduler()
        yield made, [made.start_worker() for _ in range(workers)]
    finally:
        made.close()


def kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process, without a chance to clean up."""
    if process.poll() is None:
        os.kill(process.pid, signal.SIGKILL)
    process.wait()


def wait_until(condition: Callable[[], bool]) -> None:
    """Wait until a condition holds.

    Raises:
        TimeoutError: It does not hold within PATIENCE.
    """
    end = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"not within {PATIENCE:g} s")
        time.sleep(0.05)
