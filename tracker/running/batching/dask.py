"""Workers of a Dask cluster, also on other machines."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence
from typing import Any

import pydantic
from distributed import Client, LocalCluster, as_completed

from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError
from tracker.running.batching import THREADS, Summary, Task, do, n_cores


@component
class Dask:
    """An existing scheduler, whose workers see the same files. Each worker should have one thread."""

    scheduler: str = ""
    """Address, for instance `tcp://head:8786`; empty for a cluster of this machine's cores."""

    jobs: int = pydantic.Field(default_factory=n_cores, ge=1)
    """Number of workers of a cluster started here."""

    timeout_s: float = pydantic.Field(default=10.0, gt=0)
    """Time to wait for the scheduler, seconds."""

    def work(self, tasks: Sequence[Task]) -> Iterator[Summary]:
        """Submits all tasks."""
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # tells the user's errors with a traceback each
        with contextlib.ExitStack() as closing:
            client = self._connected(closing)
            futures = {client.submit(do, task, pure=False): task for task in tasks}
            try:
                for future in as_completed(list(futures)):
                    yield self._answer(futures[future], future)
            except KeyboardInterrupt:
                client.cancel(list(futures))

    def _connected(self, closing: contextlib.ExitStack) -> Client:
        address = self.scheduler
        if not address:
            cluster = LocalCluster(n_workers=self.jobs, threads_per_worker=1, dashboard_address=None, env=THREADS)
            address = closing.enter_context(cluster).scheduler_address
        try:
            client: Client = Client(address, timeout=self.timeout_s)
            return closing.enter_context(client)
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"--scheduler {address}: no scheduler answers there; start one with `dask scheduler`"
            ) from error

    def _answer(self, task: Task, future: Any) -> Summary:
        """Result of a worker, or why there is none: it died again and again."""
        error = future.exception()
        if error is None:
            summary: Summary = future.result()
            return summary
        fault = " ".join(f"{type(error).__name__}: {error}".split())
        return Summary(task.name, task.folder, "failed", fault=fault[:300])
