# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests that kill processes share."""
import os
import signal
import xmlrpc.client

import rosgraph

PROMISED = 10  # s from kill -9 until results are right again, as docs/reliability.md says


def recovery():
    """s that a test allows: what is promised, on a computer with much else to do up to three times that, as its load says."""
    return PROMISED * min(3.0, max(1.0, os.getloadavg()[0] / os.cpu_count()))


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
