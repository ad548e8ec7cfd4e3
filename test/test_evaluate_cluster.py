# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tasks on other processes give the results of one process, also when a worker is killed in the middle."""
import http.client
import re
import signal
import subprocess
import sys
import tempfile
import urllib.request

import pytest
from evaluate_helpers import DASK, METHODS, evaluate, make_scene, results, start_evaluate
from file_helpers import environment, run_script, wait_for
from tool_helpers import succeeded

from all_in_focus.replay.launch import free_port
from all_in_focus_lab.benchmark.engine import engine

LOST_WORKER = r"evaluate: warning: Dask worker tcp://\S+ is lost; its tasks go to others"

distributed = pytest.importorskip("distributed", reason="NOT TESTED ON A CLUSTER: python3-distributed is not installed")
psutil = pytest.importorskip("psutil")  # comes with it
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    return [make_scene(folder / f"{name}_{seed}", name, seed)
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
        port = str(free_port())
        self.address = f"tcp://127.0.0.1:{port}"
        self._folder, self.processes = folder, []
        self._start("dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
        self.workers = [self.add_worker() for _ in range(workers)]

    def _start(self, program, *arguments):
        log = (self._folder / f"{program}_{len(self.processes)}.log").open("w")
        self.processes.append(subprocess.Popen([sys.executable, "-m", "distributed.cli." + program, *arguments],
                                               stdout=log, stderr=log, env=environment(**DASK), cwd=str(self._folder)))
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


def wait_for_a_result(run, folder):
    """Paths of the results that are there, one at least."""
    return wait_for(run, lambda: list(folder.glob("results/*/*/result.json")))


def test_a_killed_worker_loses_nothing(scenes, alone, cluster, tmp_path):
    run = start_evaluate(*scenes, "--methods", METHODS, "--output", tmp_path / "out", "--scheduler", cluster.address)
    try:
        wait_for_a_result(run, tmp_path / "out")
        cluster.workers[0].send_signal(signal.SIGKILL)
        cluster.workers[0].wait()
        done = len(wait_for_a_result(run, tmp_path / "out"))
        out, err = run.communicate(timeout=300)
    finally:
        run.kill()
    total = len(scenes) * len(METHODS.split(","))
    print(f"{done} of {total} results were there when the worker was gone")
    assert 0 < done < total
    assert run.returncode == 0 and "2 tasks ran side by side" in out
    assert re.fullmatch(LOST_WORKER + "\n", err), err
    expect_same(tmp_path / "out", alone)


def test_a_lost_scheduler_is_told_and_the_run_goes_on_later(scenes, alone, cluster, tmp_path):
    arguments = [*scenes, "--methods", METHODS, "--output", tmp_path / "out"]
    run = start_evaluate(*arguments, "--scheduler", cluster.address)
    wait_for_a_result(run, tmp_path / "out")
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
    done = succeeded(run_script("evaluate", *scenes, "--methods", METHODS, "--output", tmp_path / "out", "--jobs", 2))
    assert done.stderr == "" and "2 tasks ran side by side" in done.stdout
    expect_same(tmp_path / "out", alone)


def listening():
    """Addresses at which this process and its children wait for connections."""
    own = psutil.Process()
    return {connection.laddr.ip for process in [own, *own.children(recursive=True)]
            for connection in process.connections("inet") if connection.status == psutil.CONN_LISTEN}


def pages():
    """What Dask's workers and scheduler show to a browser, by port."""
    own, found = psutil.Process(), {}
    for process in [own, *own.children(recursive=True)]:
        for connection in process.connections("inet4"):
            if connection.status == psutil.CONN_LISTEN:
                for path in ("/status", "/workers"):
                    try:
                        address = f"http://127.0.0.1:{connection.laddr.port}{path}"
                        found[address] = urllib.request.urlopen(address, timeout=5).read()
                    except (OSError, http.client.HTTPException):
                        pass  # not found, or no web server
    return found


def test_workers_of_this_machine_are_nobody_elses(tmp_path, monkeypatch):
    """Dask asks for no password: whoever reaches a worker runs what he likes on it."""
    before = listening()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with engine(2, "") as workers:
        assert workers.at_a_time == 2
        assert dict(workers.run({1: (max, (2, 3))})) == {1: 3}
        assert listening() - before == {"127.0.0.1"}
        folder, = tmp_path.iterdir()
        assert folder.stat().st_mode & 0o077 == 0 and list(folder.iterdir())
        assert not [address for address, text in pages().items() if b"bokeh" in text.lower() or b"Worker" in text]
    assert list(tmp_path.iterdir()) == []
