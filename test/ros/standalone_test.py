#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The three nodes on their own, without a nodelet manager: what they do, they do in the same classes as the nodelets."""
from depth_testing import run_tests
from rig_testing import RigTest


class StandaloneTest(RigTest):
    def test_a_bracket_goes_through_all_nodes(self):
        report = self.assert_good_bracket_is_fused()
        self.assertEqual([report.mode, report.frames_used, list(report.notes)], ['paper', 3, []])

    def test_diagnostics_come_as_often_as_told(self):
        """The segmenter is told to send them twenty times as often as the fusion."""
        self.diagnostics.next('rig/fusion')
        begin = len(self.diagnostics.statuses)
        self.diagnostics.next('rig/fusion')
        names = [status.name for status in self.diagnostics.statuses[begin:]]
        self.assertGreaterEqual(sum(name.startswith('rig/segmenter:') for name in names), 5)  # 1 at the same pace


if __name__ == '__main__':
    run_tests(__file__)
