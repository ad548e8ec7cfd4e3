# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Runs nodelets that register depth, each alone in a process, on the same images through a ROS master."""
import json
import struct
import subprocess
import sys
import time

import numpy as np
import rospkg
import rospy

import graph_source
import ros_run

FRAMES, RATE = 100, 30
NODE = "registration"

# Class of the nodelet, topic of its result, remappings, parameters.
NODELETS = {
    "depth_preprocess (refined)": ("all_in_focus/depth_preprocess", "depth_registered/image", [], {"mode": "refined"}),
    "depth_preprocess (paper)": ("all_in_focus/depth_preprocess", "depth_registered/image", [], {"mode": "paper"}),
    "depth_image_proc/register": ("depth_image_proc/register", "depth_registered/image_rect",
                                  ["depth/image_rect:=depth/image_raw"], {}),
}


class Runner:
    """with Runner(rig folder, depth image) as runner: a master runs."""

    def __init__(self, rig, depth):
        self.source = [sys.executable, graph_source.__file__, "--rig", rig, "--depth", depth, "--depth-only", "--rate",
                       str(RATE), "--frames", str(FRAMES)]
        self.ros = ros_run.Ros()

    def __enter__(self):
        self.ros.__enter__()
        rospy.init_node("compare", disable_signals=True)
        return self

    def __exit__(self, *_):
        self.ros.__exit__()

    def programs(self):
        """name -> function () -> CPU time a frame, latency, in ms; None where the nodelet is not installed."""
        return {name: (lambda nodelet=nodelet: self.run(*nodelet)) if installed(nodelet[0]) else None
                for name, nodelet in NODELETS.items()}

    def run(self, nodelet, topic, remappings, parameters):
        for name, value in parameters.items():
            rospy.set_param(f"/{NODE}/{name}", value)
        process = self.ros.start([ros_run.program("nodelet", "nodelet"), "standalone", nodelet, "__name:=" + NODE, *remappings])
        latencies = []
        subscriber = rospy.Subscriber(topic, rospy.AnyMsg, lambda m: latencies.append(age_ms(m)), queue_size=FRAMES)
        try:
            source = subprocess.Popen(self.source, stdout=subprocess.PIPE, universal_newlines=True)
            time.sleep(2)  # until it is up; images come later still
            before = ros_run.cpu_seconds(process.pid)
            said = source.stdout.readline()
            if not said or json.loads(said)["sent"] != FRAMES:
                raise RuntimeError(f"{nodelet}: the cameras could not be played")
            time.sleep(0.3)
            cpu = ros_run.cpu_seconds(process.pid) - before
            source.wait(60)
        finally:
            subscriber.unregister()
            self.ros.stop(process)
        if len(latencies) < FRAMES // 2:
            raise RuntimeError(f"{nodelet}: {len(latencies)} results for {FRAMES} images")
        return 1000 * cpu / len(latencies), float(np.median(latencies))


def installed(nodelet):
    try:
        rospkg.RosPack().get_path(nodelet.split("/")[0])
        return True
    except rospkg.ResourceNotFound:
        return False


def age_ms(message):
    """Of a message that begins with a Header: sequence number, seconds, nanoseconds."""
    _, seconds, nanoseconds = struct.unpack_from("<3I", message._buff)
    return (rospy.Time.now() - rospy.Time(seconds, nanoseconds)).to_sec() * 1000
