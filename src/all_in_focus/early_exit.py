# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every program imports this first: until command_line.run() takes over, Ctrl-C ends it at once and without a word.

Without it Python raises KeyboardInterrupt inside one of the imports, which prints a traceback, or is lost where the
imported module catches all errors.
"""
import signal

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not so where the parent ignores SIGINT
    signal.signal(signal.SIGINT, signal.SIG_DFL)
