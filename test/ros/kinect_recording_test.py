#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings that OpenNI2's own recorder makes and its file driver plays: pixel for pixel, at any pace."""
import os
import subprocess
import time
from pathlib import Path

import numpy as np

from depth_testing import TIMEOUT, pixels_of, run_tests, values_of, wait_until
from kinect_testing import (HEIGHT, WIDTH, KinectTest, depth_pattern, index_of, plug,
                            recorded_depth)

WORLD = Path(os.environ['KINECT_TEST_WORLD'])
NOISE, MIRRORED, DAMAGED = (Path(os.environ['KINECT_TEST_' + name]) for name in ('NOISE', 'MIRRORED', 'DAMAGED'))
FRAMES = 12  # that are asked for; on a busy computer the recorder catches some more before it stops
# A Kinect's values: everything up to 10 m, holes, and 2047, which here is a distance like others.
DEPTH = np.random.default_rng(0).integers(0, 10000, (2 * FRAMES, HEIGHT, WIDTH)).astype(np.uint16)
DEPTH[:, ::7, ::5], DEPTH[:, ::11, ::3] = 0, 2047
if recorded_depth() is not None:
    DEPTH[FRAMES // 2] = recorded_depth()


def record(camera, path, mirrored, frames=FRAMES):
    unfinished = path.with_suffix('.part')
    subprocess.run([WORLD / 'record_oni', 'frames:' + camera, unfinished, str(frames), str(int(mirrored))],
                   check=True, timeout=TIMEOUT)
    unfinished.rename(path)


def replace(path, content):
    new = path.with_suffix('.part')
    new.write_bytes(content)
    new.rename(path)


class RecordingTest(KinectTest):
    @classmethod
    def tearDownClass(cls):
        NOISE.unlink(missing_ok=True)
        MIRRORED.unlink(missing_ok=True)
        DAMAGED.unlink(missing_ok=True)

    def setUp(self):
        super().setUp()
        if not MIRRORED.exists():
            pixels = NOISE.with_suffix('.raw')
            self.addCleanup(pixels.unlink)
            DEPTH.tofile(pixels)
            # Whoever comes first also sees that a file which is not there yet is waited for.
            self.status('slow/kinect_openni2', f'cannot open "{NOISE}" (parameter device): there is no such file')
            plug('noise', f'recorded={pixels}')
            plug('pattern')
            record('noise', NOISE, False)
            record('pattern', MIRRORED, True, 4 * FRAMES)  # played as fast as possible while listeners connect
            for node in ('fast', 'slow', 'repeated'):
                self.diagnostics.wait(node + '/kinect_openni2', lambda s: '.oni' in values_of(s)['device'])

    def check_noise(self, messages, cyclic):
        """The recorded images, in their order; the recorder has lost the first."""
        indices = []
        for message in messages:
            depth = pixels_of(message)
            found = [i for i in range(len(DEPTH)) if np.array_equal(depth[0], DEPTH[i, 0])]
            self.assertEqual(len(found), 1)
            np.testing.assert_array_equal(depth, DEPTH[found[0]])
            indices.append(found[0])
        steps = np.diff(indices)
        last = max(indices)
        self.assertTrue(all(s == 1 or (cyclic and i == last) for s, i in zip(steps, indices)), indices)
        return indices

    def test_repeated_at_the_recorded_pace_pixel_for_pixel(self):
        depth = self.images('/repeated/depth/image_raw')
        began = time.monotonic()
        indices = self.check_noise(depth.wait(30), cyclic=True)
        self.assertGreater(time.monotonic() - began, 0.8)
        self.assertGreaterEqual(len(set(indices)), FRAMES - 3)
        self.assertTrue((np.diff(depth.stamps()) > 0).all())
        self.assertLess(np.abs(depth.delays()).min(), 0.3)
        self.images('/repeated/ir/image_raw')
        self.status('repeated/kinect_openni2', 'has no IR stream')
        depth.wait(2)

    def test_half_the_pace(self):
        depth = self.images('/slow/depth/image_raw')
        depth.wait(11)
        self.assertLess(abs(np.median(np.diff(depth.stamps())) * 15 - 1), 0.2, np.diff(depth.stamps()))

    def test_as_fast_as_possible_mirrored_to_its_end_and_again(self):
        for _ in range(2):
            depth = self.images('/fast/depth/image_raw')
            self.diagnostics.wait('fast/kinect_openni2', lambda s: 'at its end' in values_of(s)['device'])
            # The diagnostics may overtake the images. Who listens to what starts at once may miss the first of it, as
            # everywhere in ROS.
            self.assertTrue(wait_until(lambda: len(depth.messages) >= FRAMES - 5, TIMEOUT))
            indices = [index_of(pixels_of(message)) for message in depth.messages]
            for index, message in zip(indices, depth.messages):
                truth = depth_pattern(index)
                np.testing.assert_array_equal(pixels_of(message), np.where(truth == 2047, 0, truth))
            self.assertEqual(indices, list(range(indices[0], indices[0] + len(indices))))
            depth.close()
            self.diagnostics.wait('fast/kinect_openni2', lambda s: 'at its end' not in values_of(s)['device'])

    def test_files_that_cannot_be_played_until_one_can(self):
        whole = NOISE.read_bytes()
        broken = {'it is empty': b'',
                  'it is not an .oni recording': b'Some text.',
                  'it is cut short: it has 100000 bytes of at least ': whole[:100000],
                  'a name has impossible characters (byte 98)': whole[:140] + b'\xff' + whole[141:]}
        for reason, content in broken.items():
            replace(DAMAGED, content)
            self.status('damaged/kinect_openni2', f'cannot open "{DAMAGED}" (parameter device): {reason}')
        # As a recorder leaves it that is killed: no count of images, no index, no end.
        replace(DAMAGED, whole[:70] + b'\xff' * 4 + whole[74:90] + bytes(8) + whole[98:len(whole) // 4])
        depth = self.images('/damaged/depth/image_raw')
        self.check_noise(depth.wait(2), cyclic=False)
        replace(DAMAGED, whole)  # seen when it is opened again
        self.status('damaged/kinect_openni2', 'lacks its end: playing it again')
        self.check_noise(depth.wait(FRAMES)[-2:], cyclic=True)
        self.assertIn('lacks its end', values_of(self.status('damaged/kinect_openni2', 'processing'))['last error'])


if __name__ == '__main__':
    run_tests(__file__)
