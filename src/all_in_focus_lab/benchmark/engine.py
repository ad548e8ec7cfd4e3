# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where tasks run: in this process, in processes of this machine, or on the workers of a Dask scheduler.

An engine has run(calls), calls: key -> (function, arguments): it yields (key, result) as they come, in any order. What
the function raises, or a lost worker, comes as result {"error": one line, ...}. EngineError ends everything.
"""
import logging
import platform
import tempfile
import time
from concurrent.futures import CancelledError
from contextlib import contextmanager, nullcontext

from all_in_focus.files.errors import one_line

POLL_S = 0.1
PATIENCE_S = 60.0  # without any worker, before it is given up
ANSWER_S = 10.0    # for a scheduler to answer
LOST = "the connection to the Dask scheduler was lost"


class EngineError(RuntimeError):
    """Tasks cannot be run any more; the message is one line."""


@contextmanager
def engine(jobs, scheduler, say=lambda line: None):
    """jobs: processes of this machine; scheduler: address such as tcp://host:8786, or empty; say(line): called for
    every worker that is lost."""
    if jobs == 1 and not scheduler:
        yield InProcess()
        return
    try:
        import distributed
    except ImportError:
        option = "--scheduler" if scheduler else "--jobs"
        raise EngineError(f"{option} needs Dask: install python3-distributed, or leave it out")
    for name in list(logging.root.manager.loggerDict):  # lost connections are reported here, in one line
        if name.partition(".")[0] in ("distributed", "asyncio", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    with nullcontext(scheduler) if scheduler else _local_cluster(distributed, jobs) as cluster:
        try:
            client = distributed.Client(cluster, timeout=ANSWER_S)
        except (OSError, ValueError, TimeoutError) as error:
            raise EngineError(f"{scheduler}: no Dask scheduler answers: {' '.join(str(error).split())}")
        try:
            if not scheduler:
                client.wait_for_workers(jobs)
            yield OnWorkers(client, say)
        finally:
            client.close(timeout=ANSWER_S)


@contextmanager
def _local_cluster(distributed, jobs):
    """Workers on this machine that nobody else can reach or look at: Dask itself asks for no password."""
    import dask

    loopback = "127.0.0.1:0"
    # Newer schedulers have a folder of files, too, and take its place from the configuration only.
    with tempfile.TemporaryDirectory(prefix="evaluate.") as folder, dask.config.set({"temporary-directory": folder}):
        cluster = distributed.LocalCluster(n_workers=0, threads_per_worker=1, host="127.0.0.1", memory_limit=None,
                                           dashboard_address=loopback, worker_dashboard_address=loopback,
                                           scheduler_kwargs={"dashboard": False}, local_directory=folder,
                                           silence_logs=logging.CRITICAL)
        try:
            cluster.new_spec["options"]["dashboard"] = False
            cluster.scale(jobs)
            yield cluster
        finally:
            cluster.close(timeout=ANSWER_S)


def outcome(function, *arguments):
    """What the function returns; {"error": one line, "host"} for an exception of any kind: the other tasks must go on."""
    try:
        return function(*arguments)
    except Exception as error:
        return {"error": one_line(error), "host": platform.node()}


class InProcess:
    """One task after the other."""
    at_a_time = 1

    def run(self, calls):
        for key, (function, arguments) in calls.items():
            yield key, outcome(function, *arguments)


class OnWorkers:
    """On whatever workers the scheduler has; a task whose worker is lost goes to another one, three times at most."""

    def __init__(self, client, say):
        self._client, self._say = client, say
        self._last_seen, self._known = time.monotonic(), {}
        self.at_a_time = max(1, sum(worker["nthreads"] for worker in self._workers().values()))

    def run(self, calls):
        self._last_seen = time.monotonic()
        waiting = {self._client.submit(outcome, function, *arguments, pure=False): key
                   for key, (function, arguments) in calls.items()}
        try:
            while waiting:
                self._check()
                done = [future for future in waiting if future.done()]
                for future in done:
                    yield waiting.pop(future), self._result(future)
                if not done:
                    time.sleep(POLL_S)
        finally:
            if waiting and self._client.status == "running":
                self._client.cancel(list(waiting))

    def _result(self, future):
        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker
        try:
            return future.result(timeout=PATIENCE_S)
        except KilledWorker:
            return {"error": "every worker that took this task was lost: see the workers' logs, memory first"}
        except (CancelledError, CommClosedError):  # only for a client that has lost its scheduler
            raise EngineError(LOST)
        except Exception as error:
            self._check()
            return {"error": one_line(error)}

    def _workers(self):
        return self._client.scheduler_info().get("workers", {})

    def _check(self):
        """Tells which workers are lost. EngineError when the scheduler, or the last worker, has been gone for too long."""
        if self._client.status == "closed":
            raise EngineError(LOST)
        now, running = time.monotonic(), self._client.status == "running"
        if running:
            workers = self._workers()
            for address in sorted(set(self._known) - set(workers)):
                self._say(f"Dask worker {address} is lost; its tasks go to others")
            self._known = workers
        if running and self._known:
            self._last_seen = now
        elif now - self._last_seen > PATIENCE_S:
            raise EngineError(f"no Dask worker for {PATIENCE_S:g} s" if running else LOST)
