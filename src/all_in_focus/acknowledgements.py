# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the nodes have been sent and have not finished yet."""
import threading
from collections import Counter

import rospy


class Acknowledgements(rospy.SubscribeListener):
    """Stamps (ns) of inputs that were sent and not yet acknowledged. Thread-safe. As listener of the publisher: when somebody
    begins to listen, it may be the node, which stopped for a moment, and knows nothing of what was sent before."""

    def __init__(self):
        self._lock = threading.Lock()
        self._under_way = Counter()
        self.received = 0

    def sent(self, header):
        with self._lock:
            self._under_way[header.stamp.to_nsec()] += 1

    def came(self, header):
        with self._lock:
            self.received += 1
            self._under_way -= Counter({header.stamp.to_nsec(): 1})  # an unexpected stamp changes nothing

    def under_way(self):
        with self._lock:
            return sum(self._under_way.values())

    def first(self):
        """Smallest stamp (ns) that is not acknowledged, or None."""
        with self._lock:
            return min(self._under_way, default=None)

    def give_up(self):
        """Waits no longer for anything sent so far."""
        with self._lock:
            self._under_way.clear()

    def peer_subscribe(self, *_):
        self.give_up()
