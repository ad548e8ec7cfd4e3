# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
# Called by catkin only.
from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

PACKAGES = ['all_in_focus'] + ['all_in_focus.' + name
                               for name in ('bag_check', 'baselines', 'camera', 'comparison', 'metrics')]
setup(**generate_distutils_setup(packages=PACKAGES, package_dir={'': 'src'}))
