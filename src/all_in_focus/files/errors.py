# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Words for people: exceptions as one line, numbers of things."""


def one_line(error, path=None):
    """The message of an exception as one line. OSErrors name their file; `path` where they do not know it."""
    if isinstance(error, OSError) and error.strerror and (error.filename or path):
        return f"{error.filename or path}: {error.strerror}"
    return " ".join(str(error).split()) or type(error).__name__


def one_line_with_type(error):
    """As one_line(), after the type of an exception whose message alone may explain nothing, such as a KeyError's."""
    if isinstance(error, (OSError, ValueError)) or type(error) is RuntimeError or not str(error):
        return one_line(error)
    return f"{type(error).__name__}: {one_line(error)}"


def counted(number, noun):
    """1 frame, 2 frames."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
