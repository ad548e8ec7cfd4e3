# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The three nodes under stress: all_in_focus.launch on a master of its own, good brackets, and what they must give."""
import time
from pathlib import Path

import numpy as np
import rospy
from cv_bridge import CvBridge
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from all_in_focus.image_messages import to_message
from all_in_focus.files.rig import load_rig
from all_in_focus.files.rig_messages import camera_info
from all_in_focus.files.stack import load_focus
from all_in_focus.msg import FocusFrame, FusionReport
from all_in_focus.replay.launch import Launch

from file_helpers import wait_until
from process_testing import pid_of
from tool_helpers import MadeScene, read

FRAMES = 5
NODES = ("/all_in_focus_manager", "/depth_preprocess", "/segmenter", "/fusion", "/rig_publisher")


class Scene(MadeScene):
    """With its pictures, and the pixels that fuse_stack makes of it."""

    def __init__(self, folder):
        super().__init__(folder, FRAMES)
        self.expected, self.depth_image = self.fused(), read(self.depth)
        self.frames = [read(path) for path in sorted(self.stack.iterdir())]
        self.distances = load_focus(self.focus, [path.name for path in sorted(self.stack.iterdir())], FRAMES)


class Graph:
    """all_in_focus.launch with the rig of a scene, on the master of this process. folder: gets what it prints."""

    def __init__(self, scene, folder):
        self.scene = scene
        folder.mkdir(exist_ok=True)
        self._launch = Launch(folder, "all_in_focus", "all_in_focus.launch", f"rig:={scene.rig}",
                              "invalid_values:=[0]")  # as in fuse_stack: 2047 mm is a distance
        rig, self._bridge = load_rig(str(scene.rig)), CvBridge()
        self._rig, self._bracket_id = rig, int(time.time()) % 10 ** 6 * 1000
        self._publishers = {topic: rospy.Publisher(topic, kind, queue_size=50) for topic, kind in (
            ("/depth/image_raw", Image), ("/depth/camera_info", CameraInfo), ("/rgb/image", Image),
            ("/rgb/camera_info", CameraInfo), ("/rgb/focus", FocusFrame))}
        self._images, self._reports, self._segmented = {}, [], set()
        self._subscribers = [
            rospy.Subscriber("/all_in_focus/image", Image, self._on_image, buff_size=2 ** 22),
            rospy.Subscriber("/all_in_focus/report", FusionReport, self._reports.append),
            rospy.Subscriber("/segmentation/processed", Header, lambda header: self._segmented.add(header.stamp))]

    def _on_image(self, image):
        self._images[image.header.stamp] = image
        while len(self._images) > 20:
            del self._images[next(iter(self._images))]

    def connected(self, seconds=60):
        """Whether all nodes listen to their inputs within this time."""
        return wait_until(lambda: all(publisher.get_num_connections() for publisher in self._publishers.values()), seconds)

    def good_bracket(self, seconds=8.0):
        """Sends a depth image and a bracket. Returns "" if the result has the pixels of fuse_stack, else what is wrong."""
        before = len(self._reports)
        stamp = rospy.Time.now()
        self._send_depth(stamp, lambda publisher, message: publisher.publish(message))
        if not wait_until(lambda: stamp in self._segmented, seconds / 2):
            return "the depth image is not segmented"
        self._send_frames(stamp, lambda publisher, message: publisher.publish(message))
        last = stamp + rospy.Duration(0.001 * (FRAMES - 1))

        def report():
            return next((one for one in self._reports[before:] if one.header.stamp in self._images
                         and stamp <= one.header.stamp <= last), None)
        found = wait_until(report, seconds / 2)
        if found is None:
            return "no result came"
        image = self._images[found.header.stamp]
        if not np.array_equal(self._bridge.imgmsg_to_cv2(image, "bgr8"), self.scene.expected):
            return f"other pixels than those of fuse_stack ({found.mode}, {found.frames_seen} frames: {found.notes})"
        return ""

    def send_bracket(self, publish):
        """Sends depth and a bracket by publish(publisher, message), which tells whether the message will arrive. Returns the id
        of the bracket, and of how many of its frames both image and FocusFrame will."""
        stamp = rospy.Time.now()
        self._send_depth(stamp, publish)
        time.sleep(0.1)
        return self._send_frames(stamp, publish)

    def _send_depth(self, stamp, publish):
        depth, rgb = (Header(stamp=stamp, frame_id=frame) for frame in (self._rig.child_frame, self._rig.parent_frame))
        publish(self._publishers["/rgb/camera_info"], camera_info(self._rig.color, rgb))
        publish(self._publishers["/depth/camera_info"], camera_info(self._rig.depth, depth))
        time.sleep(0.05)
        publish(self._publishers["/depth/image_raw"], to_message(self.scene.depth_image, "16UC1", depth))

    def _send_frames(self, stamp, publish):
        self._bracket_id += 1
        through = 0
        for index, frame in enumerate(self.scene.frames):
            header = Header(stamp=stamp + rospy.Duration(0.001 * index), frame_id=self._rig.parent_frame)
            publish(self._publishers["/rgb/camera_info"], camera_info(self._rig.color, header))
            focus = publish(self._publishers["/rgb/focus"], FocusFrame(
                header, self._bracket_id, index, FRAMES, index + 1 == FRAMES, self.scene.distances[index]))
            image = publish(self._publishers["/rgb/image"], to_message(frame, "bgr8", header))
            through += bool(focus and image)
            time.sleep(0.01)
        return self._bracket_id, through

    def good_within(self, seconds):
        """(seconds until a bracket was right, "") or (None, what was wrong with the last one)."""
        begin, wrong = time.monotonic(), "no bracket was sent"
        while time.monotonic() - begin < seconds:
            wrong = self.good_bracket(max(1.0, min(8.0, begin + seconds - time.monotonic())))
            if not wrong:
                return time.monotonic() - begin, ""
        return None, wrong

    def pids(self):
        """Process of each node, by the node's own answer; those that do not answer are missing."""
        found = {node: pid_of(node) for node in NODES}
        return {node: pid for node, pid in found.items() if pid}

    def deaths(self):
        """Processes that ended, a line each."""
        return [reason for _, reason in self._launch.deaths()]

    def resident_mb(self):
        """Memory of the nodelet manager, MB."""
        status = Path(f"/proc/{self.pids()['/all_in_focus_manager']}/status").read_text()
        return int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1]) / 1024

    def close(self):
        for one in [*self._subscribers, *self._publishers.values()]:
            one.unregister()
        self._launch.close()
