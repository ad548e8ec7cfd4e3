# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the programs share: checked arguments, errors of one line, exit codes, and how signals end them."""
import argparse
import math
import os
import signal
import sys
import threading
import time
from pathlib import Path

from all_in_focus.files.errors import one_line
from all_in_focus.files.rig import Optics
from all_in_focus.files.separate import require_separate

BAD_INPUT = 2  # exit code
LONGEST_END = 20.0  # s that a node may take to end after a signal


class Input(str):
    """argparse type: a file or folder that the program reads."""


class Output(str):
    """argparse type: a file or folder that the program writes."""


class Parser(argparse.ArgumentParser):
    """Argument parser whose errors are one line and exit code 2, without the usage text.

    Before anything is read it refuses an argument of type Output that would harm one of type Input, or another output.
    With --live it drops arguments that are for ROS, such as topic:=other.
    """

    def parse_args(self, argv=None):
        """argv: without the name of the program."""
        argv = sys.argv[1:] if argv is None else argv
        if "--live" in argv:
            import rospy  # files need no ROS
            argv = rospy.myargv(argv)
        parsed = super().parse_args(argv)
        values = [one for value in vars(parsed).values() for one in (value if isinstance(value, list) else [value])]
        try:
            require_separate(*([value for value in values if isinstance(value, kind)] for kind in (Input, Output)))
        except OSError as error:
            self.error(error)
        return parsed

    def error(self, message):
        """message: text, or an exception."""
        self.exit(BAD_INPUT, f"{self.prog}: {one_line(message)}\n")

    def warn(self, message):
        print(f"{self.prog}: warning: {message}", file=sys.stderr)


came = []  # signals


def end_in_any_case():
    """A signal's exception is lost where Python ignores exceptions, as in a destructor, or leaves a lock of rospy held for which
    its shutdown waits. Ends the process then, in a thread of its own."""
    def end():
        while not came:
            time.sleep(0.5)
        time.sleep(LONGEST_END)
        os._exit(128 + came[0])
    threading.Thread(target=end, daemon=True).start()


def run(main, *errors):
    """Runs a program and exits: the last line of every script.

    main: returns the exit code; None means 0. If it raises ValueError, OSError or one of `errors`, one line on stderr
    says why, and the exit code is 2. SIGINT, SIGTERM and SIGHUP end it as exceptions do, so that it cleans up; exit
    code 128 + signal.
    """
    def end(number, _):
        came.append(number)
        raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)

    if not hasattr(threading.Thread, "isAlive"):  # rospy 1.15.9 calls it; Python 3.9 does not have it any more
        threading.Thread.isAlive = threading.Thread.is_alive
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    for number in before:
        if before[number] != signal.SIG_IGN:
            signal.signal(number, end)
    try:
        code = main()
        sys.stdout.flush()
    except BaseException as error:
        # After a signal any error is its work: numpy 1.24 turns one that comes during a comparison into another error.
        code = 128 + came[0] if came else _exit_code(error, errors)
        if code is None:
            raise
    finally:
        for number in before:
            signal.signal(number, before[number])
    sys.exit(code)


def _exit_code(error, errors):
    """Of a program that ends by this exception, of which it tells the user; None: a mistake of ours, or it has a code."""
    if isinstance(error, BrokenPipeError):  # the reader of the output, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 128 + signal.SIGPIPE
    if not isinstance(error, (ValueError, OSError, MemoryError, *errors)):
        return None
    reason = one_line(error)
    if isinstance(error, ConnectionRefusedError) and "rospy" in sys.modules:  # given private parameters, it waits for no master
        reason = (f"the ROS master at {os.environ.get('ROS_MASTER_URI')} does not answer: start roscore, or compare "
                  "ROS_MASTER_URI")
    print(f"{Path(sys.argv[0]).name}: {reason}", file=sys.stderr)
    return BAD_INPUT


def node(name, description, body, table=None):
    """The main of a ROS node, for run(). body: works until shutdown; returns the exit code, None means 0; table: of its private
    parameters, whose values body gets, see parameters.read().

    If it raises ValueError or OSError, one line in the log says why, and the exit code is 2.
    """
    def main():
        import rospy  # most programs need no ROS

        from all_in_focus import parameters
        Parser(prog=name, description=description, formatter_class=argparse.RawDescriptionHelpFormatter,
               epilog=_listed(name, table) if table else "").parse_args(rospy.myargv()[1:])
        # Signals are left to run(): their exceptions free what the main thread holds. rospy would shut down in the middle
        # of its work, and wait for ever for the lock of a connection to which it is just writing.
        end_in_any_case()
        rospy.init_node(name, disable_signals=True)
        try:
            return body(parameters.read(table)) if table else body()
        except (rospy.ROSException, KeyboardInterrupt, SystemExit):  # shutdown
            return 0
        except (ValueError, OSError) as error:
            rospy.logfatal("%s", error)
            return BAD_INPUT
    return main


def _listed(name, table):
    """The end of a node's --help."""
    width = 4 + max(map(len, table))
    lines = [f"  {'~' + parameter:{width}}{one.meaning}" + (f"; default {str(one.default).lower()}" if one.default != "" else "")
             for parameter, one in table.items()]
    return "\n".join([f"parameters (rosrun all_in_focus {name} _NAME:=VALUE):", *lines])


def number_type(accepts, expected, kind=float):
    """argparse type: a number that accepts() lets pass; expected: says which those are."""
    def parse(text):
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not accepts(value):
            raise argparse.ArgumentTypeError(f"'{text}': expected {expected}")
        return value
    return parse


def digits(text):
    """kind of number_type(): digits alone."""
    return int(text) if text.isdecimal() else math.nan


positive = number_type(lambda value: 0 < value < math.inf, "a positive number")
count = number_type(lambda value: value > 0, "a positive whole number", digits)


def optics(text):
    """argparse type: f,F,coc (mm, f-number, mm)."""
    try:
        return Optics.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error))
