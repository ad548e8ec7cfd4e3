# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Words for people: exceptions as one line, numbers of things."""


def one_line(error, path=None):
    """An exception as one line, a KeyError with its type: a key says little. OSErrors name their file, or `path`."""
    if isinstance(error, OSError) and error.strerror and (error.filename or path):
        return f"{error.filename or path}: {error.strerror}"
    kind, text = type(error).__name__, " ".join(str(error).split())
    return f"{kind}: {text}" if text and isinstance(error, LookupError) else text or kind


def counted(number, noun):
    """1 frame, 2 frames."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
