# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the command line tools share: one-line errors and checked arguments."""
import argparse
import math
import sys

from all_in_focus.files.rig import Optics


class Parser(argparse.ArgumentParser):
    """Argument parser whose errors are one line and exit code 2, without the usage text."""

    def error(self, message):
        """message: text, or an exception."""
        if isinstance(message, OSError) and message.filename:
            message = "%s: %s" % (message.filename, message.strerror)
        self.exit(2, "%s: %s\n" % (self.prog, " ".join(str(message).split())))

    def warn(self, message):
        print("%s: warning: %s" % (self.prog, message), file=sys.stderr)


def positive(text):
    """argparse type: a positive number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError("'%s': expected a positive number" % text)
    return value


def count(text):
    """argparse type: a positive whole number."""
    if not text.isdigit() or int(text) == 0:
        raise argparse.ArgumentTypeError("'%s': expected a positive whole number" % text)
    return int(text)


def optics(text):
    """argparse type: f,F,coc (mm, f-number, mm)."""
    try:
        return Optics.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error))
