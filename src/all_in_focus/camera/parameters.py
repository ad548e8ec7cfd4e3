# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Private parameters of a node, checked."""
import math

import rospy


class ParameterError(ValueError):
    """A parameter that is missing or impossible; the message is one line that names it."""


def text(name, default="", among=()):
    value = str(rospy.get_param("~" + name, default))
    if among and value not in among:
        raise ParameterError(f"~{name}: '{value}' is not one of {', '.join(among)}")
    return value


def number(name, default, low=-math.inf):
    value = rospy.get_param("~" + name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value < math.inf:
        raise ParameterError(f"~{name}: expected a number{_at_least(low)}, not '{value}'")
    return value


def whole(name, default, low=-math.inf):
    value = number(name, default, low)
    if value != int(value):
        raise ParameterError(f"~{name}: expected a whole number{_at_least(low)}, not '{value}'")
    return int(value)


def flag(name, default):
    value = rospy.get_param("~" + name, default)
    if not isinstance(value, bool):
        raise ParameterError(f"~{name}: expected true or false, not '{value}'")
    return value


def _at_least(low):
    return "" if low == -math.inf else f" of at least {low:g}"
