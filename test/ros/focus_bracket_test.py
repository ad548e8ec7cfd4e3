#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""focus_bracket_camera over ROS: brackets on request, at a rate, as planned, and cameras that come and go."""
import math
import threading

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from std_srvs.srv import Trigger

from all_in_focus.camera.interface import IO_WRITE, NO_SPACE
from all_in_focus.msg import FocusPlan
from camera_testing import HERE, CameraTest, places
from depth_testing import (FAR_MM, NEAR_MM, TIMEOUT, Diagnostics, Talker, image_message, pixels_of, run_tests, two_planes,
                           wait_until)
from fake_camera import LENS, lens_of
from file_helpers import SCRIPTS

TABLE = "[{step: 0, mm: 500}, {step: 1000, mm: .inf}]"


class FocusBracketTest(CameraTest):
    def fake(self, **parameters):
        node = self.start(HERE / "fake_bracket_camera.py",
                          **{"settle": 0.0, "reconnect": 0.1, "diagnostic_period": 0.05, **parameters})
        self.provoke = Talker(self.topic("focus_bracket_camera/provoke"), String)
        return node

    def call(self, service="bracket"):
        name = self.topic("focus_bracket_camera/" + service)
        rospy.wait_for_service(name, TIMEOUT)
        return rospy.ServiceProxy(name, Trigger)()

    def succeed(self, service="bracket"):
        """The answer of the first successful call: at first the node may still be looking for the camera."""
        answers = []

        def done():
            answers.append(self.call(service))
            return answers[-1].success
        self.assertTrue(wait_until(done), answers[-1])
        return answers[-1]

    def test_a_bracket_on_request(self):
        node = self.fake(count=3, first=-1, rig=self.save_rig((96, 64)))
        self.listen_to_all()
        self.assertTrue(node.said("ready: Canon EOS 80D"))
        for bracket in range(2):
            self.assertEqual(self.succeed().message, "3 frames")
            frames = self.frames(3 * bracket + 3)[-3:]
            self.assertEqual(places(frames), [(bracket, index, 3, index == 2) for index in range(3)])
            for (image, info, focus), lens in zip(frames, (390, 400, 410)):
                self.assertLess(abs(lens_of(pixels_of(image)) - lens), 4)
                self.assertEqual([image.header.frame_id, image.encoding, image.width], ["dslr", "bgr8", 48])
                self.assertEqual([info.width, info.height, info.K[0]], [48, 32, 30.0])  # half the calibrated size
                self.assertTrue(math.isnan(focus.focus_distance))
        stamps = [image.header.stamp for image, _, _ in self.frames(6)]
        self.assertEqual(stamps, sorted(set(stamps)))
        self.assertIn("no ~focus_table", self.call("bracket_planned").message)
        self.assertLess(abs((rospy.Time.now() - stamps[-1]).to_sec()), 10)

    def test_the_focus_frame_comes_at_the_shutter_and_the_image_later(self):
        """So that the fusion can keep the regions of that moment. Both have the stamp of the shutter."""
        node = self.fake(count=2, exposure=1000, timeout=1000)
        self.listen_to_all()
        images, focus = (self.heard[name].messages for name in ("rgb/image", "rgb/focus"))
        self.assertTrue(node.said("ready"))
        begin, bracket = rospy.Time.now(), threading.Thread(target=self.call)
        bracket.start()
        self.addCleanup(bracket.join)
        self.addCleanup(node.stop)
        for index in range(2):
            self.assertTrue(wait_until(lambda: len(focus) > index))
            self.assertTrue(begin < focus[index].header.stamp < rospy.Time.now())
            begin = focus[index].header.stamp
            self.assertEqual(len(images), index)
            self.assertTrue(wait_until(lambda: self.provoke.say(String("develop")) or len(images) > index))
            self.assertEqual(images[index].header.stamp, focus[index].header.stamp)

    def test_a_focus_ring_that_is_turned_by_hand(self):
        node = self.fake(make="none", drive="none", count=3)
        self.listen_to_all()
        self.assertTrue(node.said("ready: Pentax K-1, focused by hand"))
        self.assertEqual(self.succeed().message, "3 frames")
        frames = self.frames(3)
        self.assertEqual(places(frames), [(0, index, 3, index == 2) for index in range(3)])
        self.assertTrue(all(math.isnan(focus.focus_distance) for _, _, focus in frames))

    def test_pictures_taken_by_hand_are_left_out(self):
        node = self.fake(count=3)
        self.listen_to_all()
        self.assertTrue(node.said("ready"))
        self.provoke.say(String("press 902"))
        self.assertTrue(node.said("left out IMG_0001.JPG: taken by hand"))
        self.succeed()
        for (image, _, _), lens in zip(self.frames(3), (400, 410, 420)):
            self.assertLess(abs(lens_of(pixels_of(image)) - lens), 4)

    def test_live_view_at_a_rate(self):
        self.fake(frames="preview", rate=10.0, count=2)
        self.listen_to_all()
        frames = self.frames(8)
        self.assertEqual([focus.index for _, _, focus in frames], [0, 1] * 4)
        ids = [focus.bracket_id for _, _, focus in frames]
        self.assertEqual(ids, sorted(ids))
        self.assertEqual([frames[0][0].width, frames[0][1].K[0]], [24, 0.0])  # not calibrated

    def test_at_a_rate_nothing_is_shot_without_a_listener(self):
        diagnostics = Diagnostics()
        self.addCleanup(diagnostics.close)

        def shot():
            """Number of brackets in the next diagnostics of a ready camera."""
            name = self.namespace[1:] + "/focus_bracket_camera"
            return int(diagnostics.wait(name, lambda status: status.level == 0).values[0].value)
        self.fake(rate=20.0, count=1)
        self.listen("rgb/camera_info", CameraInfo)  # a subscriber of camera_info alone starts no bracket
        self.assertEqual([shot(), shot()], [0, 0])
        self.listen_to_all()
        self.assertEqual(places(self.frames(2)), [(0, 0, 1, True), (1, 0, 1, True)])
        self.heard["rgb/image"].close()
        told = [shot()]
        self.assertTrue(wait_until(lambda: told.append(shot()) or told[-1] == told[-2]))
        self.assertEqual(self.succeed().message, "1 frames")  # on request all the same
        self.assertEqual(shot(), told[-1] + 1)

    def test_unplugged_and_plugged_in_again(self):
        node = self.fake(count=2, patience=0.5)
        self.listen_to_all()
        self.succeed()
        self.provoke.say(String("unplug"))
        self.assertTrue(node.said("the connection to the camera broke: it is off, asleep or unplugged"))
        self.assertTrue(node.said("no camera found: switch it on and check the USB cable"))
        self.assertTrue(wait_until(lambda: "no camera found" in self.call().message))
        self.provoke.say(String("plug"))
        self.succeed()
        self.assertEqual(places(self.frames(4)), [(0, 0, 2, False), (0, 1, 2, True), (1, 0, 2, False), (1, 1, 2, True)])
        self.assertEqual(len([line for line in node.lines if "no camera found" in line]), 1)  # once, not at every try

    def test_another_program_had_the_camera(self):
        """Whose calibration was the last one that was heard."""
        node = self.fake(count=1, patience=0.5, rig=self.save_rig((96, 64)))
        infos = self.listen("rgb/camera_info", CameraInfo)
        self.assertTrue(node.said("ready"))
        self.provoke.say(String("unplug"))
        self.assertTrue(node.said("no camera found"))
        other = Talker(self.topic("rgb/camera_info"), CameraInfo)
        other.say(CameraInfo(width=96, height=64))
        self.assertTrue(wait_until(lambda: infos.messages and not infos.messages[-1].K[0]))
        other.publisher.unregister()
        self.provoke.say(String("plug"))
        self.assertTrue(wait_until(lambda: infos.messages[-1].K[0] == 60.0), infos.messages)

    def assert_breaks_off(self, words):
        """Shoot brackets until one breaks off with these words."""
        answers = []

        def failed():
            answers.append(self.call())
            return words in answers[-1].message
        self.assertTrue(wait_until(failed), answers)
        self.assertFalse(answers[-1].success)
        self.assertIn("broke off after", answers[-1].message)

    def test_errors_in_mid_bracket_are_told_and_leave_nothing_behind(self):
        node = self.fake(count=3, patience=0.2)
        self.succeed()
        for provoked, words in ((f"fail {IO_WRITE} 30", "the connection to the camera broke"),
                                (f"fail {NO_SPACE} 30", "the memory card is full"),
                                ("busy 100000", "the camera is busy")):
            self.provoke.say(String(provoked))
            self.assert_breaks_off(words)
            self.assertTrue(node.said(words))
        self.provoke.say(String("busy 0"))
        self.succeed()
        self.listen_to_all()
        self.succeed()
        frames = self.frames(3)
        self.assertEqual([focus.index for _, _, focus in frames], [0, 1, 2])
        for (image, _, _), lens in zip(frames, (400, 410, 420)):  # where it was at the beginning
            self.assertLess(abs(lens_of(pixels_of(image)) - lens), 4)
        diagnostics, name = Diagnostics(), self.namespace[1:] + "/focus_bracket_camera"
        self.addCleanup(diagnostics.close)
        for provoked, level, words in (("busy 100000", 1, "the camera is busy"), ("busy 0", 0, "ready")):
            self.provoke.say(String(provoked))  # between brackets
            self.assertIn(words, diagnostics.wait(name, lambda status: status.level == level).message)

    def test_claimed_by_the_desktop_then_busy(self):
        node = self.fake(count=1, claimed=5)
        self.assertTrue(node.said("the camera is claimed by another program, mostly the desktop's volume monitor (gvfs)"))
        self.assertTrue(node.said("ready"))
        self.provoke.say(String("busy 6"))  # only takes longer
        self.assertEqual(self.succeed().message, "1 frames")

    def test_at_its_limit(self):
        node = self.fake(make="Nikon", lens=850, count=5)
        self.listen_to_all()
        self.assertIn("the focus is at its far limit after 2 of 5 frames", self.succeed().message)
        self.assertTrue(wait_until(lambda: places(self.frames(2)) == [(0, 0, 5, False), (0, 1, 2, True)]))
        self.assertTrue(node.said("far limit"))
        status = Diagnostics().wait(self.namespace[1:] + "/focus_bracket_camera", lambda s: s.values[0].value == "1")
        self.assertEqual([status.level, status.hardware_id], [0, "Nikon DSC D750"])

    def test_the_plan_of_the_segmenter(self):
        """The segmenter plans from a depth image, and exactly the planned frames are taken."""
        node = self.fake(make="Nikon", step_size=1, focus_table=TABLE)
        self.listen_to_all()
        self.assertTrue(node.said("ready"))
        self.assertIn(f"no plan has come on {self.topic('segmentation/focus_plan')} yet",
                      self.call("bracket_planned").message)
        Talker("/planner/depth_registered/image", Image).say(image_message(two_planes(), 1000))
        self.assertEqual(self.succeed("bracket_planned").message, "2 frames")
        frames = self.frames(2)
        for (image, _, focus), mm in zip(frames, (NEAR_MM, FAR_MM)):
            self.assertAlmostEqual(focus.focus_distance * 1000, mm, delta=0.01 * mm)
            self.assertLess(abs(lens_of(pixels_of(image)) - LENS * (1 - 500 / mm)), 4)

    def test_planned_brackets_at_a_rate(self):
        node = self.fake(make="Nikon", step_size=10, focus_table=TABLE.replace("1000", "100"), rate=20.0, plan=True)
        self.listen_to_all()
        self.assertTrue(node.said(f"no plan has come on {self.topic('segmentation/focus_plan')} yet"))
        Talker(self.topic("segmentation/focus_plan"), FocusPlan).say(FocusPlan(focus_distance=[0.6, 2.0]))
        frames = self.frames(4)
        self.assertEqual(places(frames), [(bracket, index, 2, index == 1) for bracket in (0, 1) for index in (0, 1)])
        distances = [focus.focus_distance for _, _, focus in frames]
        np.testing.assert_allclose(distances, [0.6, 2.0, 0.6, 2.0], rtol=0.01)

    def test_wrong_parameters_end_in_one_line(self):
        self.assert_all_refused(HERE / "fake_bracket_camera.py", [
            ({"focus_table": "[1]"}, "focus_table: entry 0: '1' is none of the keys step, mm"),
            ({"diagnostic_period": 0}, "~diagnostic_period: expected a number of at least 0.01, not '0'")])

    def test_without_a_camera_the_real_node_waits(self):
        node = self.start(SCRIPTS / "focus_bracket_camera", port="usb:999,999", model="Canon EOS 80D",
                          reconnect=0.1)
        self.assertTrue(node.said("no camera found: switch it on and check the USB cable"))
        self.assertFalse(self.call().success)


if __name__ == "__main__":
    run_tests(__file__)
