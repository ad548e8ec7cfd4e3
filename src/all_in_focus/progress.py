# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Progress bars of the programs."""
from contextlib import suppress

from tqdm import tqdm


class Progress(tqdm):
    """A bar that shows on terminals only and keeps silent when a signal ends the program."""

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, disable=None, **options)

    def __del__(self):
        with suppress(AttributeError):  # a signal has left __init__() before close() finds all that it needs
            self.close()
