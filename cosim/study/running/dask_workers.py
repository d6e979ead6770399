"""Workers on a Dask cluster: FMUs and drive files are sent once to each machine, by digest (docs/scale.md)."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from cosim.study.running import workers
from cosim.study.running.chunks import file_digests, file_paths
from cosim.study.running.evaluator import Coupling, Row
from cosim.study.running.workers import Chunk, failed_row
from cosim.study.study import Study
from eightpost.errors import InputError, StepError
from eightpost.files import atomic_path, sha256_of

try:
    import dask
    from distributed import Client, KilledWorker, get_worker, wait
except ImportError as error:  # an optional extra
    raise InputError(f"a Dask cluster needs the extra dask ({error}): pip install 'eightpost[dask]'") from error

#: Number of chunks submitted per worker, so that no worker is idle.
_SUBMITTED = 2

#: Interval at which a stop is checked [s].
_POLL = 0.5


class DaskWorkers:
    """Workers of a Dask cluster. Workers may join and leave: the tasks of a lost worker are given to another one.

    Args:
        address: Address of the scheduler, `tcp://host:8786`.
        patience: Timeout for the connection [s].

    Raises:
        InputError: No scheduler answers, or it has no workers.
    """

    def __init__(self, address: str, *, patience: float = 10.0) -> None:
        try:
            self._client = Client(address, timeout=patience, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"--scheduler {address}: no Dask scheduler answers: {error}") from error
        self._address = address
        self._parcels: dict[str, tuple[str, Mapping[str, Any]]] = {}
        if not self.count:
            self.close()
            raise InputError(f"--scheduler {address}: the scheduler has no workers; start some (dask worker {address})")

    @property
    def count(self) -> int:
        """Number of threads of the current workers; workers may join and leave."""
        return sum(self._client.nthreads().values())

    def choose(self, study: Study) -> Coupling:
        """Choose the coupling of a study on a worker.

        Raises:
            StepError: No setup could be run, an FMU crashed, or the scheduler has ended.
        """
        future = self._submit(_choose, *self._parcel(study))
        try:
            coupling: Coupling = self._result(future)
        except KilledWorker as error:
            raise StepError(f"workers ended while choosing the coupling, so an FMU crashes ({error})") from error
        return coupling

    def rows(
        self, study: Study, coupling: Coupling, chunks: Iterable[Chunk], stop: Callable[[], bool]
    ) -> Iterator[tuple[Chunk, list[Row]]]:
        """Run chunks and yield their rows as they complete; no chunk is started after `stop` returns True.

        Raises:
            StepError: The scheduler has ended.
        """
        waiting, running = iter(chunks), dict[Any, Chunk]()
        while True:
            stopped, count = stop(), self._count_now()
            room = 0 if stopped else count * _SUBMITTED - len(running)
            for chunk in islice(waiting, max(0, room)):
                running[self._rows_of(study, coupling, chunk.indices)] = chunk
            # Without workers, pending chunks wait for new ones, unless the study is to stop.
            if (not running and (count or stopped)) or (stopped and not count):
                return
            for future in self._finished(running):
                chunk = running.pop(future)
                yield chunk, self._known(study, coupling, future, chunk)

    def close(self) -> None:
        """Disconnect from the cluster, which continues to run."""
        self._client.close()

    def _count_now(self) -> int:
        """Return the number of threads of the current workers.

        Raises:
            StepError: The scheduler has ended.
        """
        try:
            return self.count
        except (OSError, TimeoutError) as error:
            raise self._lost(error) from error

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return self._client.submit(function, *arguments, pure=False)

    def _rows_of(self, study: Study, coupling: Coupling, indices: Sequence[int]) -> Any:
        text, files = self._parcel(study)
        return self._submit(_rows, text, files, coupling, indices)

    def _finished(self, running: Collection[Any]) -> list[Any]:
        """Wait briefly for a task to finish; return the finished ones."""
        if not running:  # there are no workers
            time.sleep(_POLL)
        with suppress(TimeoutError), self._client.as_current():
            wait(list(running), timeout=_POLL, return_when="FIRST_COMPLETED")
        return [future for future in running if future.done()]

    def _result(self, future: Any) -> Any:
        try:
            return future.result()
        except (CancelledError, OSError) as error:
            raise self._lost(error) from error

    def _known(self, study: Study, coupling: Coupling, future: Any, chunk: Chunk) -> list[Row]:
        """Return the rows of a chunk; if several workers died of it, run its setups again one by one."""
        try:
            return list(self._result(future))
        except KilledWorker:
            return [self._alone(study, coupling, index) for index in chunk.indices]

    def _alone(self, study: Study, coupling: Coupling, index: int) -> Row:
        try:
            row: Row = self._result(self._rows_of(study, coupling, (index,)))[0]
        except KilledWorker:
            return failed_row(study, index)
        return row

    def _lost(self, error: BaseException) -> StepError:
        return StepError(
            f"--scheduler {self._address}: the Dask scheduler has ended ({type(error).__name__}). Completed chunks are "
            "kept; run the study again to resume"
        )

    def _parcel(self, study: Study) -> tuple[str, Mapping[str, Any]]:
        """Return the study with digests as paths, and its files by digest, each stored once on the cluster.

        Each file is the result of a task: the scheduler keeps the task's input and can compute the result again on
        another worker if the last worker that had it dies. Scattered data would be lost.
        """
        text = study.to_json()
        if text not in self._parcels or any(file.status == "error" for file in self._parcels[text][1].values()):
            digests = file_digests(study)
            with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}):
                files = {digest: self._submit(_file, Path(path).read_bytes()) for path, digest in digests.items()}
            self._parcels[text] = (by_digest(study, digests).to_json(), files)
        return self._parcels[text]


def _file(content: bytes) -> bytes:
    return content


def _choose(study: str, files: Mapping[str, bytes]) -> Coupling:
    return workers.choose(unpack(study, files))


def _rows(study: str, files: Mapping[str, bytes], coupling: Coupling, indices: Sequence[int]) -> list[Row]:
    return workers.rows(unpack(study, files), coupling, indices)


@cache
def _folder() -> Path:
    """Return this worker's folder of files by digest."""
    try:
        return Path(get_worker().local_directory) / "eightpost"
    except ValueError:
        return Path(tempfile.mkdtemp(prefix="eightpost_"))


