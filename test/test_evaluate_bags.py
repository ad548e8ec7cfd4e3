# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags as scenes of evaluate: brackets through the real nodes, their frames for the other methods."""
import os
import subprocess
import sys

import cv2
import cv_bridge
import numpy as np
import pytest
import rosbag
from evaluate_helpers import evaluate, make_scene, results
from tool_helpers import read, rosrun, succeeded

from all_in_focus import installed
from all_in_focus.files.stack import Stack
from all_in_focus_lab.benchmark import bags, methods, settings, versions as v
from all_in_focus_lab.benchmark.scenes import Scene

METHODS = "paper,laplacian"  # of the nodes and of another; refined is what the nodes do if not told


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("scene") / "planes")


@pytest.fixture(scope="module")
def bag(scene):
    path = scene.parent / "planes.bag"
    succeeded(rosrun("make_bag", "--depth", scene / "depth.png", "--rig", scene / "rig", "--stack", scene / "stack",
                     "--focus", scene / "focus.yaml", "--output", path))
    return path


def test_a_bag_gives_what_its_files_give(scene, bag, tmp_path):
    (tmp_path / "c.yaml").write_text(f"scenes: [{{path: {bag}, name: played, truth: {scene / 'truth.png'}}}, {scene}]\n"
                                     f"methods: [{METHODS}]\noutput: out\n")
    code, out, err = evaluate("--config", tmp_path / "c.yaml")
    assert (code, err) == (0, "")
    for method in METHODS.split(","):
        for picture in ("fused", "source_index"):
            of_bag, of_files = (read(tmp_path / "out" / "results" / name / method / (picture + ".png"))
                                for name in ("played", "planes"))
            assert np.array_equal(of_bag, of_files), (method, picture)
        played, files = (results(tmp_path / "out")["results"][name][method]["values"] for name in ("played", "planes"))
        assert played == pytest.approx({name: files[name] for name in played}, rel=1e-13) and "PSNR" in played
    stamp = os.stat(str(tmp_path / "out" / "bags" / "played" / "bag.json")).st_mtime_ns
    assert evaluate("--config", tmp_path / "c.yaml")[0] == 0
    assert os.stat(str(tmp_path / "out" / "bags" / "played" / "bag.json")).st_mtime_ns == stamp


def test_what_the_nodes_refuse_stops_no_other_scene(scene, bag, tmp_path):
    code, _, err = evaluate(bag, "--methods", "refined", "--bag-option", "optics=24,4", "--output", tmp_path / "out")
    assert code == 1 and err.splitlines()[0].startswith("evaluate: warning: planes refined: evaluate_bag: ")


def test_files_of_others_stay_and_are_no_results(bag, tmp_path):
    theirs = tmp_path / "out/bags/planes/stacks/bracket_0000/000.png"
    theirs.parent.mkdir(parents=True)
    theirs.write_text("theirs")
    code, _, err = evaluate(bag, "--methods", "laplacian", "--output", tmp_path / "out")
    assert code == 1 and len(err.splitlines()) == 1 and "was not written by evaluate" in err
    assert theirs.read_text() == "theirs" and results(tmp_path / "out")["results"] == {}


def test_topics_are_named_by_a_file_and_by_options(tmp_path):
    (tmp_path / "topics.yaml").write_text("rgb_topic: /of_file\ndepth_topic: /of_file_too\n")
    found = bags.topics({"topics": str(tmp_path / "topics.yaml"), "depth-topic": "/of_option"})
    assert (found.rgb, found.depth, found.focus) == ("/of_file", "/of_option", "/rgb/focus")


def several_times(bag, turns, output, change):
    """A bag again and again, 100 s apart. change(turn, topic, message): may alter a message, returns whether to take it."""
    with rosbag.Bag(str(bag)) as old, rosbag.Bag(str(output), "w") as new:
        for turn in range(turns):
            for topic, message, time in old.read_messages():
                if hasattr(message, "header"):
                    message.header.stamp.secs += 100 * turn
                time.secs += 100 * turn
                if change(turn, topic, message):
                    new.write(topic, message, time)


def exported(bag, folder, *reports):
    """The exported stack of each report; reports: (bracket_id, frames_seen), as of a run of evaluate_bag."""
    names = [f"bracket_{number:04d}" for number in range(len(reports))]
    for name, (bracket_id, frames) in zip(names, reports):
        (folder / "results" / name).mkdir(parents=True)
        (folder / "results" / name / "report.json").write_text(f'{{"bracket_id": {bracket_id}, "frames_seen": {frames}}}')
    bags.export_frames(str(bag), {}, str(folder / "results"), str(folder / "stacks"))
    return [Stack(str(folder / "stacks" / name)) for name in names]


