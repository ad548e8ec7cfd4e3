# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests that start and kill processes share."""
import os
import signal
import subprocess
import threading
import xmlrpc.client

import rosgraph

from depth_testing import TIMEOUT, wait_until
from file_helpers import start


class Talkative:
    """A program at work; what it prints is in `lines`."""

    def __init__(self, command, **environment):
        self.lines = []
        self.process = self.started(command, dict(os.environ, PYTHONUNBUFFERED='1', **environment))
        self._reader = threading.Thread(target=lambda: self.lines.extend(iter(self.process.stdout.readline, '')))
        self._reader.start()

    started = staticmethod(lambda command, environment: start(command, stderr=subprocess.STDOUT, env=environment))

    def said(self, words, timeout=TIMEOUT):
        """The first line with these words, None if it does not come."""
        return wait_until(lambda: next((line for line in list(self.lines) if words in line), None), timeout)

    def stop(self, number=signal.SIGTERM):
        self.process.send_signal(number)  # if it has not ended
        try:
            self.process.wait(TIMEOUT)
        finally:
            self.process.kill()
            self._reader.join(TIMEOUT)
            self.process.stdout.close()


def pid_of(node):
    """None while the node is not there."""
    try:
        return xmlrpc.client.ServerProxy(rosgraph.Master('/test').lookupNode(node)).getPid('/test')[2]
    except (OSError, xmlrpc.client.Error, rosgraph.MasterException):
        return None


def kill(node):
    """kill -9. Returns the process id that the node had."""
    pid = pid_of(node)
    os.kill(pid, signal.SIGKILL)
    return pid
