# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests that unload nodelets share."""
import rospy
from nodelet.srv import NodeletLoad, NodeletUnload

from depth_testing import TIMEOUT
from process_testing import pid_of


class Manager:
    """A nodelet manager that must live on."""

    def __init__(self, name='/manager'):
        self.name = name
        for service in ('load_nodelet', 'unload_nodelet'):
            rospy.wait_for_service(f'{name}/{service}', TIMEOUT)
        self.pid = pid_of(name)
        self._load = rospy.ServiceProxy(name + '/load_nodelet', NodeletLoad)
        self._unload = rospy.ServiceProxy(name + '/unload_nodelet', NodeletUnload)

    def load(self, nodelet):
        self._load(name='/' + nodelet, type='all_in_focus/' + nodelet)

    def unload(self, nodelet):
        """Fails if the manager has died, or dies of it."""
        self._unload('/' + nodelet)
        if pid_of(self.name) != self.pid:
            raise AssertionError(f'{self.name} died when {nodelet} was unloaded')
