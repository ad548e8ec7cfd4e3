# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_rig: from the command line to the rig folder."""
import argparse
import math
import sys
from functools import partial
from pathlib import Path

from all_in_focus.calibration import fit_report, rig_folder
from all_in_focus.calibration.board import CAMERAS, Board, PairFolders
from all_in_focus.calibration.rig_fit import fit_rig
from all_in_focus.command_line import Input, Output, Parser, digits, number_type, optics
from all_in_focus.files.rig import load_camera
from all_in_focus.progress import Progress

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
        raise argparse.ArgumentTypeError(f"'{text}': expected X,Y in pixels, as in -4.8,-3.9")
    return values


square = number_type(lambda value: 1 <= value <= 1000, "a positive number of mm, from 1 to 1000")  # side, of the board
terms = number_type(lambda value: value in range(4), "0, 1, 2 or 3", digits)
views = number_type(lambda value: value >= 5, "a whole number of at least 5", digits)


def _joined(argv):
    """Joins --ir-offset and its value by =: argparse takes -4.8,-3.9 for an option."""
    if "--ir-offset" in argv[:-1]:
        at = argv.index("--ir-offset")
        return [*argv[:at], f"{argv[at]}={argv[at + 1]}", *argv[at + 2:]]
    return argv


def depth_size(arguments, picture_size):
    """Size (width, height) of the depth images of a camera whose infrared pictures have `picture_size`."""
    return KINECT_DEPTH_SIZE if arguments.kinect and picture_size == KINECT_IR_SIZE else picture_size


def parse_arguments(description):
    """(parser, arguments); arguments.board is a Board, .known the two known cameras or None, .ir_offset (x, y)."""
    parser = Parser(prog="calibrate_rig", description=description)
    files = parser.add_argument_group("from files")
    files.add_argument("--depth-camera", type=Input, metavar="DIR", help="pictures of the depth (infrared) camera, 8 or 16 bit")
    files.add_argument("--color-camera", type=Input, metavar="DIR", help="pictures of the colour camera, of the same names")
    live = parser.add_argument_group("live")
    live.add_argument("--live", action="store_true", help="from the topics ir/image and rgb/image (remap with :=)")
    live.add_argument("--views", type=views, default=25, metavar="N", help="pairs to take, at least; default 25")
    live.add_argument("--save-pictures", type=Output, metavar="DIR", help="keep them, as DIR/depth and DIR/color")
    board = parser.add_argument_group("board")
    board.add_argument("--board", required=True, metavar="CxR", help="inner corners, e.g. 8x6 for 9x7 squares")
    board.add_argument("--square", required=True, type=square, metavar="MM", help="side of a square, as measured")
    cameras = parser.add_argument_group("cameras")
    cameras.add_argument("--depth-info", type=Input, metavar="FILE",
                         help="camera_info of the depth camera's pictures: stays fixed")
    cameras.add_argument("--color-info", type=Input, metavar="FILE", help="of the colour camera: stays fixed")
    cameras.add_argument("--kinect", action="store_true", help="a Kinect v1: --ir-offset "
                                                               f"{KINECT_IR_OFFSET[0]:g},{KINECT_IR_OFFSET[1]:g}")
    cameras.add_argument("--ir-offset", type=offset, metavar="X,Y",
                         help="of the depth image against the infrared picture, pixels; default 0,0")
    cameras.add_argument("--radial", type=terms, default=2, metavar="N",
                         help="radial terms of the distortion, 0 to 3; 0: no distortion at all; default 2")
    cameras.add_argument("--depth-name", default="kinect_depth", metavar="NAME", help="default kinect_depth")
    cameras.add_argument("--color-name", default="dslr", metavar="NAME", help="default dslr")
    cameras.add_argument("--optics", type=optics, metavar="f,F,coc", help="the colour camera's lens: mm, f-number, mm")
    parser.add_argument("--output", type=Output, required=True, metavar="RIG", help="the rig folder")
    parser.add_argument("--force", action="store_true", help="replace the files of a rig that is there")
    arguments = parser.parse_args(_joined(sys.argv[1:]))
    given = (arguments.depth_camera, arguments.color_camera)
    if arguments.live == any(given) or any(given) != all(given):
        parser.error("give --depth-camera and --color-camera, or --live")
    try:
        arguments.board = Board.parse(arguments.board, arguments.square)
    except ValueError as error:
        parser.error(f"argument --board: {error}")
    arguments.known = tuple(load_camera(path) if path else None for path in (arguments.depth_info, arguments.color_info))
    for camera, option in zip(arguments.known, ("--depth-info", "--color-info")):
        if camera and camera.is_fisheye:
            parser.error(f"argument {option}: a fisheye lens (equidistant) cannot be calibrated here")
    arguments.ir_offset = arguments.ir_offset or (KINECT_IR_OFFSET if arguments.kinect else (0.0, 0.0))
    return parser, arguments


def calibrate(arguments, folder, pairs, sizes):
    """Writes the rig; returns the lines to print. folder: RigFolder; pairs: board.Pair; sizes: of both cameras' pictures."""
    fit = fit_rig(arguments.board, pairs, sizes, arguments.known, arguments.radial)
    rig = rig_folder.build_rig(fit, (arguments.depth_name, arguments.color_name),
                               (depth_size(arguments, sizes[0]), sizes[1]), arguments.ir_offset, arguments.optics)
    warnings = []
    for name, part, size, known in zip(CAMERAS, (fit.depth, fit.color), sizes, arguments.known):
        corners = {pair.name: getattr(pair, name) for pair in pairs}
        warnings += fit_report.view_warnings(name, part, corners, size, known)
    names = [pair.name for pair in pairs]
    if not (arguments.optics or (Path(arguments.output) / "optics.yaml").exists()):
        warnings.append("no lens: robot.launch needs the rig's optics.yaml, which --optics f,F,coc writes")
    text = fit_report.record(fit, names, arguments.board, arguments.ir_offset, warnings)
    folder.write(rig, text)
    return (list(fit_report.table(fit, names)) + list(fit_report.summary(fit, rig, arguments.ir_offset))
            + [f"warning: {line}" for line in warnings] + [f"wrote {arguments.output}"])


def _from_files(parser, arguments, calibrate_pairs):
    folders = PairFolders(arguments.depth_camera, arguments.color_camera)
    for warning in folders.warnings:
        parser.warn(warning)
    pairs = list(Progress(folders.pairs(arguments.board), total=len(folders.names), unit="pair"))
    for pair in pairs:
        if pair.unreadable:
            parser.warn(f"{pair.unreadable}: left out")
    if all(pair.depth is None and pair.color is None for pair in pairs):
        raise ValueError(f"no board of {arguments.board} inner corners in any of {len(pairs)} pairs: --board counts the corners "
                         "inside, not the squares")
    print("\n".join(calibrate_pairs(pairs, tuple(folders.sizes))))


def main(description):
    """Returns the exit code."""
    parser, arguments = parse_arguments(description)
    folder = rig_folder.RigFolder(arguments.output, arguments.force, bool(arguments.optics))
    try:
        if arguments.live:
            from all_in_focus.calibration import live_node
            return live_node.run(arguments, partial(calibrate, arguments, folder))
        _from_files(parser, arguments, partial(calibrate, arguments, folder))
        return 0
    finally:
        folder.discard()
