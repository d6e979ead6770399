"""Other engines, each run in a separate process; engines that are not installed are omitted with a note."""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.engines.job import Diverged, Job, Recording

ROOT = Path(__file__).resolve().parents[2]
#: Time limit of a process [s].
PATIENCE = 900.0


@dataclass(frozen=True)
class Peer:
    """Engine: its module here, the package that must be installed, the table's name and schemes, and a note."""

    module: str
    package: str
    engine: str
    schemes: tuple[str, ...]
    note: str
    slow: bool = False

    @property
    def version(self) -> str:
        """Version of the installed package; empty if it is not installed."""
        try:
            return importlib.metadata.version(self.package)
        except importlib.metadata.PackageNotFoundError:
            return ""


HELD = ("jacobi, held",)
RAMPED = ("jacobi, extrapolated", "gauss-seidel, extrapolated", "gauss-seidel, parabolic")
PEERS = (
    Peer(
        "c_loop", "ziglang", "C loop", (*HELD, *RAMPED),
        "not an engine: a loop in C over the same FMUs, nothing else (benchmarks/engines/master.c, compiled by zig), "
        "the lower limit for an engine; time of the loop alone, in which it records every step",
    ),
    Peer(
        "fmpy_loop", "fmpy", "fmpy", (*HELD, *RAMPED),
        "a loop over fmpy's FMU2Slave; the arrays for its calls are created once; except with `held` it sets input "
        "derivatives, also for the road; time of the loop alone",
    ),
    Peer(
        "fmpy_ssp", "fmpy", "fmpy-ssp", HELD,
        "fmpy.ssp.simulation.simulate_ssp. The drive reaches the car a step late, and its rows contain the start time "
        "of a step with the values of its end: the two cancel; it starts with every input at 0; time of "
        "its steps alone",
        slow=True,
    ),
    Peer(
        "libcosim", "libcosimpy", "libcosim", HELD,
        "libcosimpy: all steps in one call, time-series observer, the drive from a sixth FMU in C (a manipulator that "
        "Python calls at each step would cost more); time of that call alone. Its adaptive algorithm ECCO is omitted: "
        "its steps do not begin where the previous ones ended, which these FMUs refuse",
    ),
    Peer(
        "ecos", "ecospy", "ecos", HELD,
        "ecospy in process: all steps in one call, its CSV writer, the drive from a sixth FMU in C; time of that call "
        "alone",
    ),
    Peer(
        "fmu_container", "fmu-manipulation-toolbox", "fmu-container", (*HELD, "gauss-seidel, held"),
        "one FMU that holds all five, stepped at its inner step by an fmpy loop that sets the drive and reads the "
        "outputs; gauss-seidel is its option `sequential`; time of the loop alone",
    ),
)  # fmt: skip

#: Engines that are not available, with the reason.
ABSENT = (
    "PyFMI and OMSimulator: pip finds no wheels of them (`pip download --only-binary=:all:`), so they are omitted",
)


def run_peer(peer: Peer, jobs: Sequence[Job]) -> Iterator[Recording | Diverged]:
    """Run the jobs in a separate process; if it ends while components step, that run diverged.

    Raises:
        RuntimeError: The engine could not be set up.
    """
    waiting = list(jobs)
    while waiting:
        ended = _work(peer, waiting)
        while waiting and (found := _outcome(waiting[0])) is not None:
            waiting.pop(0)
            yield found
        if not waiting:
            return
        if not (Path(waiting[0].work) / "stepping").exists():
            raise RuntimeError(f"{peer.engine} could not run: {ended.stderr.strip()[-2000:]}")
        waiting.pop(0)
        yield Diverged(f"the process ended with {ended.returncode}: {ended.stderr.strip()[-300:]}")


def _work(peer: Peer, jobs: Sequence[Job]) -> subprocess.CompletedProcess[str]:
    text = json.dumps([asdict(job) for job in jobs])
    line = [sys.executable, "-m", "benchmarks.engines.worker", peer.module, text]
    return subprocess.run(
        line, cwd=ROOT, env=_environment(), capture_output=True, text=True, check=False, timeout=PATIENCE
    )


def _outcome(job: Job) -> Recording | Diverged | None:
    recording, diverged = Path(job.work) / "recording.npz", Path(job.work) / "diverged.txt"
    if recording.exists():
        return Recording.load(recording)
    return Diverged(diverged.read_text(encoding="utf-8")) if diverged.exists() else None


def _environment() -> Mapping[str, str]:
    """Make TBB's library available to ecos, whose wheel does not contain it."""
    try:
        files = importlib.metadata.files("tbb") or ()
    except importlib.metadata.PackageNotFoundError:
        files = ()
    folders = [str(Path(str(f.locate())).resolve().parent) for f in files if f.name == "libtbb.so.12"]
    there = [os.environ["LD_LIBRARY_PATH"]] if os.environ.get("LD_LIBRARY_PATH") else []
    return os.environ | {"LD_LIBRARY_PATH": os.pathsep.join([*folders, *there]), "OMP_NUM_THREADS": "1"}