def by_digest(study: Study, digests: Mapping[str, str]) -> Study:
    """Return the study with the digest of every file as its path."""
    return _with_paths(study, {path: f"{digest}{Path(path).suffix}" for path, digest in digests.items()})


def unpack(study: str, files: Mapping[str, bytes]) -> str:
    """Return the study with paths of this machine; files that are missing here are written."""
    read, folder = Study.from_json(study), _folder()
    names = [str(path) for path in file_paths(read)]
    for name in names:
        path, digest = folder / name, Path(name).stem
        if not path.is_file() or sha256_of(path) != digest:
            with atomic_path(path) as temporary:
                temporary.write_bytes(files[digest])
    return _with_paths(read, {name: str(folder / name) for name in names}).to_json()


def _with_paths(study: Study, names: Mapping[str, str]) -> Study:
    """Return the study with other paths of its files."""

    def to(path: Path) -> Path:
        return Path(names[str(path)])

    def function(entry: str) -> str:
        file, colon, name = entry.rpartition(":")
        return f"{names[file]}{colon}{name}" if file else ""

    return replace(
        study,
        vehicle=replace(study.vehicle, fmu=to(study.vehicle.fmu)),
        bank={name: replace(build, fmu=to(build.fmu)) for name, build in study.bank.items()},
        drives=tuple(
            replace(d, file=to(d.file), channel_map=to(d.channel_map) if d.channel_map else None) for d in study.drives
        ),
        measures=tuple(replace(m, function=function(m.function)) for m in study.measures),
    )
