#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""After kill -9 of any process of all_in_focus.launch, at any age, results are right again."""
import time

from depth_testing import run_tests, wait_until
from process_testing import kill, pid_of
from respawn_testing import RespawnTest


class AnyAgeTest(RespawnTest):
    def test_manager_is_killed_at_any_age(self):
        """Also before its loaders can have heard of it twice, and before they have loaded anything."""
        for age in (0, 0.5, 1, 1.5, 2, 6):
            time.sleep(age)
            self.assert_works_after_kill('all_in_focus_manager')
        for _ in range(3):
            kill('/rig/all_in_focus_manager')
            self.assertTrue(wait_until(lambda: pid_of('/rig/all_in_focus_manager')))
        self.assert_works_after_kill('all_in_focus_manager')

    def test_manager_is_killed_while_it_loads(self):
        """A bond never notices the death of a manager between its first and its second sign of life."""
        for age in (0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.2):
            before = kill('/rig/all_in_focus_manager')
            self.assertTrue(wait_until(lambda: pid_of('/rig/all_in_focus_manager') not in (None, before)))
            time.sleep(age)
            self.assert_works_after_kill('all_in_focus_manager')

    def test_loader_is_killed(self):
        for process in ('depth_preprocess', 'segmenter', 'fusion'):
            self.assert_works_after_kill(process)
            time.sleep(3)  # by then the next one has loaded its nodelet anew
            self.assertTrue(wait_until(self.works), 'nothing works a while after the kill of ' + process)


if __name__ == '__main__':
    run_tests(__file__)
