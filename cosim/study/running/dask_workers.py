"""Workers on a Dask cluster, and the time limit of their tasks: workers that do not respond are ended."""

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

from cosim.study.definition import Study
from cosim.study.running import workers
from cosim.study.running.evaluator import Coupling, Row
from cosim.study.running.sweep import file_digests, file_paths
from cosim.study.running.workers import Chunk, Program, failed_row, program
from eightpost import __version__
from eightpost.errors import InputError, StepError, WorkersLostError
from eightpost.extras import needs
from eightpost.files import atomic_path, sha256_of

with needs("dask", "a study on a Dask cluster"):
    import dask
    from distributed import Client, KilledWorker, get_worker, wait

#: Share of the time limit after which the cluster is asked again what its workers are doing.
_ASK = 0.1

#: How many times slower than the slowest setup so far a setup may be.
_SLOWER = 10.0

#: Time within which a worker is to be ended [s].
_END = 30.0


class TimeLimit:
    """Ends workers whose task takes too long, whether the process is stopped or an FMU hangs.

    Dask itself only ends workers without a heartbeat, by default after five minutes
    (`distributed.scheduler.worker-ttl`). A worker whose FMU hangs still has one. A worker with a nanny, the default of
    `dask worker`, is started again.

    A task may take the patience and ten times what its setups need at the pace of the slowest one so far. Before any
    setup has run, each is assumed to take as long as the whole choice of the coupling, or else the patience.

    Args:
        patience: Time that a worker may do nothing [s].
    """

    def __init__(self, client: Client, patience: float, report: Callable[[str], None]) -> None:
        self._client, self._patience, self._report = client, patience, report
        self._since: dict[tuple[str, str], float] = {}
        self._asked, self._slowest, self._bound = time.monotonic(), 0.0, patience

    def learn(self, seconds: float) -> None:
        """Take the time of a setup into account [s]."""
        self._slowest = max(self._slowest, seconds)

    def expect(self, seconds: float) -> None:
        """State what a setup takes at most before any has run [s]."""
        self._bound = seconds

    def of(self, setups: int) -> float:
        """Return the time that a task with a number of setups may take [s]."""
        return self._patience + (_SLOWER * self._slowest or self._bound) * setups

    def check(self, tasks: Mapping[str, int]) -> set[str]:
        """End the workers that exceed the time limit, and return the keys of their tasks."""
        now = time.monotonic()
        if now - self._asked < _ASK * self._patience:
            return set()
        self._asked = now
        found = [(address, str(key)) for address, keys in self._client.processing().items() for key in keys]
        held = {pair: self._since.get(pair, now) for pair in found if pair[1] in tasks}
        late = {pair for pair, since in held.items() if now - since > self.of(tasks[pair[1]])}
        ended = {address for address, _ in late}
        self.end(ended)
        self._since = {pair: since for pair, since in held.items() if pair[0] not in ended}
        return {key for _, key in late}

    def end(self, addresses: Iterable[str]) -> None:
        """End workers; the scheduler gives their tasks to others."""
        for address in sorted(addresses):
            self._report(f"worker {address} was not responding for more than {self._patience:g} s and is ended")
            self._client.run_on_scheduler(_end_worker, address=address)


async def _end_worker(address: str, dask_scheduler: Any = None) -> None:
    """End a worker, from the scheduler's process; its nanny starts it again if there is one."""
    try:
        await dask_scheduler.restart_workers(
            [address], timeout=_END, wait_for_workers=False, stimulus_id=f"eightpost-time-limit-{time.time()}"
        )
    except TimeoutError:  # its nanny does not respond either
        await dask_scheduler.remove_worker(address, stimulus_id=f"eightpost-time-limit-{time.time()}")


# ==== Workers on a Dask cluster: FMUs and drive files are sent once to each machine, by digest (docs/how_to/scale.md)

#: Number of chunks submitted per worker, so that no worker is idle.
_SUBMITTED = 2

#: Number of setups whose time limit the choice of the coupling has: it compares several steps and both engines.
_CHOICE = 15

#: Number of times a setup runs alone whose worker did not respond, before it counts as failed.
_TRIES = 2

#: Interval at which a stop is checked [s].
_POLL = 0.5

#: Time within which a result is expected, before the workers are counted again [s].
_FETCH = 3.0

#: Words in the message of an error of a scheduler or worker that lacks this program or has an older version.
_OURS = ("cosim", "eightpost", "deserializ", "_choose()", "_rows()", "_file()")

_RESUME = "Completed chunks are kept; run the study again to resume"


class _LateError(Exception):
    """The worker of a task was ended because it did not respond."""


