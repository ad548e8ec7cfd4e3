#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""robot.launch without hardware: the pixels of fuse_stack, whose parameters count, and recordings that come late."""
import rospy
import yaml

from depth_testing import run_tests
from robot_testing import FRAMES, LaunchTest, Scene, whole

# Over args, which are over the rig.
OVERLAY = {'segmenter': {'circle_of_confusion_mm': 0.02, 'dof_rule': 'full'}, 'image_folder_camera': {'rate': 20.0}}


class RobotTest(LaunchTest):
    def test_recordings_that_come_late_end_in_the_pixels_of_fuse_stack(self):
        scene = Scene(self.folder / 'scene')
        scene.record()
        expected = scene.fused('--optics', '35,4,0.02', '--dof-rule', 'full')  # 35 mm are the rig's
        self.assertTrue((expected != scene.fused()).any())
        (self.folder / 'own.yaml').write_text(yaml.safe_dump(OVERLAY))
        late = [scene.recording, scene.stack, scene.rig / 'extrinsics.yaml']
        for path in late:
            path.rename(str(path) + '.late')

        rospy.set_param('/use_sim_time', True)  # as replay.launch leaves it
        results = self.results()
        self.launch('all_in_focus', 'robot.launch', rviz='false', config=self.folder / 'own.yaml', aperture=4.0,
                    circle_of_confusion_mm=0.05, frame_rate=1.0, depth_timeout=1.0, **scene.arguments())
        self.assert_said(f'cannot open "{scene.recording}"', f'{scene.stack}: no such folder or video',
                         'extrinsics.yaml: No such file or directory')
        for path in late[1:]:
            path.with_name(path.name + '.late').rename(path)
        self.assert_said('nothing came on /segmentation/processed for 1 s: the pictures are published')
        self.result(results, lambda report: report.sharpness_alone and report.frames_seen == FRAMES)
        scene.recording.with_name(scene.recording.name + '.late').rename(scene.recording)
        picture, report = self.result(results, whole)
        self.assert_same(picture, expected)
        self.assertEqual([report.mode, report.reference, report.frames_used], ['refined', FRAMES // 2, FRAMES])
        self.assertEqual([round(value, 6) for value in (report.optics.focal_length_mm, report.optics.aperture,
                                                        report.optics.circle_of_confusion_mm)], [35, 4, 0.02])
        self.assertEqual(report.header.frame_id, 'dslr_optical_frame')

    def test_rig_that_is_not_there(self):
        self.launch('all_in_focus', 'robot.launch', rviz='false', rig=self.folder / 'none')
        self.assert_said(f'file does not exist [{self.folder / "none" / "optics.yaml"}]')
        self.assertEqual(self.launched.process.wait(60), 1)


if __name__ == '__main__':
    run_tests(__file__)
