# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_rig: from the command line to the rig folder."""
import sys

from tqdm import tqdm

from all_in_focus.calibration import CalibrationError, advice, report, rig_folder
from all_in_focus.calibration.arguments import depth_size, parse_arguments
from all_in_focus.calibration.board import Board, find_corners
from all_in_focus.calibration.pairs import PairFolders
from all_in_focus.calibration.rig_fit import fit_rig

DESCRIPTION = """Calibrate the rig of depth and colour camera from pictures of a chessboard that both take at the same
time: from files, or live. Writes the rig folder."""


def calibrate(arguments, pairs, sizes):
    """Write the rig and return what is to be said, in lines; pairs: pairs.Pair; sizes: of both cameras' pictures."""
    fit = fit_rig(arguments.board, pairs, sizes, arguments.known, arguments.radial)
    rig = rig_folder.build_rig(fit, (arguments.depth_name, arguments.color_name),
                               (depth_size(arguments, sizes[0]), sizes[1]), arguments.ir_offset, arguments.optics)
    warnings = []
    for name, part, size, known in zip(("depth", "color"), (fit.depth, fit.color), sizes, arguments.known):
        corners = {pair.name: getattr(pair, name) for pair in pairs}
        warnings += advice.warnings(name, part, corners, size, known)
    names = [pair.name for pair in pairs]
    text = report.record(fit, names, arguments.board, arguments.ir_offset, warnings)
    rig_folder.write_rig(arguments.output, rig, text, arguments.force)
    return (list(report.table(fit, names)) + list(report.summary(fit, rig, arguments.ir_offset))
            + ["warning: " + line for line in warnings] + ["wrote " + arguments.output])


def _other_board(folders, board):
    """A board of another size that is there: who counts squares, or one corner too few, is told."""
    for columns, rows in ((board.columns - 1, board.rows - 1), (board.columns + 1, board.rows + 1),
                          (board.columns + 1, board.rows), (board.columns, board.rows + 1)):
        other = Board(max(columns, rows), min(columns, rows), board.square)
        if other.rows >= 3 and any(find_corners(folders.first_picture(camera), other) is not None for camera in (0, 1)):
            return "; the pictures show one of %s: --board counts the corners inside" % other
    return ""


def _from_files(parser, arguments):
    folders = PairFolders(arguments.depth_camera, arguments.color_camera)
    for warning in folders.warnings:
        parser.warn(warning)
    pairs = list(tqdm(folders.pairs(arguments.board), total=len(folders.names), unit="pair",
                      disable=not sys.stderr.isatty()))
    for pair in pairs:
        if pair.unreadable:
            parser.warn(pair.unreadable + ": left out")
    if all(pair.depth is None and pair.color is None for pair in pairs):
        raise CalibrationError("no board of %s inner corners in any of %d pairs%s"
                               % (arguments.board, len(pairs), _other_board(folders, arguments.board)))
    for line in calibrate(arguments, pairs, tuple(folders.sizes)):
        print(line)


def main(argv):
    """Returns the exit code."""
    if "--live" in argv:
        import rospy  # files need no ROS
        argv = rospy.myargv(argv)
    parser, arguments = parse_arguments(argv, DESCRIPTION)
    try:
        rig_folder.refuse_existing(arguments.output, arguments.force)
        rig_folder.refuse_read_only(arguments.output)
        if arguments.live:
            from all_in_focus.calibration import live_node
            return live_node.run(arguments, lambda pairs, sizes: calibrate(arguments, pairs, sizes))
        _from_files(parser, arguments)
    except (ValueError, OSError) as error:
        parser.error(error)
    return 0