class DaskWorkers:
    """Workers of a Dask cluster. Workers may join and leave: the tasks of a lost worker are given to another one.

    Args:
        address: Address of the scheduler, `tcp://host:8786`.
        patience: Timeout for the connection [s].
        waiting: Time without any worker after which a study ends, and time without a sign of life after which a worker
            is ended (`TimeLimit`) [s].
        report: Function that receives messages about the cluster, such as that it has no workers.

    Raises:
        InputError: No scheduler answers.
        WorkersLostError: The scheduler has no workers, and none joins.
    """

    def __init__(
        self,
        address: str,
        *,
        patience: float = 30.0,
        waiting: float = workers.PATIENCE,
        report: Callable[[str], None] = lambda _text: None,
    ) -> None:
        try:
            self._client = Client(address, timeout=patience, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"--workers {address}: no Dask scheduler answers: {error}") from error
        self._address, self._waiting, self._report = address, waiting, report
        self._patience = patience
        self._parcels: dict[str, tuple[str, Mapping[str, Any]]] = {}
        self._told: set[str] = set()
        self._alone_since: float | None = None
        self._limit = TimeLimit(self._client, waiting, report)
        self._tasks: dict[str, int] = {}
        self.count = 0
        try:
            while not self._presence():
                time.sleep(_POLL)
        except WorkersLostError:
            self.close()
            raise

    def choose(self, study: Study) -> Coupling:
        """Choose the coupling of a study on a worker.

        Raises:
            StepError: No setup could be run, an FMU crashed, or the cluster was lost.
        """
        text, files = self._parcel(study)
        future = self._submit(_choose, text, files, program())
        self._tasks, began = {str(future.key): _CHOICE}, time.monotonic()
        try:
            coupling: Coupling = self._result(future)
        except KilledWorker as error:
            raise StepError(f"workers ended while choosing the coupling, so an FMU crashes ({error})") from error
        except _LateError as error:
            raise StepError(
                f"a worker was not responding for more than {self._waiting:g} s while it chose the coupling, so an FMU "
                "hangs. Find it with `eightpost check` and `eightpost run --isolate`, and remove it from the bank"
            ) from error
        self._limit.expect(time.monotonic() - began)
        return coupling

    def rows(
        self, study: Study, coupling: Coupling, chunks: Iterable[Chunk], stop: Callable[[], bool]
    ) -> Iterator[tuple[Chunk, list[Row]]]:
        """Run chunks and yield their rows as they complete; no chunk is started after `stop` returns True.

        Raises:
            WorkersLostError: The scheduler has ended, there were no workers for a long time, or a worker has another
                version of the program.
        """
        waiting, running = iter(chunks), dict[Any, Chunk]()
        while True:
            stopped, count = stop(), self._presence()
            room = 0 if stopped else count * _SUBMITTED - len(running)
            for chunk in islice(waiting, max(0, room)):
                running[self._rows_of(study, coupling, chunk.indices)] = chunk
            # Without workers, pending chunks wait for new ones, unless the study is to stop.
            if (not running and (count or stopped)) or (stopped and not count):
                return
            self._tasks = {str(future.key): len(chunk.indices) for future, chunk in running.items()}
            late = self._end_late_workers()
            for future in [one for one in running if str(one.key) in late]:
                future.cancel()
                chunk = running.pop(future)
                yield chunk, self._one_by_one(study, coupling, chunk)
            for future in self._finished(running):
                chunk = running.pop(future)
                yield chunk, self._known(study, coupling, future, chunk)

    def close(self) -> None:
        """Disconnect from the cluster, which continues to run."""
        self._client.close()

    def _count_now(self) -> int:
        """Return the number of threads of the current workers; workers may join and leave."""
        if self._client.status != "running":
            self._say(
                f"{self._address}: the connection to the scheduler is lost; trying again for {self._patience:g} s"
            )
        try:
            return sum(self._client.nthreads().values())
        except (OSError, TimeoutError) as error:
            raise self._lost(error) from error

    def _presence(self) -> int:
        """Return the number of threads of the current workers; report if no worker is connected."""
        count, now = self._count_now(), time.monotonic()
        if count:
            if self._alone_since is not None:
                self._report(f"{self._address}: {count} workers have joined")
            self.count, self._alone_since = count, None
        elif self._alone_since is None:
            self._alone_since = now
            self._report(
                f"{self._address}: there are no workers; waiting {self._waiting:g} s for some (dask worker "
                f"{self._address})"
            )
        elif now - self._alone_since > self._waiting:
            raise WorkersLostError(
                f"--workers {self._address}: there were no workers for {self._waiting:g} s. {_RESUME} when there are "
                f"workers (dask worker {self._address})"
            )
        return count

    def _end_late_workers(self) -> set[str]:
        """End the workers that do not respond, and return the keys of their tasks."""
        try:
            return self._limit.check(self._tasks)
        except (OSError, TimeoutError) as error:
            raise self._lost(error) from error

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return self._client.submit(function, *arguments, pure=False)

    def _rows_of(self, study: Study, coupling: Coupling, indices: Sequence[int]) -> Any:
        text, files = self._parcel(study)
        return self._submit(_rows, text, files, program(), coupling, indices)

    def _finished(self, running: Collection[Any]) -> list[Any]:
        """Wait briefly for a task to finish; return the finished ones."""
        if not running:  # there are no workers
            time.sleep(_POLL)
        try:
            with suppress(TimeoutError), self._client.as_current():
                wait(list(running), timeout=_POLL, return_when="FIRST_COMPLETED")
        except CancelledError as error:  # the client has lost its scheduler, and all tasks with it
            raise self._lost(error) from error
        return [future for future in running if future.done()]

    def _result(self, future: Any) -> Any:
        began = time.monotonic()
        try:
            # A finished task runs again if the only worker that has its result dies before the result is fetched.
            while (answer := self._answer(future)) is None:
                self._presence()
                if str(future.key) in self._end_late_workers():
                    future.cancel()
                    raise _LateError(future.key)
                if future.done() and time.monotonic() - began > self._waiting:  # who has the result does not send it
                    self._limit.end({one for found in self._client.who_has([future]).values() for one in found})
                    began = time.monotonic()
            return answer
        except (CancelledError, OSError) as error:
            raise self._lost(error) from error
        except (ImportError, AttributeError, TypeError, RuntimeError) as error:
            if not any(word in str(error) for word in _OURS):
                raise
            raise WorkersLostError(
                f"--workers {self._address}: the scheduler or a worker cannot run this study "
                f"({type(error).__name__}: {error}): install eightpost {__version__} there, as here. {_RESUME}"
            ) from error

    def _answer(self, future: Any) -> Any:
        """Return the result of a task; None if it does not come within some seconds."""
        try:
            return future.result(timeout=_FETCH)
        except TimeoutError:
            return None

    def _known(self, study: Study, coupling: Coupling, future: Any, chunk: Chunk) -> list[Row]:
        """Return the rows of a chunk; if workers died of it or did not respond, run its setups again one by one."""
        try:
            return self._heard(self._result(future))
        except (KilledWorker, _LateError):
            return self._one_by_one(study, coupling, chunk)

    def _one_by_one(self, study: Study, coupling: Coupling, chunk: Chunk) -> list[Row]:
        """Run the setups of a chunk again one by one, to find the one that ends workers."""
        return [self._alone(study, coupling, index) for index in chunk.indices]

    def _alone(self, study: Study, coupling: Coupling, index: int) -> Row:
        for _ in range(_TRIES):
            future = self._rows_of(study, coupling, (index,))
            self._tasks[str(future.key)] = 1
            try:
                return self._heard(self._result(future))[0]
            except KilledWorker:
                return failed_row(study, index)
            except _LateError:
                continue
        hangs = f"{_TRIES} workers were ended because they were not responding for {self._waiting:g} s while they ran"
        return failed_row(study, index, f"{hangs} only this setup, so one of its FMUs hangs")

    def _heard(self, answer: tuple[list[Row], str]) -> list[Row]:
        """Return the rows of an answer, and report what its worker says."""
        rows, text = answer
        for row in rows:
            self._limit.learn(row["seconds"])
        self._say(text)
        return rows

    def _say(self, text: str) -> None:
        """Report a message if it is not empty, each message once."""
        if text and text not in self._told:
            self._told.add(text)
            self._report(text)

    def _lost(self, error: BaseException) -> WorkersLostError:
        return WorkersLostError(
            f"--workers {self._address}: the Dask scheduler has ended ({type(error).__name__}). {_RESUME}"
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


def _choose(study: str, files: Mapping[str, bytes], expected: Program) -> Coupling:
    _check_program(expected)
    return workers.choose(unpack(study, files))


def _rows(
    study: str, files: Mapping[str, bytes], expected: Program, coupling: Coupling, indices: Sequence[int]
) -> tuple[list[Row], str]:
    """Run setups by number; return their rows and a message about this worker, which is empty in most cases."""
    _check_program(expected)
    here = unpack(study, files)
    rows = workers.rows(here, coupling, indices)
    found = []
    if reason := workers.batch_refusal(here, coupling):
        found.append(f"runs its setups through the FMUs, whose measures differ within the coupling errors: {reason}")
    if others := program().other_libraries(expected):
        found.append(f"has {others}, so the last digits of measures may differ")
    return rows, f"worker {_place()} {'; it '.join(found)}" if found else ""


def _check_program(expected: Program) -> None:
    if difference := program().difference(expected):
        raise WorkersLostError(
            f"worker {_place()} has {difference}, as where the study was started: install the same one on it, or stop "
            f"it. {_RESUME}"
        )


def _place() -> str:
    try:
        return str(get_worker().address)
    except ValueError:
        return "here"


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
