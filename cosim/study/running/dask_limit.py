"""Time limit of the tasks of a Dask cluster: workers that do not respond are ended, and others run their tasks."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from eightpost.extras import needs

with needs("dask", "a study on a Dask cluster"):
    from distributed import Client

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
        client: Client of the cluster.
        patience: Time that a worker may do nothing [s].
        report: Function that receives messages about workers that are ended.
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
        """End the workers that exceed the time limit, and return the keys of their tasks.

        Args:
            tasks: Number of setups of each running task by its key.
        """
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
