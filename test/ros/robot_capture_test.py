#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The action all_in_focus/capture, alike with a DSLR, a folder that is watched or played, and a bag."""
import shutil
import tempfile
import threading
from pathlib import Path

import actionlib
import numpy as np
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from std_msgs.msg import Header, String

from all_in_focus.msg import CaptureAction, CaptureActionGoal, CaptureActionResult, CaptureGoal, FocusFrame, FocusPlan
from camera_testing import HERE, CameraTest
from depth_testing import TIMEOUT, Listener, Talker, run_tests, wait_until
from file_helpers import call
from fusion_testing import array_of
from robot_testing import FRAMES, LaunchTest, Scene, whole
from tool_helpers import succeeded

TABLE = "[{step: 0, mm: 500}, {step: 1000, mm: .inf}]"


class Client:
    """told: what was fed back, as (phase, frame, count): the beginning of it, for the client listens until the result comes, and
    nothing says which of two topics is faster."""

    def __init__(self, namespace=""):
        self.told = []
        self.action = actionlib.SimpleActionClient(namespace + "/all_in_focus/capture", CaptureAction)
        self.came = wait_until(lambda: self.action.wait_for_server(rospy.Duration(0.1)), TIMEOUT)

    def send(self, **goal):
        self.told.clear()
        self.ended = threading.Event()
        self.action.send_goal(CaptureGoal(**goal), done_cb=lambda *_: self.ended.set(), feedback_cb=self._on_feedback)

    def _on_feedback(self, feedback):
        self.told.append((feedback.phase, feedback.frame, feedback.count))

    def end(self):
        """(state, text, result)"""
        assert self.ended.wait(TIMEOUT), self.told
        return self.action.get_state(), self.action.get_goal_status_text(), self.action.get_result()

    def capture(self, **goal):
        self.send(**goal)
        state, text, result = self.end()
        assert state == GoalStatus.SUCCEEDED, text
        for message in (result.image, result.depth, *([result.points] if result.points.data else [])):
            assert message.header.stamp == result.report.header.stamp
        return result

    def cancel_in(self, phase):
        """Or later, where the end is faster."""
        assert wait_until(lambda: phase in [told[0] for told in self.told] or self.ended.is_set(), TIMEOUT), self.told
        self.action.cancel_goal()
        self.end()

    def failure(self, **goal):
        """Why it failed."""
        self.send(**goal)
        state, text, _ = self.end()
        assert state == GoalStatus.ABORTED, (state, text)
        return text


def is_progress(told, count):
    """Whether it tells of one bracket, in order."""
    every = [("waiting", 0, 0), *(("shooting", frame, count) for frame in range(1, count)), ("fusing", count, count)]
    return told == [one for one in every if one in told]


class DslrTest(CameraTest):
    def test_a_dslr(self):
        self.namespace = "/test_a_dslr"
        camera = self.start(HERE / "fake_bracket_camera.py", make="Nikon", settle=0.0, step_size=1, focus_table=TABLE, count=3)
        self.assertTrue(camera.said("ready"))
        focus = Listener(self.topic("rgb/focus"), FocusFrame)
        self.addCleanup(focus.close)
        stop = threading.Event()
        self.addCleanup(stop.set)
        depth = Talker(self.topic("depth_registered/processed"), Header)

        def register_depth():
            while not stop.wait(0.05):
                depth.publisher.publish(Header())
        threading.Thread(target=register_depth, daemon=True).start()
        client = Client(self.namespace)
        self.assertTrue(client.came)

        result = client.capture()
        self.assertEqual((result.report.mode, result.report.frames_seen), ("refined", 3))
        self.assertEqual((result.image.width, result.image.height), (48, 32))
        self.assertFalse(result.points.data)
        self.assertTrue(is_progress(client.told, 3), client.told)
        listed = client.capture(focus_distance=[0.6, 1.0, 2.0, 5.0])
        self.assertEqual((listed.report.frames_seen, listed.report.bracket_id), (4, result.report.bracket_id + 1))
        np.testing.assert_allclose([frame.focus_distance for frame in focus.messages][-4:], [0.6, 1.0, 2.0, 5.0], rtol=0.01)
        exposed = client.capture(focus_distance=[0.6, 2.0], exposure_time=[1 / 60, 1 / 125])
        self.assertEqual(exposed.report.frames_seen, 2)
        self.assertIn("2 exposure times for 3 frames", client.failure(exposure_time=[0.1, 0.2]))
        self.assertIn("an exposure of 9 s", client.failure(exposure_time=[9]))
        self.assertIn("-1 s is no exposure time", client.failure(exposure_time=[-1]))
        self.assertIn("no plan has come on", client.failure(planned=True))
        client.send(planned=True)
        Talker(self.topic("segmentation/focus_plan"), FocusPlan).say(FocusPlan(focus_distance=[0.7, 3.0]))
        planned = client.end()[2]
        self.assertEqual(planned.report.frames_seen, 2)
        np.testing.assert_allclose([frame.focus_distance for frame in focus.messages][-2:], [0.7, 3.0], rtol=0.01)

        # Goals of older stamps come when a bag begins anew.
        results = self.listen("all_in_focus/capture/result", CaptureActionResult)
        older = CaptureActionGoal(goal_id=GoalID(rospy.Time(1), "older"))
        Talker(self.topic("all_in_focus/capture/goal"), CaptureActionGoal).say(older)
        of_older = lambda: next((one.status for one in results.messages if one.status.goal_id.id == "older"), None)
        self.assertTrue(wait_until(of_older, TIMEOUT))
        self.assertEqual(of_older().status, GoalStatus.SUCCEEDED, of_older().text)

        self.assertEqual(client.failure(mode="best"), "mode 'best': the fusion knows paper, refined and restored")
        self.assertEqual(client.capture(mode="paper").report.mode, "paper")
        self.assertEqual(client.capture().report.mode, "refined")

        provoke = Talker(self.topic("focus_bracket_camera/provoke"), String)
        provoke.say(String("unplug"))
        self.assertTrue(camera.said("the connection to the camera broke"))
        self.assertIn("no camera found", client.failure())
        client.send()
        provoke.say(String("plug"))  # while it is being looked for
        self.assertEqual(client.end()[0], GoalStatus.SUCCEEDED)


