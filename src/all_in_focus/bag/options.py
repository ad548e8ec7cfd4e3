# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line options of the programs that read bags."""
import argparse

import yaml

from all_in_focus.bag.brackets import Rules
from all_in_focus.bag.bag_file import Topics, load_topics
from all_in_focus.command_line import Input, digits, number_type, optics

# The nodes refuse what lies outside.
bracket_size = number_type(lambda value: 0 <= value <= 65534, "a whole number from 0 to 65534", digits)
bracket_gap = number_type(lambda value: 0 <= value <= 3600, "a number of s from 0 to 3600")
label_max_age = number_type(lambda value: 0 < value <= 3600, "a positive number of s, 3600 at most")


def add_topics(parser):
    group = parser.add_argument_group("topics in the bag")
    group.add_argument("--topics", type=Input, metavar="FILE", help="their names, as check_bag --save-topics writes them")
    for kind, name in vars(Topics()).items():
        group.add_argument(option_of(kind), metavar="NAME", help=f"default {name}")


def add_nodes(parser):
    """Options for what the bag does not say, named as those of evaluate_bag."""
    parser.add_argument("--optics", type=optics, metavar="f,F,coc", help="default: what the bag says")
    fusion = parser.add_argument_group("brackets, where the bag has no focus messages")
    fusion.add_argument("--bracket-size", type=bracket_size, default=Rules.size, metavar="N",
                        help="frames in a bracket; 0: by gaps")
    fusion.add_argument("--bracket-gap", type=bracket_gap, default=Rules.gap, metavar="S",
                        help="a longer gap ends a bracket, 0: none does; default 1")
    fusion.add_argument("--label-max-age", type=label_max_age, default=Rules.max_age, metavar="S",
                        help="oldest depth to use; default 1")
    parser.add_argument("--invalid-values", type=_list_of_mm, default=[0, 65535], metavar="[MM,...]",
                        help="depths that mean unknown; default [0,65535], as in the files; with 2047 for raw Kinect streams")


def option_of(kind):
    """--depth-info-topic of depth_info."""
    return f"--{kind.replace('_', '-')}-topic"


def topics(args):
    """Topics: each from its option, else from the file, else the default."""
    names = vars(load_topics(args.topics) if args.topics else Topics())
    return Topics(**{kind: getattr(args, f"{kind}_topic") or name for kind, name in names.items()})


def rules(args):
    return Rules(args.bracket_size, args.bracket_gap, args.label_max_age)


def _list_of_mm(text):
    """argparse type: a YAML list of depths of 16 bits."""
    try:
        values = yaml.safe_load(text)
    except yaml.YAMLError:
        values = None
    if not isinstance(values, list) or not all(type(value) is int and 0 <= value <= 65535 for value in values):
        raise argparse.ArgumentTypeError(f"'{text}': expected a list of whole numbers from 0 to 65535, such as [0,2047,65535]")
    return values
