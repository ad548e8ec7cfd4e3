#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What can be wrong when the Kinect node starts: parameters, the device, OpenNI2 itself."""
import os
import tempfile
from pathlib import Path


from depth_testing import pixels_of, run_tests, values_of
from kinect_testing import KinectNode, KinectTest, depth_pattern, index_of, plug

OWN = 'own/kinect_openni2'
WORLD = Path(os.environ['KINECT_TEST_DIR']).parent


class StartTest(KinectTest):
    def start(self, *arguments, **environment):
        self.node = KinectNode(*arguments, **environment)
        return self.images('/own/depth/image_raw')

    def tearDown(self):
        if self.node.process.poll() is None:
            self.node.stop()
        super().tearDown()

    def assert_runs_and_names(self, complaints):
        """complaints: by argument. Returns an image and what was said."""
        plug('one')
        images = self.start(*complaints).wait(8)
        said = self.node.stop()
        for complaint in complaints.values():
            self.assertIn(complaint, said)
        return images[-1], said

    def test_impossible_parameters_are_named_and_the_defaults_taken(self):
        image, said = self.assert_runs_and_names({
            '_invalid_values:=none': "invalid_values must be a list of whole numbers from 0 to 65535, not 'none': "
            'using [0, 2047, 65535]',
            '_queue_size:=0': 'queue_size must be a whole number from 1 to 1000, not 0: using 5',
            '_time_offset:=soon': "time_offset must be a number from -3600 to 3600, not 'soon': using 0",
            '_silence_timeout:=-1': 'silence_timeout must be a number from 0 to 3600, not -1: using 5'})
        depth = pixels_of(image)  # in the first there is no 2047
        self.assertEqual(depth[depth_pattern(index_of(depth)) == 2047].max(), 0)
        self.assertEqual(said.count('kinect_depth is not calibrated'), 1, said)

    def test_numbers_that_no_clock_adds_and_no_camera_has(self):
        self.assert_runs_and_names({
            '_queue_size:=1e300': 'queue_size must be a whole number from 1 to 1000, not 1e+300: using 5',
            '_time_offset:=1e300': 'time_offset must be a number from -3600 to 3600, not 1e+300: using 0',
            '_reconnect_period:=.nan': "reconnect_period must be a number from 0.1 to 3600, not '.nan': using 1",
            '_playback_rate:=1e-300': 'playback_rate must be 0 or at least 0.001: using 1'})

    def test_camera_by_its_uri_among_others(self):
        plug('two')
        depth = self.start('_device:=frames:one')
        status = self.status(OWN, 'cannot open "frames:one" (')
        self.assertIn('; found #1 "frames:two" (Test camera, all_in_focus)', status.message)
        plug('one')
        depth.wait(2)
        self.assertIn('"frames:one"', values_of(self.status(OWN, 'processing'))['device'])

    def test_openni_without_drivers_until_they_are_installed(self):
        plug('one')
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / 'libOpenNI2.so.0'
            library.symlink_to((WORLD / library.name).resolve())
            depth = self.start(LD_LIBRARY_PATH=folder + ':' + os.environ['LD_LIBRARY_PATH'])
            self.status(OWN, 'OpenNI2 does not start: ')
            (Path(folder) / 'OpenNI2').symlink_to(WORLD / 'OpenNI2')
            depth.wait(2)


if __name__ == '__main__':
    run_tests(__file__)
