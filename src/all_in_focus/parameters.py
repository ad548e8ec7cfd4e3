# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Private parameters of a node, checked as src/ros/parameters.hpp does for the nodelets; but what is impossible ends the node:
a ValueError, whose line names the parameter."""
import math
from types import SimpleNamespace
from typing import NamedTuple

import rospy


class Parameter(NamedTuple):
    """default: a value of the type that the parameter has; meaning: for --help; limit: the least number, or the texts to choose
    from."""
    default: object
    meaning: str
    limit: object = None


def read(table):
    """The values of a table of Parameters by name, as attributes."""
    readers = {bool: flag, int: whole, float: number, str: text, list: lambda name, value: rospy.get_param("~" + name, value)}
    return SimpleNamespace(**{name: readers[type(one.default)](name, one.default, *([] if one.limit is None else [one.limit]))
                              for name, one in table.items()})


def text(name, default="", among=()):
    """A number counts as text: a name may consist of digits."""
    value = rospy.get_param("~" + name, default)
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise ValueError(f"~{name}: expected text, not {value}: write it in quotes")
    if among and value != default and str(value) not in among:
        raise ValueError(f"~{name}: '{value}' is not one of {', '.join(among)}")
    return str(value)


def number(name, default, low=-math.inf):
    value = _meaning(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value < math.inf:
        raise ValueError(f"~{name}: expected a number{_at_least(low)}, not '{value}'")
    return value


def whole(name, default, low=-math.inf):
    value = number(name, default, low)
    if value != int(value):
        raise ValueError(f"~{name}: expected a whole number{_at_least(low)}, not '{value}'")
    return int(value)


def flag(name, default):
    value = _meaning(name, default)
    if not isinstance(value, bool):
        raise ValueError(f"~{name}: expected true or false, not '{value}'")
    return value


def _meaning(name, default):
    """Text that is nothing but a number, or true or false, counts as that, and that is said."""
    value = rospy.get_param("~" + name, default)
    if not isinstance(value, str):
        return value
    try:
        meant = value.lower() == "true" if value.lower() in ("true", "false") else float(value)
    except ValueError:
        return value
    shown = str(meant).lower() if isinstance(meant, bool) else f"{meant:g}"
    rospy.logwarn("%s is text: '%s' is taken as %s; write it without quotes", name, value, shown)
    return meant


def _at_least(low):
    return "" if low == -math.inf else f" of at least {low:g}"
