# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Private parameters of a node, checked; errors are one line that names the parameter."""
import math

import rospy


class ParameterError(ValueError):
    """A parameter that is missing or impossible."""


def text(name, default="", among=()):
    value = str(rospy.get_param("~" + name, default))
    if among and value not in among:
        raise ParameterError("~%s: '%s' is not one of %s" % (name, value, ", ".join(among)))
    return value


def number(name, default, low=-math.inf):
    value = rospy.get_param("~" + name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value < math.inf:
        raise ParameterError("~%s: expected a number%s, not '%s'" % (name, _at_least(low), value))
    return value


def whole(name, default, low=-math.inf):
    value = number(name, default, low)
    if value != int(value):
        raise ParameterError("~%s: expected a whole number%s, not '%s'" % (name, _at_least(low), value))
    return int(value)


def flag(name, default):
    value = rospy.get_param("~" + name, default)
    if not isinstance(value, bool):
        raise ParameterError("~%s: expected true or false, not '%s'" % (name, value))
    return value


def _at_least(low):
    return "" if low == -math.inf else " of at least %g" % low
