# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_focus: from the command line to the focus table."""
from all_in_focus.calibration import focus_curve
from all_in_focus.calibration.rig_check import registered
from all_in_focus.command_line import Input, Output, Parser, number_type, positive
from all_in_focus.files.focus_table import FocusTable
from all_in_focus.files.output_file import write_picture
from all_in_focus.files.rig import load_rig
from all_in_focus.files.stack import Stack, read_depth
from all_in_focus.progress import Progress

whole = number_type(lambda value: value % 1 == 0, "a whole number")


def parse_arguments(description):
    parser = Parser(prog="calibrate_focus", description=description)
    files = parser.add_argument_group("from files")
    files.add_argument("--stack", type=Input, metavar="DIR|VIDEO", help="a bracket, equal steps from frame to frame")
    files.add_argument("--registered-depth", type=Input, metavar="Z.png", help="depth, registered to the pictures: mm, 16 bit")
    files.add_argument("--depth", type=Input, metavar="D.png", help="instead, with --rig: of the depth camera")
    files.add_argument("--rig", type=Input, metavar="DIR", help="rig folder")
    files.add_argument("--first", type=whole, metavar="N", help="lens step of the first frame; default 0")
    files.add_argument("--step", type=whole, metavar="N", help="lens steps from frame to frame; default 1")
    live = parser.add_argument_group("live")
    live.add_argument("--live", action="store_true",
                      help="one bracket of robot.launch: rgb/image, rgb/focus, depth_registered/image_raw; asks "
                           "focus_bracket_camera for it, and takes its first and step")
    live.add_argument("--timeout", type=positive, default=120.0, metavar="S", help="how long to wait; default 120")
    parser.add_argument("--output", type=Output, required=True, metavar="TABLE.yaml")
    parser.add_argument("--plot", type=Output, metavar="P.png", help="the distances measured, and the table")
    args = parser.parse_args()
    given = (bool(args.stack), bool(args.registered_depth), bool(args.depth), bool(args.rig), args.live)
    if given not in ((1, 1, 0, 0, 0), (1, 0, 1, 1, 0), (0, 0, 0, 0, 1)):
        parser.error("give --stack with --registered-depth, or with --depth and --rig; or --live")
    if args.step == 0:
        parser.error("argument --step: 0 is no step")
    return parser, args


def _from_files(parser, args):
    """(Sharpness, dioptres of its tiles)."""
    stack, sharpness = Stack(args.stack), focus_curve.Sharpness()
    for warning in stack.warnings:
        parser.warn(warning)
    for image in Progress(stack, unit="frame"):
        sharpness.add(image)
    if args.registered_depth:
        depth = read_depth(args.registered_depth)
        _same_size(args.registered_depth, depth.shape[1::-1], sharpness.size)
    else:
        rig = load_rig(args.rig)
        _same_size(f"{args.rig}/color.yaml", (rig.color.width, rig.color.height), sharpness.size)
        read_depth(args.depth, rig.depth)  # its errors
        depth = registered(args.rig, args.depth)
    return sharpness, focus_curve.dioptres_of_registered(depth, sharpness.grid())


def _same_size(name, size, wanted):
    if tuple(size) != tuple(wanted):
        raise ValueError(f"{name}: {size[0]}x{size[1]} pixels, but the pictures have {wanted[0]}x{wanted[1]}")


def main(description):
    """Returns the exit code."""
    parser, args = parse_arguments(description)
    home, first, step = "", 0, 1
    if args.live:
        from all_in_focus.calibration.focus_live import shoot
        sharpness, dioptres, home, first, step = shoot(args.timeout)
    else:
        sharpness, dioptres = _from_files(parser, args)
    first = first if args.first is None else int(args.first)
    step = step if args.step is None else int(args.step)
    curve = focus_curve.fit(sharpness, dioptres)
    table = curve.table(first, step)
    low, high = curve.span()
    lines = [f"{curve.inlier.sum()} tiles of {1 / high:.2f} to {1 / low:.2f} m, each sharpest in one of {curve.frames} frames;",
             f"from the curve they are {curve.error:.3f} dioptres off, at {2 / (low + high):.2f} m "
             f"{1000 * curve.error * (2 / (low + high)) ** 2:.0f} mm (standard deviation of one tile)"]
    FocusTable(table, first, step).save(args.output, ["Written by calibrate_focus.", *lines], home)
    if args.plot:
        write_picture(args.plot, focus_curve.plot(curve, table, first, step))
    print("\n".join(lines))
    for row in table:
        beyond = "" if 1000 / high <= row["mm"] <= 1000 / low else "   extended beyond the depths of the scene"
        print(f"step {row['step']:5d}  {row['mm'] / 1000:7.3f} m{beyond}")
    if len(table) < curve.frames:
        parser.warn(f"{curve.frames - len(table)} of {curve.frames} frames are focused beyond infinity: the table ends before "
                    "them")
    print(f"wrote {args.output}")
    return 0
