# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of mode refined share: a bracket, what belongs to its scene, and what fuse_stack makes of it."""
import functools
import itertools
import tempfile
from pathlib import Path

import cv2
import numpy as np
from sensor_msgs.msg import CameraInfo, Image

from all_in_focus.files.rig import Camera, Optics, Rig, save_rig
from all_in_focus.msg import Optics as OpticsMessage
from all_in_focus_lab.simulation import lens
from depth_testing import FAR_MM, HEIGHT, NEAR_MM, WIDTH, camera_info, image_message, two_planes, wait_until
from fusion_testing import BRACKET_IDS, OPTICS, PERIOD, FusionTest, array_of, colour_message
from tool_helpers import read, run_tool, succeeded, write

STAMPS = itertools.count(200000, 10)
# The frames of a bracket: where the lens is focused [m], how bright the frame is.
FRAMES = ((0.5, 0.96), (NEAR_MM / 1000, 0.9), (1.5, 0.8), (FAR_MM / 1000, 0.7), (9.0, 0.6))
INDICES = range(len(FRAMES))
LENS = (OPTICS.focal_length_mm, OPTICS.aperture, OPTICS.circle_of_confusion_mm)
FOCAL_PX = 500.0  # discs of blur of up to 5 pixels
MIDDLE = len(FRAMES) // 2


