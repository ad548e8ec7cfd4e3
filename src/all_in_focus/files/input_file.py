# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What every reader of files checks first."""
import errno
import stat
from pathlib import Path


def require_regular(path):
    """OSError for a path that is there and is neither a file nor a folder: reading a FIFO or a device waits for ever."""
    mode = Path(path).stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "is no regular file: copy what it gives into a file", str(path))
