# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""run_pytest.py RESULTS.xml FILE: runs a file of tests; one that hangs is ended, and its results say so.

An hour is no limit for a slow computer: the longest file takes minutes.
"""
import os
import signal
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

LIMIT_S = 3600
KILL_S = 10


def end(run):
    """End a program and all that it has started."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        if run.poll() is None:
            os.killpg(run.pid, number)
            try:
                run.wait(KILL_S)
            except subprocess.TimeoutExpired:
                pass


def main(results, tests, limit_s=LIMIT_S):
    if results.exists():
        results.unlink()
    command = [sys.executable, '-m', 'pytest', '-q', '-rs', '-p', 'no:cacheprovider', '-o', 'junit_family=xunit2',
               f'--junitxml={results}', str(tests)]
    run = subprocess.Popen(command, start_new_session=True)
    try:
        return run.wait(limit_s)
    except subprocess.TimeoutExpired:
        suite = ET.Element('testsuite', name=tests.stem)
        case = ET.SubElement(suite, 'testcase', classname=tests.stem, name='all')
        ET.SubElement(case, 'failure', message=f'timed out after {limit_s} s: a test hangs').text = str(tests)
    finally:
        end(run)
    ET.ElementTree(suite).write(str(results), encoding='utf-8', xml_declaration=True)
    return 1


if __name__ == '__main__':
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