@pytest.mark.parametrize("ids", [(7, 6), (7, 7), None])
def test_frames_go_to_their_brackets(bag, tmp_path, ids):
    """A bag twice over: two brackets of their own numbers, of the same number (a camera node that was started again,
    joined bags), or without focus messages."""
    frames, bridge = [], cv_bridge.CvBridge()

    def change(turn, topic, message):
        if topic == "/rgb/focus" and ids:
            message.bracket_id = ids[turn]
        if topic == "/rgb/image":
            frames.append(bridge.imgmsg_to_cv2(message, "bgr8"))
        return topic != "/rgb/focus" or ids
    several_times(bag, 2, tmp_path / "two.bag", change)
    stacks = exported(tmp_path / "two.bag", tmp_path, *((number, 3) for number in ids or range(2)))
    found = [frame for stack in stacks for frame in stack]
    assert len(found) == len(frames) == 6 and all(np.array_equal(*pair) for pair in zip(found, frames))
    assert cv2.imread(str(tmp_path / "stacks" / "bracket_0001" / "003.png")) is None


def test_a_bracket_of_which_nothing_was_made_shifts_no_other(bag, tmp_path):
    """Three brackets of one number; the nodes reported the second, which alone has two frames, and the third."""
    def change(turn, topic, message):
        if topic != "/rgb/focus":
            return True
        message.bracket_id, message.count = 1, 2 if turn == 1 else 3
        message.last = message.index + 1 == message.count
        return message.index < message.count
    several_times(bag, 3, tmp_path / "three.bag", change)
    assert [len(stack) for stack in exported(tmp_path / "three.bag", tmp_path, (1, 2), (1, 3))] == [2, 3]


def test_results_of_a_bag_depend_on_the_nodes(tmp_path, monkeypatch):
    files, played = Scene("a", "a", digest="x"), Scene("b", "b.bag", digest="x", of_bag=True)

    def marks(**changed):
        versions = {"code": "1", "fuse_stack": "2", "nodes": "3", **changed}
        return [methods.fingerprint("refined", scene, versions) for scene in (files, played)]

    assert marks(nodes="4") == [marks()[0], marks(nodes="4")[1]] and marks(nodes="4")[1] != marks()[1]
    assert marks(fuse_stack="4")[1] == marks()[1] and marks(fuse_stack="4")[0] != marks()[0]

    monkeypatch.setattr(v, "prefix", lambda: tmp_path)
    (tmp_path / "lib" / "all_in_focus").mkdir(parents=True)
    for name in ("all_in_focus/evaluate_bag", "all_in_focus/fuse_stack", "liball_in_focus_core.so"):
        (tmp_path / "lib" / name).write_text("1")
    digests = []
    for text in "12":
        (tmp_path / "lib" / "liball_in_focus_nodelets.so").write_text(text)
        digests.append((v.nodes_digest(), v.fusion_digest()))
    assert digests[0][0] != digests[1][0] and digests[0][1] == digests[1][1]


def test_a_program_of_another_build_runs_with_its_own_libraries(tmp_path):
    program = tmp_path / "lib" / "all_in_focus" / "fuse_stack"
    program.parent.mkdir(parents=True)
    program.write_text('#!/bin/sh\necho "$LD_LIBRARY_PATH"\n')
    program.chmod(0o755)
    assert installed.run([str(program)]).startswith(f"{tmp_path / 'lib'}:")


def test_a_program_that_takes_too_long_may_clean_up(tmp_path):
    program = tmp_path / "slow"
    program.write_text(f"#!/bin/sh\ntrap 'echo ended > {tmp_path / 'said'}; exit 1' TERM\nwhile :; do sleep 0.1; done\n")
    program.chmod(0o755)
    with pytest.raises(RuntimeError, match="^slow: not done after 0.5 s, given up$"):
        installed.run([str(program)], 0.5)
    assert (tmp_path / "said").read_text() == "ended\n"


def test_an_interrupted_run_ends_its_program(tmp_path):
    program = tmp_path / "slow"
    # More than a pipe takes: when all is written, somebody reads it.
    program.write_text(f"#!/bin/sh\ntrap 'echo ended > {tmp_path / 'said'}; exit 1' TERM\n"
                       "head -c 200000 /dev/zero\nkill -TERM $PPID\n"
                       "while :; do sleep 0.1; done\n")
    program.chmod(0o755)
    script = ("import signal, sys; from all_in_focus import installed; "
              "signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number)); installed.run(sys.argv[1:])")
    assert subprocess.run([sys.executable, "-c", script, str(program)], timeout=60).returncode == 128 + 15
    assert (tmp_path / "said").read_text() == "ended\n"


def test_lists_of_methods_keep_the_commas_of_a_method():
    assert methods.split("paper,refined:-alignment,exposure,gf+ecc,all") == [
        "paper", "refined:-alignment,exposure", "gf+ecc", "all"]
    assert settings.from_dict({"methods": "refined:-alignment,exposure,dwt"}, "/").methods == [
        "refined:-alignment,exposure", "dwt"]
