#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""After kill -9 of a process of all_in_focus.launch results are right again. respawn_at_any_age_test.py: of each, at any age."""
import subprocess

from depth_testing import run_tests, wait_until
from respawn_testing import RespawnTest


class OnceTest(RespawnTest):
    def test_manager_then_loader_are_killed(self):
        for process in ('all_in_focus_manager', 'fusion'):
            self.assert_works_after_kill(process)

    def test_nodelet_is_unloaded_by_somebody(self):
        subprocess.run(['rosrun', 'nodelet', 'nodelet', 'unload', '/rig/fusion', '/rig/all_in_focus_manager'], check=True)
        self.assertTrue(wait_until(self.works), 'the nodelet was not loaded again')


if __name__ == '__main__':
    run_tests(__file__)
