# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
# Called by catkin only.
from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

PARTS = ['bag', 'bag.check', 'baselines', 'benchmark', 'calibration', 'camera', 'files', 'metrics', 'replay', 'rviz',
         'simulation']
setup(**generate_distutils_setup(packages=['all_in_focus'] + ['all_in_focus.' + part for part in PARTS],
                                 package_dir={'': 'src'}, package_data={'all_in_focus.baselines': ['*.onnx']}))
