# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keeps outputs apart from inputs: no program replaces what it reads."""
import contextlib
import errno
import os
from pathlib import Path

from all_in_focus.files.output_folder import read_mark
from all_in_focus.files.output_file import is_result

READ_FROM_FOLDERS = (".yaml", ".yml", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".ppm", ".pgm", ".pnm", ".jp2",
                     ".webp")


def require_separate(inputs, outputs):
    """FileExistsError where an output is one of the inputs, or the same as another output: what has one device and inode.

    Of a folder that is read, pictures and YAML files are inputs; earlier results of this package in it are not.
    """
    for place, output in enumerate(outputs):
        if any(_same(output, path) or _is_read_from(path, output) or _would_go_with(output, path) for path in inputs):
            raise FileExistsError(errno.EEXIST, "is an input of this run, which would be replaced: choose another name",
                                  str(output))
        if any(_same(output, other) or _have_one_name(output, other) for other in outputs[:place]):
            raise FileExistsError(errno.EEXIST, "two outputs are to go there", str(output))


def _same(one, other):
    """Whether two names are of one file or folder that is there."""
    with contextlib.suppress(OSError):
        return Path(one).samefile(other)
    return False


def _have_one_name(one, other):
    """Of files that may not be there yet: in one folder, whatever the folder is called."""
    one, other = Path(os.path.realpath(one)), Path(os.path.realpath(other))
    return one.name == other.name and _same(one.parent, other.parent)


def _is_read_from(folder, path):
    """Whether the folder is read and the file `path`, which is there, is a part of what is read."""
    path, folder = Path(os.path.realpath(path)), Path(os.path.realpath(folder))
    if not path.is_file() or not folder.is_dir() or path.suffix.lower() not in READ_FROM_FOLDERS or is_result(path):
        return False
    return any(_same(above, folder) for above in path.parents) or any(_same(entry, path) for entry in folder.iterdir())


def _would_go_with(folder, path):
    """Whether the input `path` was written by an earlier run to the output folder, and goes with what that run wrote."""
    mark = read_mark(folder)
    path, folder = Path(os.path.realpath(path)), Path(os.path.realpath(folder))
    return bool(mark) and any(file in (path, *path.parents) or path in file.parents
                              for file in (folder / name for name in mark["files"] or ()))
