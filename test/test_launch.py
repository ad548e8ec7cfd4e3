# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Launches on a master of their own, as evaluate_bag needs them: how their end is told, and that no
process stays behind. Real roslaunch, real masters."""
import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rosgraph

from all_in_focus.replay.launch import Launch, own_master
from file_helpers import wait_until


def is_alive(pid):
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


def read_or_nothing(path):
    with contextlib.suppress(OSError):
        return path.read_text()
    return ""


class Nodes:
    """Launch XML with nodes whose program is Python code; each writes its pid to a file of its name."""

    def __init__(self, folder):
        self.folder, self.text = folder, ""

    def add(self, name, code, attributes=""):
        program = self.folder / f"{name}.py"
        program.write_text(f"#!{sys.executable}\nimport os, signal, sys, time\n"
                           f"open({str(self.folder / name)!r}, 'w').write(str(os.getpid()))\n{code}\n")
        program.chmod(0o755)
        # Any node serves: the prefix is run with its path as an argument.
        self.text += f'<node pkg="rosout" type="rosout" name="{name}" launch-prefix="{program}" {attributes}/>'
        return self

    def launch(self, **options):
        return Launch(self.folder, self.file(), **options)

    def file(self):
        path = self.folder / "nodes.launch"
        path.write_text(f"<launch>{self.text}</launch>")
        return path

    def pid(self, name):
        path = self.folder / name
        assert wait_until(lambda: path.exists() and path.read_text())
        return int(path.read_text())


@pytest.fixture(autouse=True)
def master(monkeypatch, tmp_path):
    """URI of a master that does not run yet."""
    monkeypatch.setenv("ROS_IP", "1.2.3.4")
    for name, value in own_master(tmp_path / "log").items():
        monkeypatch.setenv(name, value)
    return os.environ["ROS_MASTER_URI"]


@pytest.fixture
def nodes(tmp_path):
    return Nodes(tmp_path)


def ended(launch):
    return launch._process.poll() is not None


FOREVER = "while True: time.sleep(0.1)"
STUBBORN = "for s in (signal.SIGINT, signal.SIGTERM): signal.signal(s, signal.SIG_IGN)\n"


def test_environment_puts_the_system_first(master):
    assert os.environ["PATH"].startswith("/usr/bin:/bin:") and os.environ["ROS_HOSTNAME"] == "localhost"
    assert rosgraph.get_master_uri() == master


def test_the_port_of_the_master_is_kept_for_it(master):
    """Other programs, which may start before it, cannot take it. That it can is what all tests here show."""
    with socket.socket() as other, pytest.raises(OSError, match="in use"):
        other.bind(("", int(master.rpartition(":")[2])))


def test_a_launch_that_ends_while_it_starts_nodes_leaves_none(nodes, master):
    """roslaunch knows nothing of the node that it is starting."""
    names = [f"n{number}" for number in range(8)]
    for name in names:
        nodes.add(name, FOREVER)
    with nodes.launch():
        nodes.pid(names[2])
    commands = lambda: map(read_or_nothing, Path("/proc").glob("[0-9]*/cmdline"))
    assert wait_until(lambda: not any(str(nodes.folder) in command for command in commands()))


def test_the_death_of_a_required_node_ends_the_others_and_is_told(nodes):
    nodes.add("other", FOREVER).add("victim", FOREVER, 'required="true"')
    with nodes.launch() as launch:
        other = nodes.pid("other")
        os.kill(nodes.pid("victim"), signal.SIGKILL)
        assert wait_until(lambda: ended(launch))
        assert launch.deaths() == [(-signal.SIGKILL, "victim was ended by SIGKILL")]
        assert launch.reason() == "victim was ended by SIGKILL"
        assert not is_alive(other)


def test_the_exit_code_and_the_last_words_of_a_node_are_told(nodes):
    """Also of one that dies before the others are started."""
    nodes.add("short", "sys.exit('\x1b[31mno such lens\x1b[0m')", 'required="true"')
    for number in range(5):
        nodes.add(f"other_{number}", FOREVER)
    with nodes.launch() as launch:
        assert wait_until(lambda: ended(launch))
        assert launch.reason() == "short ended with exit code 1: no such lens"


def test_a_node_that_is_not_required_may_end(nodes):
    nodes.add("short", "sys.exit(4)").add("other", FOREVER)
    with nodes.launch() as launch:
        assert wait_until(launch.deaths)
        assert launch.deaths()[0] == (4, "short ended with exit code 4")
        time.sleep(1.0)
        assert not ended(launch) and is_alive(nodes.pid("other"))


@pytest.mark.parametrize("text, reason", [
    ("<launch><arg name='bag'/><param name='a' value='$(arg bag)'/></launch>", "requires the 'bag' arg to be set"),
    ("<launch><node", "Invalid roslaunch XML syntax"),
    ("<launch><node pkg='rosout' type='none' name='lost'/></launch>",
     "cannot launch node of type [rosout/none]: Cannot locate node of type [none]"),
    ("<launch><node pkg='no_such_package' type='x' name='lost'/></launch>",
     "cannot launch node of type [no_such_package/x]: no_such_package")])
def test_what_cannot_be_launched_is_told_in_one_line(tmp_path, text, reason):
    (tmp_path / "x.launch").write_text(text)
    with Launch(tmp_path, tmp_path / "x.launch") as launch:
        assert wait_until(launch.reason)
        assert reason in launch.reason() and "\n" not in launch.reason()
        assert not launch.deaths()


def test_nodes_join_a_master_that_runs_already(nodes, master):
    with nodes.add("host", FOREVER).launch() as first:
        nodes.pid("host")
        nodes.text = ""
        nodes.add("guest", FOREVER)
        (nodes.folder / "guests").mkdir()
        with Launch(nodes.folder / "guests", nodes.file()):
            pid = nodes.pid("guest")
        assert not is_alive(pid) and not ended(first)
        assert rosgraph.is_master_online(master)


def test_what_is_printed_is_shown(nodes, capsys):
    nodes.add("talker", f"print('this is said', flush=True)\n{FOREVER}", 'output="screen"')
    with nodes.launch(verbose=True) as launch:
        assert wait_until(lambda: not launch.reason() and "this is said" in capsys.readouterr().err)


def test_a_node_that_comes_again_is_ended_with_the_others_where_roslaunch_is_killed(nodes):
    nodes.add("phoenix", FOREVER, 'respawn="true"')
    with nodes.launch() as launch:
        pid = nodes.pid("phoenix")
        assert wait_until(lambda: f"with pid [{pid}]" in (nodes.folder / "stdout").read_text())
        os.kill(pid, signal.SIGKILL)
        assert wait_until(lambda: nodes.pid("phoenix") != pid)
        pid = nodes.pid("phoenix")
        assert launch.deaths()[0] == (-signal.SIGKILL, "phoenix was ended by SIGKILL")
        assert wait_until(lambda: f"with pid [{pid}]" in (nodes.folder / "stdout").read_text())
        launch._process.kill()
    assert wait_until(lambda: not is_alive(pid))


def test_everything_started_is_ended(nodes, master):
    """Also a node and its child that ignore the first signals, and the master."""
    nodes.add("stubborn", f"{STUBBORN}os.fork() or open({str(nodes.folder / 'child')!r}, 'w').write(str(os.getpid()))\n"
                          f"{FOREVER}")
    with nodes.launch(grace=(1.0, 1.0)) as launch:
        pids = [nodes.pid("stubborn"), nodes.pid("child")]
        assert rosgraph.is_master_online(master) and launch.reason() is None
    assert wait_until(lambda: not any(map(is_alive, pids)))
    assert not rosgraph.is_master_online(master)
    assert ended(launch)


def test_after_an_error_nobody_waits_for_nodes(nodes, monkeypatch):
    monkeypatch.setattr("all_in_focus.replay.launch.SHUTDOWN", 600)
    nodes.add("stubborn", STUBBORN + FOREVER)
    with pytest.raises(KeyboardInterrupt), nodes.launch(grace=(600, 600)):
        pid = nodes.pid("stubborn")
        raise KeyboardInterrupt
    assert wait_until(lambda: not is_alive(pid))


def test_nothing_stays_where_roslaunch_is_killed(nodes, master):
    nodes.add("stubborn", STUBBORN + FOREVER)
    with nodes.launch() as launch:
        pid = nodes.pid("stubborn")
        assert wait_until(lambda: "process[stubborn" in (nodes.folder / "stdout").read_text())
        launch._process.kill()
        assert wait_until(lambda: ended(launch))
        assert launch.reason() == "roslaunch was ended by SIGKILL"
    assert wait_until(lambda: not is_alive(pid))
    assert not rosgraph.is_master_online(master)


def test_nothing_stays_where_the_caller_is_killed(nodes, master):
    nodes.add("node", FOREVER)
    caller = subprocess.Popen([sys.executable, "-c", "import sys, time\n"
                               "from all_in_focus.replay.launch import Launch\n"
                               "launch = Launch(sys.argv[1], sys.argv[2])\ntime.sleep(600)",
                               str(nodes.folder), str(nodes.file())])
    pid = nodes.pid("node")
    caller.kill()
    caller.communicate()
    assert wait_until(lambda: not is_alive(pid) and not rosgraph.is_master_online(master))
