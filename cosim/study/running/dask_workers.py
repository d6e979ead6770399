"""Workers on a Dask cluster: FMUs and drivefiles travel once to each machine, by what is in them (docs/scale.md)."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from cosim.study.running import work
from cosim.study.running.digest import file_digests, file_paths
from cosim.study.running.evaluator import Coupling, Row
from cosim.study.running.workers import Chunk, lost_row
from cosim.study.study import Study
from eightpost.errors import InputError, StepError
from eightpost.files import atomic_path, sha256_of

try:
    from distributed import Client, KilledWorker, as_completed, get_worker
except ImportError as error:  # an optional extra
    raise InputError(f"a Dask cluster needs the extra dask ({error}): pip install 'eightpost[dask]'") from error

#: Chunks that wait for each worker, so that none stands idle.
_AHEAD = 2

#: How often a stop is looked for [s].
_LOOK = 0.5


class DaskWorkers:
    """The workers of a Dask cluster. A chunk whose worker dies is run again by another.

    Args:
        address: Of the scheduler, `tcp://host:8786`.
        patience: How long to wait for its answer [s].

    Raises:
        InputError: There is no scheduler, or it has no workers.
    """

    def __init__(self, address: str, *, patience: float = 10.0) -> None:
        try:
            self._client = Client(address, timeout=patience, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"--scheduler {address}: no Dask scheduler answers: {error}") from error
        self._parcels: dict[str, tuple[str, Mapping[str, Any]]] = {}
        if not self.count:
            self.close()
            raise InputError(f"--scheduler {address}: the scheduler has no workers; begin some (dask worker {address})")

    @property
    def count(self) -> int:
        """How many threads and processes run at once, now: workers may come and go."""
        return sum(self._client.nthreads().values())

    def choose(self, study: Study) -> Coupling:
        """Choose the coupling of a study on a worker.

        Raises:
            StepError: No setup could be run, or an FMU crashed.
        """
        try:
            future = self._client.submit(_choose, *self._parcel(study), pure=False)
            coupling: Coupling = future.result()
        except KilledWorker as error:
            raise StepError(f"workers died while they chose the coupling: an FMU crashes ({error})") from error
        return coupling

    def rows(
        self, study: Study, coupling: Coupling, chunks: Sequence[Chunk], stop: Callable[[], bool]
    ) -> Iterator[tuple[Chunk, list[Row]]]:
        """Run chunks and give their rows as they come; none is begun once `stop` says so."""
        text, files = self._parcel(study)
        waiting, known = iter(chunks), dict[str, Chunk]()
        running = as_completed(loop=self._client.loop)
        while True:
            room = 0 if stop() else self.count * _AHEAD - len(known)
            for chunk in islice(waiting, max(0, room)):
                future = self._client.submit(_rows, text, files, coupling, chunk.indices, pure=False)
                known[future.key] = chunk
                running.add(future)
            if not known:
                return
            future = next(running)
            chunk = known.pop(future.key)
            yield chunk, self._rows_of(study, future, chunk)

    def close(self) -> None:
        """Leave the cluster; it goes on without this process."""
        self._client.close()

    def _rows_of(self, study: Study, future: Any, chunk: Chunk) -> list[Row]:
        """Rows of a chunk; where it killed several workers, an FMU of it crashes."""
        try:
            rows: list[Row] = future.result()
        except KilledWorker:
            return [lost_row(study, index) for index in chunk.indices]
        return rows

    def _parcel(self, study: Study) -> tuple[str, Mapping[str, Any]]:
        """A study whose paths are digests, and what is in its files, once on the cluster."""
        text = study.to_json()
        if text not in self._parcels:
            digests = file_digests(study)
            contents = {digest: Path(path).read_bytes() for path, digest in digests.items()}
            scattered = self._client.scatter(contents, broadcast=True)
            self._parcels[text] = (by_digest(study, digests).to_json(), scattered)
        return self._parcels[text]


def _choose(study: str, files: Mapping[str, bytes]) -> Coupling:
    return work.choose(unpacked(study, files))


def _rows(study: str, files: Mapping[str, bytes], coupling: Coupling, indices: Sequence[int]) -> list[Row]:
    return work.rows(unpacked(study, files), coupling, indices)


@cache
def _folder() -> Path:
    """Where this worker keeps files, by digest."""
    try:
        return Path(get_worker().local_directory) / "eightpost"
    except ValueError:
        return Path(tempfile.mkdtemp(prefix="eightpost_"))


def by_digest(study: Study, digests: Mapping[str, str]) -> Study:
    """Return the study with every file called by its digest."""
    return _moved(study, {path: f"{digest}{Path(path).suffix}" for path, digest in digests.items()})


def unpacked(study: str, files: Mapping[str, bytes]) -> str:
    """Return the study with paths of this machine, on which its files are written where they are not yet."""
    read, folder = Study.from_json(study), _folder()
    names = [str(path) for path in file_paths(read)]
    for name in names:
        path, digest = folder / name, Path(name).stem
        if not path.is_file() or sha256_of(path) != digest:
            with atomic_path(path) as temporary:
                temporary.write_bytes(files[digest])
    return _moved(read, {name: str(folder / name) for name in names}).to_json()


def _moved(study: Study, names: Mapping[str, str]) -> Study:
    """The study with its files elsewhere."""

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
