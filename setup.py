# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
# Called by catkin only.
from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

# What ALL_IN_FOCUS_LAB adds, src/all_in_focus_lab/CMakeLists.txt installs.
PARTS = ['bag', 'bag.check', 'calibration', 'camera', 'files', 'replay']
setup(**generate_distutils_setup(packages=['all_in_focus'] + ['all_in_focus.' + part for part in PARTS], package_dir={'': 'src'}))