class ReplayTest(LaunchTest):
    @classmethod
    def setUpClass(cls):
        cls.shared = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.shared.cleanup)
        cls.scene = Scene(Path(cls.shared.name) / "scene")
        cls.expected = cls.scene.fused()
        cls.restored = cls.scene.fused("--mode", "restored")

    def setUp(self):
        super().setUp()
        self.addCleanup(rospy.set_param, "/use_sim_time", False)  # bags set it

    def client(self):
        client = Client()
        self.assertTrue(client.came, "".join(self.launched.lines))
        return client

    def assert_captures(self):
        """Each goal gets a whole bracket in the mode that it asks for."""
        client = self.client()
        for mode, ran, expected in (("restored", "restored", self.restored), ("", "refined", self.expected)):
            result = client.capture(mode=mode, with_points=True)
            self.assertEqual(result.report.mode, ran, result.report.notes)
            self.assertTrue(whole(result.report), result.report)
            self.assert_same(array_of(result.image), expected)
            self.assertEqual((result.points.width, result.points.height), (result.image.width, result.image.height))
            self.assertTrue(is_progress(client.told, FRAMES), client.told)
        # While the last frame waits for its result the fusion is left, and asked again at once.
        client.send(mode="restored")
        client.cancel_in("fusing")
        client.capture()
        return client

    def test_a_folder_that_is_played(self):
        self.launch("all_in_focus", "replay.launch", rviz="false", folder=self.scene.folder, capture="true")
        client = self.assert_captures()
        self.assertIn("need a camera, and nobody offers /focus_bracket_camera/shoot", client.failure(planned=True))

    def test_a_bag(self):
        bag = self.folder / "scene.bag"
        succeeded(call("make_bag", *self.scene.files, "--output", bag))
        self.launch("all_in_focus", "replay.launch", rviz="false", bag=bag, rig=self.scene.rig, capture="true")
        self.assert_captures()

    def test_a_folder_that_is_watched(self):
        watched = self.folder / "pictures"
        watched.mkdir()
        self.launch("all_in_focus", "robot.launch", rviz="false", capture="true", watch="true", dslr=watched, rig=self.scene.rig,
                    kinect=self.scene.depth, focus_table="")
        client = self.client()
        client.send(with_points=True)
        self.assertTrue(wait_until(lambda: client.told, TIMEOUT))
        self.assertEqual(client.told, [("waiting", 0, 0)])
        other = Client()
        self.assertTrue(other.came)
        other.send()
        self.assertEqual(other.end()[:2], (GoalStatus.REJECTED, "another goal is being worked on: cancel it, or wait"))
        client.action.cancel_goal()
        self.assertEqual(client.end()[0], GoalStatus.PREEMPTED)
        client.send(with_points=True)
        self.assertTrue(wait_until(lambda: client.told, TIMEOUT))
        for path in sorted(self.scene.stack.iterdir()):
            shutil.copy(str(path), str(watched))
        state, text, result = client.end()
        self.assertEqual(state, GoalStatus.SUCCEEDED, text)
        self.assertEqual(result.report.frames_seen, FRAMES)
        self.assertTrue(result.points.data)


if __name__ == "__main__":
    run_tests(__file__)
