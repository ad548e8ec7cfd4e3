# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tasks on other processes give the results of one process, also when a worker is killed in the middle."""
import re
import signal
import socket
import subprocess
import sys
import time

import pytest
from evaluate_helpers import METHODS, environment, evaluate, make_scene, results, start

LOST_WORKER = r"evaluate: warning: Dask worker tcp://\S+ is lost; its tasks go to others"

distributed = pytest.importorskip("distributed", reason="NOT TESTED ON A CLUSTER: python3-distributed is not installed")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    return [make_scene(folder / ("%s_%d" % (name, seed)), name, seed)
            for name in ("planes", "clutter") for seed in (0, 1)]


@pytest.fixture(scope="module")
def alone(scenes, tmp_path_factory):
    """Results of one process."""
    folder = tmp_path_factory.mktemp("alone")
    code, _, err = evaluate(*scenes, "--methods", METHODS, "--output", folder)
    assert (code, err) == (0, "")
    return folder


class Cluster:
    """A scheduler and workers as people start them by hand."""

    def __init__(self, folder, workers):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.address = "tcp://127.0.0.1:%d" % probe.getsockname()[1]
        self._folder, self.processes = folder, []
        port = self.address.rpartition(":")[2]
        self._start("dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
        self.workers = [self.add_worker() for _ in range(workers)]

    def _start(self, program, *arguments):
        log = open(str(self._folder / ("%s_%d.log" % (program, len(self.processes)))), "w")
        self.processes.append(subprocess.Popen([sys.executable, "-m", "distributed.cli." + program, *arguments],
                                               stdout=log, stderr=log, env=environment(), cwd=str(self._folder)))
        return self.processes[-1]

    def add_worker(self):
        return self._start("dask_worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard",
                           "--local-directory", str(self._folder))

    def end(self):
        for process in reversed(self.processes):
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path):
    started = Cluster(tmp_path, 2)
    yield started
    started.end()


def expect_same(folder, alone):
    """Same images, byte for byte, same numbers but for the last bit of LAPACK's, which depends on its threads."""
    found, expected = results(folder), results(alone)
    assert found["failures"] == [] and found["results"].keys() == expected["results"].keys()
    for scene, of in expected["results"].items():
        assert found["results"][scene].keys() == of.keys()
        for method, result in of.items():
            assert found["results"][scene][method]["values"] == pytest.approx(result["values"], rel=1e-13, abs=0)
    images = sorted(path.relative_to(alone) for path in (alone / "results").rglob("*.png"))
    assert images == sorted(path.relative_to(folder) for path in (folder / "results").rglob("*.png"))
    assert [str(path) for path in images if (folder / path).read_bytes() != (alone / path).read_bytes()] == []


def test_a_killed_worker_loses_nothing(scenes, alone, cluster, tmp_path):
    run = start(*scenes, "--methods", METHODS, "--output", tmp_path / "out", "--scheduler", cluster.address)
    try:
        deadline = time.monotonic() + 120
        while not list(tmp_path.glob("out/results/*/*/result.json")):
            assert run.poll() is None and time.monotonic() < deadline, run.communicate()
            time.sleep(0.01)
        cluster.workers[0].send_signal(signal.SIGKILL)
        cluster.workers[0].wait()
        done = len(list(tmp_path.glob("out/results/*/*/result.json")))
        out, err = run.communicate(timeout=300)
    finally:
        run.kill()
    total = len(scenes) * len(METHODS.split(","))
    print("%d of %d results were there when the worker was gone" % (done, total))
    assert 0 < done < total
    assert run.returncode == 0 and "2 tasks ran side by side" in out
    assert re.fullmatch(LOST_WORKER + "\n", err), err
    expect_same(tmp_path / "out", alone)


def test_a_lost_scheduler_is_told_and_the_run_goes_on_later(scenes, alone, cluster, tmp_path):
    arguments = [*scenes, "--methods", METHODS, "--output", tmp_path / "out"]
    run = start(*arguments, "--scheduler", cluster.address)
    deadline = time.monotonic() + 120
    while not list(tmp_path.glob("out/results/*/*/result.json")):
        assert run.poll() is None and time.monotonic() < deadline, run.communicate()
        time.sleep(0.01)
    cluster.end()
    try:
        out, err = run.communicate(timeout=150)
    finally:
        run.kill()
    lines = [line for line in err.splitlines() if not re.search(LOST_WORKER, line)]  # the workers may be missed first
    assert (run.returncode, out, lines) == (2, "", ["evaluate: the connection to the Dask scheduler was lost"])
    assert evaluate(*arguments)[0] == 0
    expect_same(tmp_path / "out", alone)


def test_jobs_on_this_machine(scenes, alone, tmp_path):
    code, out, err = evaluate(*scenes, "--methods", METHODS, "--output", tmp_path / "out", "--jobs", 2)
    assert (code, err) == (0, "") and "2 tasks ran side by side" in out
    expect_same(tmp_path / "out", alone)
