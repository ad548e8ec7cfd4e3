# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pixels of messages, converted and checked as src/ros/conversions.cpp does it for the nodes."""
import sys

import cv2
import cv_bridge
import numpy as np
from sensor_msgs.msg import CompressedImage, Image

from all_in_focus.files.errors import one_line
from all_in_focus.files.stack import ALL_BITS, decode_image, eight_bits, is_complete

MILLIMETRES = ("16UC1", "mono16")
METRES = "32FC1"
BRIDGE = cv_bridge.CvBridge()


class ImageError(ValueError):
    """An image that the nodes refuse; the message says why and what to do."""


def check_depth(message):
    """ImageError where depth_preprocess would refuse the image for its encoding or layout."""
    if message.encoding not in (*MILLIMETRES, METRES):
        raise ImageError(f"depth has encoding \"{message.encoding}\": publish 16UC1 (mm) or 32FC1 (m), or take another "
                         "topic")
    value_bytes = 4 if message.encoding == METRES else 2
    _check_layout(message, value_bytes)
    if message.step % value_bytes:
        raise ImageError(f"step is {message.step} bytes, not a whole number of pixels: check its publisher")
    if bool(message.is_bigendian) != (sys.byteorder == "big"):
        raise ImageError("the image is not in the byte order of this computer: publish it in host byte order")


def _check_layout(message, pixel_bytes):
    width, height, encoding, step = message.width, message.height, message.encoding, message.step
    if width == 0 or height == 0:
        raise ImageError(f"the image is empty ({width}x{height}): check its publisher")
    if step < width * pixel_bytes:
        raise ImageError(f"step is {step} bytes, but a row of {width} {encoding} pixels has {width * pixel_bytes}: check its "
                         "publisher")
    if len(message.data) < step * height:
        raise ImageError(f"data holds {len(message.data)} bytes, but {width}x{height} {encoding} with step {step} needs "
                         f"{step * height}: check its publisher")
    if encoding.startswith("yuv") and width % 2:  # OpenCV writes pairs of pixels, the last one beyond the end of the picture
        raise ImageError(f"{encoding} tells pairs of pixels, but the width is {width}: check its publisher")


def color_message(image, header):
    """Image message of a BGR picture of 8 or 16 bits."""
    return to_message(image, "bgr16" if image.dtype == np.uint16 else "bgr8", header)


def to_message(image, encoding, header):
    """Image message. cv_bridge before 1.16 has no argument for the header."""
    message = BRIDGE.cv2_to_imgmsg(image, encoding)
    message.header = header
    return message


def depth_as_sent(message):
    """Values (H x W) of a message that check_depth() accepts: uint16 mm, or float32 m."""
    dtype = np.dtype(np.float32 if message.encoding == METRES else np.uint16)
    return np.ascontiguousarray(_rows(message)[:, :message.width * dtype.itemsize]).view(dtype)


def depth_mm(message, invalid_values=(0,)):
    """Depth (H x W, uint16 mm, 0 = unknown) of a message that check_depth() accepts."""
    values = depth_as_sent(message)
    if values.dtype == np.float32:
        with np.errstate(invalid="ignore", over="ignore"):
            rounded = values * np.float32(1000) + np.float32(0.5)
            values = np.where((rounded >= 1) & (rounded < 65536), rounded, 0).astype(np.uint16)
    return np.where(np.isin(values, [value for value in invalid_values if value > 0]), 0, values).astype(np.uint16)


def bgr(message, deep=False):
    """BGR picture of an Image or CompressedImage, as the fusion node converts it: 8 bit; deep: 16 where the message
    has them. ImageError."""
    if message._type == CompressedImage._type:
        return decoded(message.data, deep)
    try:
        dtype, channels = BRIDGE.encoding_to_dtype_with_channels(message.encoding)
        value_bytes = np.dtype(dtype).itemsize
        row = message.width * value_bytes * channels
        _check_layout(message, value_bytes * channels)
        if message.step != row:  # the Python side of cv_bridge ignores `step`, its C++ side does not
            message = Image(message.header, message.height, message.width, message.encoding, message.is_bigendian, row,
                            _rows(message)[:, :row].tobytes())
        return BRIDGE.imgmsg_to_cv2(message, "bgr16" if deep and value_bytes == 2 else "bgr8")
    except ImageError:
        raise
    except (cv2.error, cv_bridge.CvBridgeError, ValueError, TypeError, AttributeError) as error:
        raise ImageError(f"{one_line(error)}: publish bgr8 or rgb8")


def decoded(data, deep=False):
    """BGR picture of what a camera or image_transport has compressed: gray, colour or with alpha, 8 or 16 bit. 8 bit;
    deep: 16 where it has them. ImageError."""
    if not is_complete(data):
        raise ImageError("the compressed picture is cut short or damaged: check the camera's cable, or the disk of the recording")
    picture = decode_image(data, ALL_BITS)
    if picture is None:  # OpenCV gives no reason
        raise ImageError(f"its {len(data)} bytes cannot be decoded: publish JPEG or PNG")
    if picture.dtype not in (np.uint8, np.uint16):
        raise ImageError(f"the compressed picture has {picture.dtype} pixels: publish 8 or 16 bits")
    return picture if deep else eight_bits(picture)


def _rows(message):
    """The bytes of an image, H x step."""
    data = np.frombuffer(message.data, np.uint8)[:message.step * message.height]
    return data.reshape(message.height, message.step)
