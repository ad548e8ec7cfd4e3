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


EXPECTED = {bool: "true or false", int: "a whole number", float: "a number"}


def read(table):
    """The values of a table of Parameters by name, as attributes."""
    return SimpleNamespace(**{name: _checked(name, rospy.get_param("~" + name, one.default), one) for name, one in table.items()})


def _checked(name, value, one):
    kind = type(one.default)
    if kind is list:
        if not isinstance(value, list):
            raise ValueError(f"~{name}: expected a list, not '{value}'")
        return value
    if kind is str:
        return _text(name, value, one)
    value = _meaning(name, value)
    if kind is bool:
        fits = isinstance(value, bool)
    else:
        fits = type(value) in (int, float) and math.isfinite(value) and (kind is float or value == int(value))
    if not fits or one.limit is not None and value < one.limit:
        at_least = "" if one.limit is None else f" of at least {one.limit:g}"
        raise ValueError(f"~{name}: expected {EXPECTED[kind]}{at_least}, not '{value}'")
    return int(value) if kind is int else value


def _text(name, value, one):
    """A number counts as text: a name may consist of digits."""
    if type(value) not in (str, int, float):
        raise ValueError(f"~{name}: expected text, not {value}: write it in quotes")
    if one.limit and value != one.default and str(value) not in one.limit:
        raise ValueError(f"~{name}: '{value}' is not one of {', '.join(one.limit)}")
    return str(value)


def _meaning(name, value):
    """Text that is nothing but a number, or true or false, counts as that, and that is said."""
    if not isinstance(value, str):
        return value
    try:
        meant = value.lower() == "true" if value.lower() in ("true", "false") else float(value)
    except ValueError:
        return value
    shown = str(meant).lower() if isinstance(meant, bool) else f"{meant:g}"
    rospy.logwarn("%s is text: '%s' is taken as %s; write it without quotes", name, value, shown)
    return meant
