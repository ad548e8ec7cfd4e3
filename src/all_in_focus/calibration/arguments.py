# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Arguments of calibrate_rig, checked."""
import argparse
import math

from all_in_focus.calibration.board import Board
from all_in_focus.command_line import Parser, optics, positive
from all_in_focus.files.rig import load_camera

# The depth image of a Kinect v1 lies higher and more to the left than its IR picture, by half a correlation window:
# http://wiki.ros.org/kinect_calibration/technical measured it, openni_camera takes (-5, -4).
KINECT_IR_OFFSET = (-4.8, -3.9)
# libfreenect's infrared pictures have eight rows more than its depth images.
KINECT_IR_SIZE, KINECT_DEPTH_SIZE = (640, 488), (640, 480)


def offset(text):
    """argparse type: X,Y in pixels."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 2 or not all(math.isfinite(value) and abs(value) < 100 for value in values):
        raise argparse.ArgumentTypeError("'%s': expected X,Y in pixels, as in -4.8,-3.9" % text)
    return values


def terms(text):
    if text not in ("0", "1", "2", "3"):
        raise argparse.ArgumentTypeError("'%s': expected 0, 1, 2 or 3" % text)
    return int(text)


def whole(text):
    if not text.isdigit() or int(text) < 5:
        raise argparse.ArgumentTypeError("'%s': expected a whole number of at least 5" % text)
    return int(text)


def _joined(argv):
    """-4.8,-3.9 looks like an option to argparse unless it is joined with its own by =."""
    if "--ir-offset" in argv[:-1]:
        at = argv.index("--ir-offset")
        return argv[:at] + ["%s=%s" % tuple(argv[at:at + 2])] + argv[at + 2:]
    return argv


def depth_size(arguments, picture_size):
    """Size of the depth images (width, height) where infrared pictures have that of the argument."""
    return KINECT_DEPTH_SIZE if arguments.kinect and picture_size == KINECT_IR_SIZE else picture_size


def parse_arguments(argv, description):
    """(parser, arguments); arguments.board is a Board, .known the two known cameras or None, .ir_offset (x, y)."""
    parser = Parser(prog="calibrate_rig", description=description)
    files = parser.add_argument_group("from files")
    files.add_argument("--depth-camera", metavar="DIR", help="pictures of the depth (infrared) camera, 8 or 16 bit")
    files.add_argument("--color-camera", metavar="DIR", help="pictures of the colour camera, of the same names")
    live = parser.add_argument_group("live")
    live.add_argument("--live", action="store_true", help="from the topics ir/image and rgb/image (remap with :=)")
    live.add_argument("--views", type=whole, default=25, metavar="N", help="pairs to take, at least; default 25")
    live.add_argument("--save-pictures", metavar="DIR", help="keep them, as DIR/depth and DIR/color")
    board = parser.add_argument_group("board")
    board.add_argument("--board", required=True, metavar="CxR", help="inner corners, e.g. 8x6 for 9x7 squares")
    board.add_argument("--square", required=True, type=positive, metavar="MM", help="side of a square, as measured")
    cameras = parser.add_argument_group("cameras")
    cameras.add_argument("--depth-info", metavar="FILE", help="camera_info of the depth camera's pictures: stays fixed")
    cameras.add_argument("--color-info", metavar="FILE", help="of the colour camera: stays fixed")
    cameras.add_argument("--kinect", action="store_true", help="a Kinect v1: --ir-offset %g,%g" % KINECT_IR_OFFSET)
    cameras.add_argument("--ir-offset", type=offset, metavar="X,Y",
                         help="of the depth image against the infrared picture, pixels; default 0,0")
    cameras.add_argument("--radial", type=terms, default=2, metavar="N",
                         help="radial terms of the distortion, 0 to 3; 0: no distortion at all; default 2")
    cameras.add_argument("--depth-name", default="kinect_depth", metavar="NAME", help="default kinect_depth")
    cameras.add_argument("--color-name", default="dslr", metavar="NAME", help="default dslr")
    cameras.add_argument("--optics", type=optics, metavar="f,F,coc", help="the colour camera's lens: mm, f-number, mm")
    parser.add_argument("--output", required=True, metavar="RIG", help="the rig folder")
    parser.add_argument("--force", action="store_true", help="replace the files of a rig that is there")
    arguments = parser.parse_args(_joined(argv[1:]))
    given = (arguments.depth_camera, arguments.color_camera)
    if arguments.live == any(given) or any(given) != all(given):
        parser.error("give --depth-camera and --color-camera, or --live")
    try:
        arguments.board = Board.parse(arguments.board, arguments.square)
    except ValueError as error:
        parser.error("argument --board: %s" % error)
    try:
        arguments.known = tuple(load_camera(path) if path else None
                                for path in (arguments.depth_info, arguments.color_info))
    except ValueError as error:
        parser.error(error)
    arguments.ir_offset = arguments.ir_offset or (KINECT_IR_OFFSET if arguments.kinect else (0.0, 0.0))
    return parser, arguments
