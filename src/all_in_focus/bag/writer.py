# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writes a depth image and a focus stack into a bag, as if a robot had recorded them."""
import errno
from pathlib import Path

import genpy
import rosbag
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from all_in_focus.image_messages import color_message, to_message
from all_in_focus.files.output_file import whole_file
from all_in_focus.files.rig import same_shape
from all_in_focus.files.rig_messages import camera_info, static_transform
from all_in_focus.files.stack import StackError, size_text
from all_in_focus.msg import FocusFrame, Optics
from all_in_focus.progress import Progress

START_NS = 1000 * 10 ** 9  # stamp of the first frame, ns; the same in every bag, so that bags can be compared


def stamp_of(index, rate):
    """Stamp of a frame; rate in Hz."""
    return genpy.Time(nsecs=START_NS + round(index * 1e9 / rate))


def _write_latched(bag, topic, message, stamp):
    """rosbag stores the header with the connection and latches the topic when it plays the bag."""
    bag.write(topic, message, stamp, connection_header={
        "topic": topic, "type": message._type, "md5sum": message._md5sum, "latching": "1",
        "message_definition": message._full_text, "callerid": "/make_bag"})


def _fill(bag, depth, rig, stack, rate, with_focus):
    start = stamp_of(0, rate)
    _write_latched(bag, "/tf_static", TFMessage([static_transform(rig, start)]), start)
    if rig.optics is not None:
        _write_latched(bag, "/rgb/optics", Optics(**vars(rig.optics)), start)

    # Messages of equal time are played in the order in which their topics were first written: depth before colour.
    header = Header(stamp=start, frame_id=rig.child_frame)
    bag.write("/depth/camera_info", camera_info(rig.depth, header), start)
    bag.write("/depth/image_raw", to_message(depth, "16UC1", header), start)

    for index, frame in enumerate(Progress(stack, unit="frame")):
        if not same_shape(frame.shape[1::-1], (rig.color.width, rig.color.height)):
            raise StackError(f"{stack.path}: {size_text(frame)} pixels, but color.yaml is of {rig.color.width}x"
                             f"{rig.color.height}: not the same picture")
        stamp = stamp_of(index, rate)
        header = Header(stamp=stamp, frame_id=rig.parent_frame)
        bag.write("/rgb/camera_info", camera_info(rig.color, header), stamp)
        if with_focus:
            bag.write("/rgb/focus", FocusFrame(header=header, bracket_id=0, index=index, count=len(stack),
                                               last=index + 1 == len(stack), focus_distance=stack.distances[index]), stamp)
        bag.write("/rgb/image", color_message(frame, header), stamp)


def write_bag(output, depth, rig, stack, rate=30.0, with_focus=True):
    """Writes the bag; on any error nothing is left behind and an older bag stays.

    depth: 16-bit image in mm; rig: a Rig; stack: a Stack; rate: colour frames per second;
    with_focus: whether to write FocusFrame messages.
    """
    if Path(output).is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder", str(output))
    with whole_file(output) as working, rosbag.Bag(str(working), "w", compression=rosbag.Compression.LZ4) as bag:
        _fill(bag, depth, rig, stack, rate, with_focus)
