#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""replay.launch: a folder, and a bag round after round, end in the pixels of fuse_stack."""
import os
import tempfile
from pathlib import Path

import rosbag
import rospy

from depth_testing import run_tests
from file_helpers import call
from robot_testing import LaunchTest, Scene, whole
from tool_helpers import succeeded

ROUNDS = 2  # each starts with a pause of some seconds


class ReplayTest(LaunchTest):
    @classmethod
    def setUpClass(cls):
        cls.shared = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.shared.cleanup)
        cls.scene = Scene(Path(cls.shared.name) / 'scene')
        cls.expected = cls.scene.fused()
        cls.bag = Path(cls.shared.name) / 'scene.bag'
        succeeded(call('make_bag', *cls.scene.files, '--output', cls.bag))

    def setUp(self):
        super().setUp()
        self.addCleanup(rospy.set_param, '/use_sim_time', False)  # bags set it

    def launch_bag(self, bag, **arguments):
        self.launch('all_in_focus', 'replay.launch', rviz='false', bag=bag, **arguments)

    def test_a_folder_whose_name_is_relative_to_where_it_is_called(self):
        self.addCleanup(os.chdir, os.getcwd())
        self.addCleanup(os.environ.update, PWD=os.environ['PWD'])
        os.chdir(self.shared.name)
        os.environ['PWD'] = self.shared.name  # as a shell does
        results = self.results()
        self.launch('all_in_focus', 'replay.launch', rviz='false', folder=self.scene.folder.name)
        self.assert_same(self.result(results, whole)[0], self.expected)

    def test_a_bag_over_and_over_with_all_its_frames(self):
        reports, results = [], self.results()

        def last_round(report):
            if not any(report is known for known in reports):
                reports.append(report)
            return len(reports) == ROUNDS
        self.launch_bag(self.bag, rig=self.scene.rig)
        self.result(results, last_round)
        for report in reports:
            self.assertTrue(whole(report), report)
        self.assert_same(results.wait(whole)[0], self.expected)

    def test_every_round_is_restored_and_topics_may_have_other_names(self):
        other, names, reports = self.folder / 'other.bag', self.folder / 'topics.yaml', []
        with rosbag.Bag(str(self.bag)) as bag, rosbag.Bag(str(other), 'w') as renamed:
            for topic, message, time in bag.read_messages():
                renamed.write(topic.replace('/depth/', '/camera/depth/').replace('/rgb/', '/camera/color/'), message, time)
        call('check_bag', other, '--save-topics', names)

        def last_round(report):
            if not any(report is known for known in reports):
                reports.append(report)
            return len(reports) == ROUNDS
        results = self.results()
        self.launch_bag(other, topics=names, mode='restored')
        self.result(results, last_round)
        for report in reports:
            self.assertEqual((report.mode, whole(report)), ('restored', True), report)

    def test_a_bag_brings_its_lens(self):
        results = self.results()
        self.launch_bag(self.bag)
        self.assert_same(self.result(results, whole)[0], self.expected)

    def test_a_bag_that_cannot_be_played_ends_it(self):
        (self.folder / 'text.bag').write_text('no bag')
        for bag, complaint in (('none.bag', 'none.bag: No such file or directory'), ('text.bag', 'not a bag')):
            self.launch_bag(self.folder / bag)
            self.assert_said(complaint)
            self.assertEqual(sum(complaint in line for line in self.launched.lines), 1, self.launched.lines)
            self.launched.process.wait(30)

    def test_neither(self):
        self.launch('all_in_focus', 'replay.launch', rviz='false')
        self.assert_said("requires the 'bag:=X.bag or folder:=DIR' arg to be set")


if __name__ == '__main__':
    run_tests(__file__)
