#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two rigs at once on one master, in namespaces: each fuses its own scene, with its own calibration."""
from pathlib import Path

import rosgraph

from all_in_focus.files.rig import load_rig, save_rig
from depth_testing import run_tests
from robot_testing import LaunchTest, Scene, whole

LAUNCH = Path(__file__).resolve().with_name('two_rigs.launch')
COMMON = {'/rosout', '/rosout_agg', '/tf', '/tf_static', '/diagnostics', '/clock'}


class TwoRigsTest(LaunchTest):
    def test_two_rigs_do_not_mix(self):
        left = Scene(self.folder / 'left')
        scenes = {'left': left, 'right': left.copy_upside_down(self.folder / 'right')}
        # The same names of frames in both rig folders, but not the same pose.
        rig = load_rig(str(scenes['right'].rig))
        rig.t[1] += 0.03
        save_rig(str(scenes['right'].rig), rig)
        expected = {}
        for side, scene in scenes.items():
            scene.record()
            expected[side] = scene.fused()
        self.assertTrue((expected['left'] != expected['right'][::-1]).any())
        results = {side: self.results('/' + side) for side in scenes}
        self.launch(LAUNCH, **{side: scene.folder for side, scene in scenes.items()})
        for side in scenes:
            picture, report = self.result(results[side], whole)
            self.assert_same(picture, expected[side])
            self.assertEqual(report.header.frame_id, side + '_dslr_optical_frame')
        topics = {name for names in rosgraph.Master('/two_rigs_test').getSystemState()[:2] for name, _ in names}
        self.assertFalse({name for name in topics - COMMON if not name.startswith(('/left/', '/right/'))})


if __name__ == '__main__':
    run_tests(__file__)
