# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags as scenes of evaluate: brackets through the real nodes, their frames for the other methods."""
import os

import cv2
import cv_bridge
import numpy as np
import pytest
import rosbag
from evaluate_helpers import evaluate, make_scene, results
from tool_helpers import read, rosrun, succeeded

from all_in_focus.benchmark import bags
from all_in_focus.files.stack import Stack

METHODS = "paper,refined,laplacian"


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
    (tmp_path / "c.yaml").write_text("scenes: [{path: %s, name: played, truth: %s}, %s]\nmethods: [%s]\noutput: out\n"
                                     % (bag, scene / "truth.png", scene, METHODS))
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


@pytest.mark.parametrize("has_focus", [True, False])
def test_frames_go_to_their_brackets(bag, tmp_path, has_focus):
    """A bag twice over: two brackets of their own numbers, or of three frames each in the order of the bag."""
    frames, bridge = [], cv_bridge.CvBridge()
    with rosbag.Bag(str(bag)) as old, rosbag.Bag(str(tmp_path / "two.bag"), "w") as new:
        for turn in range(2):
            for topic, message, time in old.read_messages():
                if hasattr(message, "header"):
                    message.header.stamp.secs += 100 * turn
                if topic == "/rgb/focus":
                    message.bracket_id = 7 - turn
                if topic == "/rgb/image":
                    frames.append(bridge.imgmsg_to_cv2(message, "bgr8"))
                time.secs += 100 * turn
                if topic != "/rgb/focus" or has_focus:
                    new.write(topic, message, time)
    for number in range(2):
        folder = tmp_path / "results" / ("bracket_%04d" % number)
        folder.mkdir(parents=True)
        bracket_id = 7 - number if has_focus else number
        (folder / "report.json").write_text('{"bracket_id": %d, "frames_seen": 3}' % bracket_id)
    bags.export(str(tmp_path / "two.bag"), bags.topics({}), str(tmp_path / "results"), str(tmp_path / "stacks"))
    exported = [frame for number in range(2) for frame in Stack(str(tmp_path / "stacks" / ("bracket_%04d" % number)))]
    assert len(exported) == len(frames) == 6 and all(np.array_equal(*pair) for pair in zip(exported, frames))
    assert cv2.imread(str(tmp_path / "stacks" / "bracket_0001" / "003.png")) is None
