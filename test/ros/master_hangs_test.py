#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The master does not answer while the first frames come, or while an input is silent: the fusion goes on."""
import os
import signal
from contextlib import contextmanager

import rosgraph

from depth_testing import WARN, run_tests, wait_until
from fusion_testing import FusionTest


@contextmanager
def hanging_master():
    pid = rosgraph.Master('/test').getPid()
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


class MasterHangsTest(FusionTest):
    def setUp(self):
        super().setUp()
        self.assertTrue(wait_until(lambda: self.image.publisher.get_num_connections()
                                   and self.focus.publisher.get_num_connections()))

    def test_first_frames_are_fused(self):
        with hanging_master():
            self.assertEqual(self.report(self.send_bracket(1000)).frames_used, 3)

    def test_silent_inputs_are_told(self):
        self.reconfigure(label_timeout=0.1)
        with hanging_master():
            self.assert_diagnosed(WARN, 'no data on /focus/segmentation/labels')
            for bracket in range(3):
                self.report(self.send_bracket(2000 + 10 * bracket))


if __name__ == '__main__':
    run_tests(__file__)
