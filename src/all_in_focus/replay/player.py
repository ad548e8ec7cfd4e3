# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Plays a bag to the nodes as fast as they work: every input waits for its acknowledgement.

All waiting is in wall time. Node time is that of the bag. It never passes a colour image that is not acknowledged yet,
because the fusion ends brackets at gaps in time.
"""
import re
import threading
import time
from collections import Counter

import dynamic_reconfigure.client
import genpy
import rospy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from all_in_focus.acknowledgements import Acknowledgements
from all_in_focus.bag.bag_file import TYPES
from all_in_focus.bag.brackets import WINDOW

TOPICS = {"depth": "depth/image_raw", "depth_info": "depth/camera_info", "rgb": "rgb/image",
          "rgb_info": "rgb/camera_info", "focus": "rgb/focus"}
ACKNOWLEDGED = {"registration": "depth_registered/processed", "segmentation": "segmentation/processed",
                "fusion": "all_in_focus/processed"}
NODES = {"depth": "depth_preprocess", "depth_registered": "depth_preprocess", "segmentation": "segmenter",
         "rgb": "fusion", "all_in_focus": "fusion"}
LENS = ("focal_length_mm", "aperture", "circle_of_confusion_mm")
POLL = 0.002  # s
CLOCK_PERIOD = 0.1  # s
SETTLE = 0.5  # s, for the connections between the nodes, which cannot be observed from here
CONNECT = 60.0  # s, usual patience for nodes to connect, and for the last result
ACKNOWLEDGE = 10.0  # s, usual patience for one input
ACKNOWLEDGE_RESTORED = 300.0  # s; the last frame is acknowledged when its picture is restored
FOLLOW_UP = 3.0  # s for the segmenter once depth_preprocess is done with a depth image
WINDOW_BYTES = 1 << 27  # of colour images under way, so that the fusion need not drop a bracket; 4 may always wait
MAX_SILENCES = 3  # missing acknowledgements in a row before giving up


class PlayError(ValueError):
    """The bag cannot be played to the end; the message is one line."""


class BagPlayer:
    """Plays BagContents.

    connect, acknowledge: patience in s of wall time, see CONNECT and ACKNOWLEDGE; heartbeat: called often, with the number of
    messages played; may raise. problems: errors that did not end the run, text -> how often.
    """

    def __init__(self, contents, connect=CONNECT, acknowledge=ACKNOWLEDGE, heartbeat=lambda done: None):
        self._contents, self.heartbeat = contents, heartbeat
        self._connect_patience, self._patience = connect, acknowledge
        self._done = 0
        self._silences = self._refusals = 0  # in a row
        self.problems = Counter()
        self._clock = rospy.Publisher("/clock", Clock, queue_size=10)
        self._clock_sent = 0.0  # wall time
        self._now = self._played_to = contents.start
        self._acknowledged = {kind: Acknowledgements() for kind in ACKNOWLEDGED}
        first = {"depth": "registration", "rgb": "fusion"}  # what acknowledges what is sent from here
        self._publishers = {kind: rospy.Publisher(topic, TYPES[kind], self._acknowledged.get(first.get(kind)), queue_size=50,
                                                  latch=kind.endswith("_info"))
                            for kind, topic in TOPICS.items() if contents.counts.get(kind)}
        self._publishers["tf"] = rospy.Publisher("/tf", TFMessage, queue_size=100)
        self._static = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        self._subscribers = {}
        for kind, topic in ACKNOWLEDGED.items():
            self._subscribers[topic] = rospy.Subscriber(topic, Header, self._acknowledged[kind].came)

    def loose_ends(self, outputs):
        """(topic, what is wrong with it) of each connection that is missing."""
        ends = [(topic, "nobody publishes", end) for topic, end in {**self._subscribers, **outputs}.items()]
        ends += [(TOPICS[kind], "nobody listens to", end) for kind, end in self._publishers.items() if kind in TOPICS]
        return [end[:2] for end in ends if end[2].get_num_connections() == 0]

    def pause(self, seconds):
        """Node time stands still."""
        self._wait(lambda: False, seconds)

    def connect(self, outputs, patience=None):
        """Publishes what is latched, and waits until every node listens and every output is connected. PlayError.

        outputs: subscribers by topic; patience: s, instead of the usual one.
        """
        patience = patience or self._connect_patience
        self._static.publish(self._contents.static_transforms)
        self._publishers["depth_info"].publish(self._contents.depth_info)
        self._publishers["rgb_info"].publish(self._contents.rgb_info)
        if not self._wait(lambda: not self.loose_ends(outputs), patience):
            for topic, complaint in self.loose_ends(outputs):  # none, if the last one has just connected
                raise PlayError(f"{complaint} {rospy.resolve_name(topic)} for {patience:g} s: did the node "
                                f"{NODES[topic.split('/')[0]]} start?")
        self.pause(SETTLE)

    def set_optics(self, optics):
        """Sets the lens of the segmenter; numbers that it does not take are problems. PlayError if it does not answer.

        optics: has focal_length_mm, aperture, circle_of_confusion_mm.
        """
        wanted, patience = {name: getattr(optics, name) for name in LENS}, self._connect_patience
        try:
            client = dynamic_reconfigure.client.Client("segmenter", timeout=patience)
            if client.get_parameter_descriptions(timeout=patience) is None:
                raise PlayError("the segmenter does not publish its parameters")
            taken = client.update_configuration(wanted)
            client.close()
        except (rospy.ROSException, rospy.ServiceException) as error:
            raise PlayError(f"the segmenter refuses the optics: {error}")
        self.problems.update(f"segmenter: {name} = {wanted[name]:g} is impossible, it uses {taken[name]:g}" for name in LENS
                             if taken[name] != wanted[name])

    def play(self, follow_optics=True, rate=None):
        """Publishes every message of the bag.

        follow_optics: whether to pass on lens changes in the bag to the segmenter; rate: how many times faster than
        recorded, at most; None: as fast as the nodes work.
        """
        optics, last = self._contents.optics, self._contents.start
        for kind, message, stamp in self._contents.messages():
            if rate:
                self.pause((stamp - last).to_sec() / rate)
                last = stamp
            self._played_to = stamp
            self._advance_clock()
            if kind == "depth":
                self._send_depth(message)
            elif kind == "rgb":
                self._send_color(message)
            elif kind != "optics":
                self._publishers[kind].publish(message)
            elif follow_optics and any(getattr(message, name) != getattr(optics, name) for name in LENS):
                optics = message
                self.set_optics(optics)
            self._done += 1
            self.heartbeat(self._done)
        self._wait_for_color(1)

    def rewind(self):
        """Begins the bag anew: node time jumps back with the first message."""
        self._now = self._played_to = self._contents.start
        for waiting in self._acknowledged.values():
            waiting.give_up()

    def end_bracket(self, enough):
        """Ends the open bracket and waits for its results. enough: called with the number of brackets published;
        returns whether all of them have come."""
        answer = self.finish()
        number = re.match(r"\s*(\d+)", answer.message)
        if not number:
            raise PlayError(f"fusion/finish answers '{answer.message}', not how many brackets were published")
        self._wait(lambda: enough(int(number.group(1))), self._connect_patience)

    def finish(self):
        """Ends the open bracket; returns the answer of the fusion, which comes with the result."""
        answers = []

        def call():
            try:
                rospy.wait_for_service("fusion/finish", self._connect_patience)
                answers.append(rospy.ServiceProxy("fusion/finish", Trigger)())
            except (rospy.ROSException, rospy.ServiceException) as error:
                answers.append(PlayError(f"fusion/finish: {error}"))

        # A service call has no time-out: it gets a thread that can be abandoned.
        threading.Thread(target=call, daemon=True).start()
        if not self._wait(lambda: bool(answers), max(self._connect_patience, self._patience)):
            raise PlayError(f"fusion/finish does not answer within {max(self._connect_patience, self._patience):g} s")
        if isinstance(answers[0], PlayError):
            raise answers[0]
        return answers[0]

    def _send_depth(self, message):
        """Returns when the label image is published, so that no colour image overtakes it."""
        registered, segmented = self._acknowledged["registration"], self._acknowledged["segmentation"]
        for waiting in (registered, segmented):
            waiting.give_up()
            waiting.sent(message.header)
        self._publishers["depth"].publish(message)
        if not self._wait(lambda: not (registered.under_way() and segmented.under_way()), self._patience):
            self._silence(f"depth_preprocess did not acknowledge a depth image within {self._patience:g} s")
            return
        self._silences = 0
        # After three refusals in a row a short wait suffices.
        patience = FOLLOW_UP * (0.1 if self._refusals >= 3 else 1)
        if self._wait(lambda: not segmented.under_way(), patience):
            self._refusals = 0
        else:
            self._refusals += 1
            self.problems["depth_preprocess refused a depth image, or the segmenter never got it"] += 1

    def _send_color(self, message):
        fitting = WINDOW_BYTES // max(1, len(message.data))
        self._wait_for_color(min(WINDOW, max(4, fitting)))
        self._acknowledged["fusion"].sent(message.header)
        self._publishers["rgb"].publish(message)

    def _wait_for_color(self, limit):
        """Waits until fewer than `limit` colour images are unacknowledged."""
        fused = self._acknowledged["fusion"]
        while fused.under_way() >= limit:
            before = fused.received
            if self._wait(lambda: fused.received > before or not fused.under_way(), self._patience):
                self._silences = 0
            else:
                fused.give_up()
                text = f"fusion did not acknowledge colour images within {self._patience:g} s"
                if "focus" in self._publishers:
                    text += " (is there a focus message for each, of the same stamp?)"
                self._silence(text)

    def _silence(self, text):
        self.problems[text] += 1
        self._silences += 1
        if self._silences >= MAX_SILENCES:
            raise PlayError(f"{text}, {self._silences} times in a row")

    def _wait(self, condition, limit):
        """Whether the condition becomes true within `limit` seconds of wall time."""
        deadline = time.monotonic() + limit
        while not condition():
            if time.monotonic() > deadline:
                return False
            if rospy.is_shutdown():
                raise PlayError("stopped from outside")
            self._advance_clock()
            self.heartbeat(self._done)
            time.sleep(POLL)
        return True

    def _advance_clock(self):
        """Node time never goes back; it is repeated now and then for nodes that have just started."""
        first = self._acknowledged["fusion"].first()
        stamp = self._played_to if first is None else min(self._played_to, genpy.Time(nsecs=first))
        if stamp > self._now or time.monotonic() - self._clock_sent > CLOCK_PERIOD:
            self._now = max(self._now, stamp)
            self._clock.publish(Clock(self._now))
            self._clock_sent = time.monotonic()
