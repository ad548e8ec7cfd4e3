# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests that kill processes share."""
import os
import signal
import xmlrpc.client

import rosgraph


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
