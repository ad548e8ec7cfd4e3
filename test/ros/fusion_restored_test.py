#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mode restored: a bracket is published once it is restored, and gives way to the next one. Pixels are those of fuse_stack."""
import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from depth_testing import SANITIZED, WARN, run_tests, subscribers_of, values_of, wait_until
from fusion_testing import BRACKET_IDS, PERIOD, array_of, colour_message
from refined_testing import FRAMES, INDICES, MIDDLE, STAMPS, RefinedTest, fused_by_files, pixels

ENLARGED = 3 if SANITIZED else 6  # then restoration goes on while the next bracket is fused
LARGE = {i: lambda stamp, frame=pixels(i, ENLARGED): colour_message(frame, stamp) for i in INDICES}
AT_REFERENCE = MIDDLE * PERIOD


class RestoredTest(RefinedTest):
    def setUp(self):
        super().setUp()
        self.outputs['depth_restored'] = self.listen(self.topic('all_in_focus/depth_restored'), Image)

    def reconfigure(self, **config):
        return super().reconfigure(**{'mode': 'restored', **config})

    def assert_pixels(self, stamp, mode, **files):
        for name, wanted in fused_by_files(INDICES, MIDDLE, mode, **files).items():
            np.testing.assert_array_equal(array_of(self.outputs[name].at(stamp + AT_REFERENCE)), wanted, name)

    def reports(self, stamps):
        return [self.report(stamp + AT_REFERENCE) for stamp in stamps]

    def test_the_result_is_that_of_files(self):
        stamp = self.fuse()
        report = self.report(stamp + AT_REFERENCE)
        self.assertEqual([report.mode, report.frames_used, report.reference], ['restored', len(FRAMES), MIDDLE], report.notes)
        self.assertEqual(list(report.timing_names), ['scene_wait', 'fusion', 'restoration'])
        self.assertGreater(report.blur_scale, 0)
        self.assert_pixels(stamp, 'restored')
        depth, image = (self.outputs[name].at(stamp + AT_REFERENCE) for name in ('depth_restored', 'image'))
        self.assertEqual([depth.encoding, depth.header.frame_id], ['16UC1', image.header.frame_id])
        self.acknowledged(stamp + INDICES[-1] * PERIOD)

    def test_the_cloud_has_the_restored_depth_and_the_colours(self):
        """For whoever listens already, and for whoever comes later."""
        present = self.listen(self.topic('all_in_focus/points'), PointCloud2)
        info = self.listen(self.topic('all_in_focus/camera_info'), CameraInfo)
        stamp = self.fuse() + AT_REFERENCE
        mm, picture = (array_of(self.outputs[name].at(stamp)) for name in ('depth_restored', 'image'))
        clouds = [present.at(stamp)]
        present.close()  # listeners of one process share a connection
        clouds.append(self.listen(self.topic('all_in_focus/points'), PointCloud2).at(stamp))
        fx, _, cx, _, fy, cy = info.at(stamp).K[:6]
        v, u = np.mgrid[:mm.shape[0], :mm.shape[1]]
        z = np.where(mm > 0, mm / 1000, np.nan)
        for cloud in clouds:
            self.assertEqual([field.name for field in cloud.fields], ['x', 'y', 'z', 'rgb'])
            self.assertEqual((cloud.height, cloud.width), mm.shape)
            points = np.frombuffer(cloud.data, np.uint8).reshape(*mm.shape, cloud.point_step)
            places = points[..., :12].copy().view(np.float32)
            for place, wanted in zip(np.moveaxis(places, -1, 0), ((u - cx) / fx * z, (v - cy) / fy * z, z)):
                np.testing.assert_allclose(place, wanted, atol=1e-5)
            at = cloud.fields[3].offset
            np.testing.assert_array_equal(points[..., at:at + 3], picture)

    def test_the_next_bracket_goes_first(self):
        """The older one is published as refined at that moment; each bracket once, in their order."""
        self.expect_scene()
        stamps, late = [next(STAMPS), next(STAMPS)], 'depth_registered/image_raw'
        self.send_scene(*stamps, but=[late])
        self.deliver(self.node, *(part for stamp in stamps for part in self.frames_of(stamp, replaced=LARGE)))
        for stamp in stamps:  # both brackets wait for it
            self.send_part(late, stamp)
        older, newer = self.reports(stamps)
        self.assertEqual([older.mode, newer.mode], ['refined', 'restored'], newer.notes)
        self.assert_noted(older, 'not restored: the next bracket came first')
        self.assert_diagnosed(WARN, 'not restored: the next bracket came first')
        self.assertEqual(older.blur_scale, 0)
        self.assert_pixels(stamps[0], 'refined', enlarged=ENLARGED)
        self.assert_pixels(stamps[1], 'restored', enlarged=ENLARGED)
        reported = [r.header.stamp.to_sec() for r in self.outputs['report'].messages]
        self.assertEqual([s for s in reported if s - AT_REFERENCE in stamps], [s + AT_REFERENCE for s in stamps])
        depths = [m.header.stamp.to_sec() for m in self.outputs['depth_restored'].messages]
        self.assertEqual([s for s in depths if s - AT_REFERENCE in stamps], [stamps[1] + AT_REFERENCE])
        for stamp in stamps:
            for index in INDICES:
                self.acknowledged(stamp + index * PERIOD)

    def test_a_bracket_of_another_mode_goes_first_too(self):
        self.expect_scene()
        restored, refined = stamps = [next(STAMPS), next(STAMPS)]
        self.send_scene(*stamps)
        bracket = {'bracket_id': next(BRACKET_IDS), 'replaced': LARGE}
        self.send(restored, INDICES[:-1], **bracket)
        self.acknowledged(restored + INDICES[-2] * PERIOD)
        self.reconfigure(mode='refined')
        self.send(restored, INDICES[-1:], **bracket)
        self.send(refined, replaced=LARGE)
        older, newer = self.reports(stamps)
        self.assertEqual([newer.mode, list(newer.notes)], ['refined', []])
        if older.mode != 'restored':  # it may have been done before
            self.assert_noted(older, 'not restored: the next bracket came first')
        reported = [r.header.stamp.to_sec() - AT_REFERENCE for r in self.outputs['report'].messages]
        self.assertLess(reported.index(restored), reported.index(refined))

    def test_finish_answers_when_it_is_restored(self):
        stamp = self.fuse(replaced=LARGE)
        self.acknowledged(stamp + PERIOD)
        answer = self.finish()
        self.assertTrue(answer.success, answer.message)
        report = self.report(stamp + AT_REFERENCE)
        self.assertEqual(report.mode, 'restored', report.notes)
        self.assertIn('brackets published', answer.message)

    def test_without_focus_distances_the_frames_alone_are_used(self):
        stamp = self.fuse(focus_distance=float('nan'))
        report = self.report(stamp + AT_REFERENCE)
        self.assertEqual(report.mode, 'restored', report.notes)
        self.assertEqual(report.blur_scale, 0)
        self.assert_pixels(stamp, 'restored', focus=False)
        self.assertIsNone(self.outputs['depth_restored'].at(stamp + AT_REFERENCE, 0.2))

    def test_who_listens_to_the_restored_depth_gets_it_when_the_mode_comes_back(self):
        self.reconfigure(mode='refined')
        refined = self.fuse() + AT_REFERENCE
        self.assertEqual(self.report(refined).mode, 'refined')
        self.reconfigure()
        self.assertIsNotNone(self.outputs['depth_restored'].at(self.fuse() + AT_REFERENCE))
        self.assertIsNone(self.outputs['depth_restored'].at(refined, 0))

    def test_without_optics_the_frames_tell_the_blur(self):
        self.expect_scene('depth_registered/image', 'depth_registered/image_raw', 'rgb/optics')
        stamp = self.fuse()
        report = self.report(stamp + AT_REFERENCE)
        self.assertEqual(report.mode, 'restored', report.notes)
        self.assertEqual(report.blur_scale, 0)

    def test_sliding_is_refined_and_says_so(self):
        self.reconfigure(bracket_mode='sliding')
        bracket_id = next(BRACKET_IDS)
        self.fuse(bracket_id=bracket_id)
        reports = lambda: [r for r in self.outputs['report'].messages if r.bracket_id == bracket_id]
        self.assertTrue(wait_until(lambda: len(reports()) == len(FRAMES)))
        for report in reports():
            self.assertEqual(report.mode, 'refined')
            self.assert_noted(report, 'not restored: sliding')

    def test_who_goes_away_meanwhile_breaks_nothing(self):
        stamp = self.fuse(replaced=LARGE)
        self.acknowledged(stamp + (len(FRAMES) - 2) * PERIOD)
        for output in self.outputs.values():
            output.close()
        self.assertTrue(wait_until(lambda: not subscribers_of(self.topic('rgb/image'))))
        state = lambda status: values_of(status).get('restoration') == 'idle'
        self.diagnostics.wait(self.node, state)
        self.outputs = {name: self.listen(self.topic('all_in_focus/' + name), kind)
                        for name, kind in (('image', Image), ('depth_restored', Image))}
        self.scene = {}
        self.expect_labels()
        stamp = self.fuse()
        self.assertIsNotNone(self.outputs['depth_restored'].at(stamp + AT_REFERENCE))


if __name__ == '__main__':
    run_tests(__file__)
