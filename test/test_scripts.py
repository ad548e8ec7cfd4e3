# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The scripts that build, test and check."""
import re
import runpy
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import psutil
import pytest
import yaml

from file_helpers import run

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
GOOD = """echo "<testsuite><testcase classname='Case' name='passes' time='1'/></testsuite>" >$0"""


def run_tests(build, *options, **commands):
    """test/run on tests that are lines of sh, whose $0 is the result file."""
    build.mkdir()
    lines = [f'add_test({name} sh -c [==[{command}]==] "{build}/test_results/gtest-{name}.xml")'
             for name, command in commands.items()]
    (build / 'CTestTestfile.cmake').write_text('\n'.join([*lines, 'set_tests_properties(rare PROPERTIES LABELS "slow;waits")']))
    return run([ROOT / 'test/run', *options, build])


def test_what_crashes_hangs_or_fails_is_counted_and_named(tmp_path):
    done = run_tests(tmp_path / 'build', '--limit', '8', good=GOOD, crashes='kill -9 $$', hangs='sleep 1000',
                     fails=f'{GOOD}; exit 7', rare=GOOD)
    assert done.returncode == 1, done.stderr
    lines = done.stdout.splitlines()
    assert lines[-1] == '2 passed, 3 failed'
    assert [line.split(':')[1].strip() for line in lines if line.startswith('failed: ')] == [
        'gtest-crashes', 'gtest-hangs', 'gtest-fails']
    assert 'minutes of CPU time' in lines[-2]
    assert lines[lines.index('The 10 slowest files:') + 1].endswith(' s  gtest-hangs')


def test_what_fails_in_a_part_of_a_test_is_counted(tmp_path):
    part = GOOD.replace('<testsuite>', "<testsuite failures='2' errors='0'>")
    done = run_tests(tmp_path / 'build', part=part, rare=GOOD)
    assert done.returncode == 1 and 'failed: gtest-part: subTest: 2 in parts of a test' in done.stdout
    assert done.stdout.endswith('\n1 passed, 1 failed\n')


def test_slow_tests_run_only_if_all_do(tmp_path):
    assert run_tests(tmp_path / 'default', good=GOOD, rare='exit 1').stdout.endswith('\n1 passed, 0 failed\n')
    assert run_tests(tmp_path / 'all', '--all', good=GOOD, rare='exit 1').stdout.endswith('\n1 passed, 1 failed\n')


def test_what_a_test_leaves_running_is_ended(tmp_path):
    left = tmp_path / 'left'
    run_tests(tmp_path / 'build', '--all', rare=f'setsid sleep 1000 & echo $! >{left}; {GOOD}')
    assert not psutil.pid_exists(int(left.read_text()))


def test_a_python_test_that_hangs_is_ended_and_the_others_run(tmp_path):
    tests, results = tmp_path / 'test_two.py', tmp_path / 'results.xml'
    tests.write_text('import time\n\n\ndef test_hangs():\n    time.sleep(10000)\n\n\ndef test_passes():\n    pass\n')
    run([sys.executable, '-m', 'pytest', '-c', ROOT / 'test/pytest.ini', '--rootdir', tmp_path, '-n1', '--timeout=3',
         '--junitxml', results, tests])
    errors = {case.get('name'): case.find('error') for case in ET.parse(str(results)).iter('testcase')}
    assert errors['test_passes'] is None and "crashed while running 'test_two.py::test_hangs'" in errors['test_hangs'].text


def test_every_slow_test_is_named_with_its_reason():
    node_tests = re.search(r'set\(slow_node_tests ([^)]*)', (HERE / 'CMakeLists.txt').read_text())[1].split()
    slow = [f'{name}.test' for name in node_tests]
    for path in HERE.glob('test_*.py'):
        text = path.read_text()
        slow += [path.name] if re.search(r'^pytestmark = pytest\.mark\.slow$', text, re.M) else []
        slow += re.findall(r'^ *@pytest\.mark\.slow\n(?:@.*\n)*def (\w+)', text, re.M)
    reasons = (ROOT / 'CONTRIBUTING.md').read_text()
    assert len(slow) > 2 and [name for name in slow if f'`{name}`' not in reasons] == []


def test_lint_runs_what_it_is_asked_for():
    done = run([ROOT / 'scripts/lint', 'python_3_8'])
    assert done.returncode == 0 and '1 passed' in done.stdout, done.stdout
    done = run([ROOT / 'scripts/lint', 'no_such_check'])
    assert done.returncode == 2 and 'CHECK: clang_format clang_tidy' in done.stderr


def test_clang_tidy_checks_what_has_changed_and_what_includes_it():
    lint = runpy.run_path(str(HERE / 'lint.py'))
    answers = {'rev-parse': ['new'], 'merge-base': ['old'], 'diff': ['include/all_in_focus/optics.hpp'], 'ls-files': []}
    lint['changes'].__globals__['git'] = lambda command, *_: answers.get(command)
    chosen, why = lint['tidy_sources']()
    assert why.startswith('what has changed since origin/main')
    assert {'src/core/optics/optics.cpp', 'src/tools/segment_depth.cpp'} <= set(chosen)  # this one through dof_segmentation.hpp
    assert 'src/core/util/srgb.cpp' not in chosen
    every = lint['tidy_sources'](every=True)[0]
    answers['merge-base'] = answers['rev-parse']  # the only commit
    some, why = lint['tidy_sources']()
    assert 'no older commit' in why and 20 < len(some) < len(every)


@pytest.mark.slow
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


# Debian packages, not of ROS, whose names are not those of their keys in package.xml.
KEYS = {'build-essential': 'catkin', 'cmake': 'catkin', 'libgtest-dev': 'rostest', 'nlohmann-json3-dev': 'nlohmann-json-dev',
        'ros-core': 'rosbag', 'zlib1g-dev': 'zlib'}
# Runs what message_generation has made; comes with ros-core; of a group of its own.
WITHOUT_PACKAGE = {'message_runtime', 'roslaunch', 'rviz'}


def plain(name):
    """What libtf2-ros-dev, python3-tf2-ros and the key tf2_ros have in common."""
    return re.sub("^(lib|ros-|python3-)|-(dev|tools)$", "", name.replace("_", "-"))


def test_package_xml_names_all_that_is_installed():
    """What rosdep installs is what scripts/build installs on Debian."""
    package = ET.parse(ROOT / "package.xml").getroot()
    keys = {element.text for element in package if element.tag.endswith("depend")}
    groups, group = {}, None
    for line in (ROOT / "scripts/packages.txt").read_text().splitlines():
        if line.startswith("# ["):
            group = line[3:-1]
        elif line and not line.startswith("#"):
            groups.setdefault(group, set()).add(line.split()[-1])
    packages = groups["build"] | groups["run"] | groups["lab"] | groups["tests"]
    assert {plain(KEYS.get(name, name)) for name in packages} == {plain(key) for key in keys - WITHOUT_PACKAGE}
    own = set(yaml.safe_load((ROOT / "rosdep.yaml").read_text()))
    assert own <= keys


def test_containers_and_workflow_call_what_there_is():
    workflow = yaml.safe_load((ROOT / ".github/workflows/test.yml").read_text())
    job = workflow["jobs"]["test"]
    files = [ROOT / "docker" / f"{base}.Dockerfile" for base in job["strategy"]["matrix"]["base"]]
    assert sorted(files) == sorted((ROOT / "docker").iterdir())
    commands = [step["run"] for step in job["steps"] if "run" in step] + [path.read_text() for path in files]
    for script in re.findall(r"scripts/\w+", "\n".join(commands)):
        assert (ROOT / script).is_file(), script
