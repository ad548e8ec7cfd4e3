# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The scripts that build, test and check."""
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml

import run_pytest

ROOT = Path(__file__).resolve().parent.parent


def test_a_hanging_test_is_ended_and_named(tmp_path):
    hanging = tmp_path / 'test_hanging.py'
    hanging.write_text('import time\n\n\ndef test_hangs():\n    time.sleep(10000)\n')
    results = tmp_path / 'results.xml'
    assert run_pytest.main(results, hanging, limit_s=5) == 1
    failure = ET.parse(str(results)).find('.//failure')
    assert 'timed out after 5 s' in failure.get('message')


def test_results_of_tests_that_end_are_those_of_pytest(tmp_path):
    passing = tmp_path / 'test_passing.py'
    passing.write_text('def test_passes():\n    pass\n\n\ndef test_fails():\n    assert False\n')
    results = tmp_path / 'results.xml'
    assert run_pytest.main(results, passing) == 1
    assert [len(case.findall('failure')) for case in ET.parse(str(results)).iter('testcase')] == [0, 1]


def test_lint_names_what_it_finds(tmp_path):
    lint = [sys.executable, str(ROOT / 'scripts/lint')]
    results = tmp_path / 'lint.xml'
    run = subprocess.run([*lint, '--junitxml', str(results), 'python_3_8'], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout
    assert [case.get('name') for case in ET.parse(str(results)).iter('testcase')] == ['python_3_8']
    assert subprocess.run([*lint, 'no_such_check'], capture_output=True).returncode == 2


def test_the_installation_can_be_moved(tmp_path):
    installed = ROOT / 'build/.install'
    if not (installed / 'setup.bash').exists():
        pytest.skip('nothing is installed in build/.install')
    moved = tmp_path / 'moved'
    shutil.copytree(installed, moved, symlinks=True)
    commands = f'''unset CMAKE_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH ROS_PACKAGE_PATH
. {moved}/setup.bash
rospack find all_in_focus
rosrun all_in_focus fuse_stack --help
rosrun all_in_focus make_scene --help
python3 -c 'import all_in_focus; print(all_in_focus.__file__)'
'''
    run = subprocess.run(['bash', '-ec', commands], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()
    assert lines[0].startswith(str(moved)) and lines[-1].startswith(str(moved))


# Keys of package.xml, as rosdep knows them: the Debian packages that hold the same.
DEBIAN = {
    "camera_info_manager": ["libcamera-info-manager-dev"], "catkin": ["catkin", "cmake", "build-essential"],
    "cv_bridge": ["libcv-bridge-dev", "python3-cv-bridge"], "diagnostic_updater": ["libdiagnostic-updater-dev"],
    "dynamic_reconfigure": ["libdynamic-reconfigure-config-init-mutex-dev", "python3-dynamic-reconfigure"],
    "image_transport": ["libimage-transport-dev"], "libboost-program-options-dev": ["libboost-program-options-dev"],
    "message_filters": ["libmessage-filters-dev", "python3-message-filters"], "message_runtime": [],
    "message_generation": ["ros-message-generation"], "nlohmann-json-dev": ["nlohmann-json3-dev"],
    "nodelet": ["libnodeletlib-dev", "libnodeletlib-tools", "python3-nodelet"], "pluginlib": ["pluginlib-dev"], "rosbag": ["ros-core"],
    "roscpp": ["libroscpp-dev"], "roslaunch": ["ros-core"], "rospy": ["python3-rospy"], "rviz": [],
    "rostest": ["librostest-dev", "python3-rostest", "libgtest-dev"], "yaml-cpp": ["libyaml-cpp-dev"],
    "tf2_ros": ["libtf2-ros-dev", "tf2-tools", "python3-tf2-ros"],
    "diagnostic_msgs": ["ros-diagnostic-msgs", "python3-diagnostic-msgs"], "tf2_py": ["python3-tf2"],
    **{name: ["python3-" + name.replace("_", "-")] for name in ("genpy", "rosgraph", "rosgraph_msgs", "roslib", "tf2_msgs")},
    **{name: [f"lib{dashed}-dev", f"ros-{dashed}", f"python3-{dashed}"]
       for name in ("geometry_msgs", "sensor_msgs", "std_msgs", "std_srvs", "visualization_msgs")
       for dashed in [name.replace("_", "-")]}}


def test_package_xml_names_all_that_is_installed():
    """What rosdep installs is what scripts/build installs on Debian."""
    package = ET.parse(ROOT / "package.xml").getroot()
    keys = {element.text for element in package if element.tag.endswith("depend")}
    groups, group = {}, None
    for line in (ROOT / "scripts/packages.txt").read_text().splitlines():
        if line.startswith("# ["):
            group = line[3:-1]
        elif line and not line.startswith("#"):
            groups.setdefault(group, set()).add(line)
    wanted = groups["build"] | groups["run"] | groups["tests"]
    named = {name for key in keys for name in DEBIAN.get(key, [key])}
    assert named == wanted, (wanted - named, named - wanted)
    own = set(yaml.safe_load((ROOT / "rosdep.yaml").read_text()))
    assert own <= keys