@functools.lru_cache(maxsize=None)
def pixels(index, enlarged=1):
    """What LENS makes of two planes with texture; enlarged: so many pixels for one each way."""
    focus_m, brightness = FRAMES[index]
    texture = np.random.default_rng(1).integers(20, 236, (HEIGHT // 2, WIDTH // 2, 3)).astype(np.float32)
    light = (cv2.resize(texture, (WIDTH * enlarged, HEIGHT * enlarged)) / 255) ** 2.2
    codes = np.empty_like(light)
    for half, depth_mm in ((np.s_[:, :WIDTH // 2 * enlarged], NEAR_MM), (np.s_[:, WIDTH // 2 * enlarged:], FAR_MM)):
        disc = lens.disc_kernel(int(lens.blur_levels(lens.blur_circle_px(OPTICS, FOCAL_PX * enlarged, depth_mm, 1000 * focus_m))))
        codes[half] = 255 * cv2.filter2D(light, -1, disc)[half] ** (1 / 2.2)
    return (codes * brightness).astype(np.uint8)


def another_scene(stamp):
    return colour_message(np.random.default_rng(2).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8), stamp)


def fused_by_files(indices, *arguments, **options):
    """What fuse_stack makes of some of the frames: {name of the output: pixels}; see _fused_by_files."""
    return _fused_by_files(tuple(indices), *arguments, **options)


@functools.lru_cache(maxsize=None)
def _fused_by_files(indices, reference, mode='refined', enlarged=1, focus=True, focal_px=FOCAL_PX, lens=LENS):
    """reference: one of the indices; enlarged: so many pixels for one each way; focus: whether it is told the focus distances;
    focal_px: of the colour camera; lens: of the rig."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / 'stack').mkdir()
        for index in indices:
            write(folder / 'stack' / f'{index}.png', pixels(index, enlarged))
        (folder / 'focus.yaml').write_text('frames:\n' + ''.join(f'- {{file: {i}.png, focus_mm: {FRAMES[i][0] * 1000!r}}}\n'
                                                                 for i in indices))
        camera = Camera.pinhole('color', WIDTH, HEIGHT, focal_px, focal_px, WIDTH / 2, HEIGHT / 2)
        optics = Optics(*lens)
        save_rig(str(folder / 'rig'), Rig(camera, camera, np.eye(3), [0.0, 0.0, 0.0], optics, 'color', 'depth'))
        files = {name: folder / (name + '.png') for name in ('image', 'source_index', 'confidence')}
        arguments = ['--focus', folder / 'focus.yaml'] if focus else []
        if mode == 'restored' and focus:
            files['depth_restored'] = folder / 'depth_restored.png'
            arguments += ['--save-depth', files['depth_restored']]
        succeeded(run_tool('fuse_stack', '--stack', folder / 'stack', '--registered-depth',
                           write(folder / 'z.png', two_planes()), '--rig', folder / 'rig', '--mode', mode, '--reference',
                           indices.index(reference), '--output', files['image'], '--save-source-index',
                           files['source_index'], '--save-confidence', files['confidence'], *arguments))
        results = {name: read(path) for name, path in files.items()}
    results['source_index'] = np.array(indices, np.uint16)[results['source_index']]
    return results


class RefinedTest(FusionTest):
    focal_px = FOCAL_PX
    lens = LENS  # on rgb/optics

    def setUp(self):
        super().setUp()
        self.reconfigure()
        self.outputs['confidence'] = self.listen(self.topic('all_in_focus/confidence'), Image)
        self.expect_labels()
        self.scene = {}

    def reconfigure(self, **config):
        return super().reconfigure(**{'mode': 'refined', **config})

    def expect_scene(self, *names):
        """Publishers of all that belongs to the scene, or of some."""
        kinds = {'depth_registered/image': Image, 'depth_registered/image_raw': Image, 'rgb/camera_info': CameraInfo,
                 'rgb/optics': OpticsMessage}
        for name in names or kinds:
            self.scene[name] = self.talk(self.topic(name), kinds[name])
        self.assertTrue(wait_until(lambda: all(t.publisher.get_num_connections() > 0 for t in self.scene.values())))

    def part_of(self, name, stamp):
        """(talker, message) of a topic of the scene."""
        return self.scene[name], (camera_info(stamp, 'color', self.focal_px) if name == 'rgb/camera_info' else
                                  OpticsMessage(*self.lens) if name == 'rgb/optics' else
                                  image_message(two_planes(), stamp, '16UC1', 'color'))

    def send_scene(self, *stamps, but=(), **replaced):
        """All that belongs to the brackets that begin at these stamps, without the topics of `but`. Returns when the node has
        taken it. replaced: see labels_of()."""
        self.deliver(self.node, *itertools.chain.from_iterable(
            [*(self.part_of(name, stamp) for name in self.scene if name not in but), self.labels_of(stamp, **replaced)]
            for stamp in stamps))

    def send_part(self, name, stamp):
        talker, message = self.part_of(name, stamp)
        talker.say(message)

    def frames_of(self, stamp, indices=INDICES, replaced=None, bracket_id=None, **focus):
        """(talker, message) for some frames of a bracket. replaced: functions of the stamp that make a message in the place of
        a frame, by index; focus: see frame_of()."""
        bracket = {'count': len(FRAMES), 'bracket_id': bracket_id or next(BRACKET_IDS)}
        for index in indices:
            at = stamp + index * PERIOD
            message = replaced[index](at) if index in (replaced or {}) else colour_message(pixels(index), at)
            yield from self.frame_of(at, message, index=index, **{'focus_distance': FRAMES[index][0], **bracket, **focus})

    def send(self, stamp, *indices, **options):
        for talker, message in self.frames_of(stamp, *indices, **options):
            talker.say(message)

    def assert_as_files(self, stamp, indices, reference, focus=True):
        """The result, of the bracket that began at `stamp`, is that of fuse_stack; returns the report."""
        report = self.report(stamp + reference * PERIOD)
        self.assertEqual([report.mode, report.has_labels, report.reference], ['refined', True, reference], report.notes)
        self.assertEqual(report.frames_used, len(indices))
        self.assertEqual([s.label for s in report.segments], [1, 2])
        self.assertTrue(all(0 <= value <= 1 for s in report.segments for value in (s.score, s.margin, s.confidence)))
        wanted = fused_by_files(indices, reference, focus=focus)
        for name, wanted_pixels in wanted.items():
            np.testing.assert_array_equal(array_of(self.outputs[name].at(stamp + reference * PERIOD)), wanted_pixels, name)
        return report

    def fuse(self, **arguments):
        """A bracket with all that belongs to it; returns its stamp."""
        if not self.scene:
            self.expect_scene()
        stamp = next(STAMPS)
        self.send_scene(stamp)
        self.send(stamp, **arguments)
        return stamp
