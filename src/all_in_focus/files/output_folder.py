# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writes whole folders: a folder is complete or absent, and files that the program did not write are never removed.

A run writes into a staging folder of its own beside the output. At the end the two change places in one step of the
file system, and the former output is removed. A mark inside (MARK, a JSON file) names the program, the run and the
files that it wrote: only those are ever removed. Other files in an output folder either stay there or make the program
refuse the folder. A lock beside the output keeps two runs apart; the kernel frees it when a run dies.
"""
import contextlib
import ctypes
import errno
import fcntl
import glob
import json
import os
import shutil
import socket
import time
import uuid
from pathlib import Path

from all_in_focus.files.output_file import named

MARK = ".all_in_focus"
_RENAME_EXCHANGE = 2  # of renameat2()
_AT_FDCWD = -100


class OutputFolder:
    """The output folder `path` of a program.

    working: the staging folder, a Path. Write there, then commit(); discard() in any case, it removes what is left.
    may_keep: called with the name of an entry that the program did not write; whether it may stay beside the new ones.
    results: names of files that the program tells the user to make there; they are removed with the output.
    parents: whether to make the parent folders. Raises OSError with the path and the reason.
    """

    def __init__(self, path, program, may_keep=lambda name: False, results=(), parents=False):
        self.path = Path(os.path.abspath(path))
        self._program, self._may_keep, self._results = program, may_keep, set(results)
        if parents and not self.path.parent.exists():
            self.path.parent.mkdir(parents=True, exist_ok=True)
        self.working = _staging_name(self.path)
        self._is_own = True  # all that is in the staging folder
        self._lock = _Lock(self.path)
        try:
            self._lock.acquire()
            self._check()
            _remove_stale(self.path)
            with named(self.path, self.working):
                self.working.mkdir()
                self._write_mark(None)
        except BaseException:
            self.discard()
            raise

    def commit(self):
        """Puts the staging folder in the place of the output. What it replaces is removed, but for what may stay."""
        self._write_mark(sorted(_files(self.working)))
        kept = self._check(_entries(self.working))
        with named(self.path, self.working):
            if not self.path.exists():
                self.working.rename(self.path)
                return
            shutil.copymode(self.path, self.working)
            self._is_own = False
            _exchange(self.working, self.path)
            for name in kept:  # the staging folder is the former output now
                (self.working / name).rename(self.path / name)
            _remove(self.working)

    def discard(self):
        """Removes the staging folder, if commit() has not, and ends the lock."""
        if self._is_own:
            shutil.rmtree(self.working, ignore_errors=True)  # its mark may be missing or half written
        else:
            _remove(self.working)
        self._lock.release()

    def _check(self, new=frozenset()):
        """Entries of the output that stay. OSError where the folder must not be touched. new: names to be written."""
        path = self.path
        if path.is_symlink():
            raise OSError(errno.ELOOP, "is a symbolic link: give the folder itself", str(path))
        if not path.exists():
            return set()
        if not path.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, "is no folder", str(path))
        mark = read_mark(path)
        if mark and mark["program"] != self._program:
            raise FileExistsError(errno.EEXIST, f"was written by {mark['program']}: choose another folder", str(path))
        own_files = set(mark["files"] or ()) if mark else set()
        own = {name.split("/")[0] for name in own_files}
        others = _entries(path) - own
        for name in sorted(_files(path)):
            top = name.split("/")[0]
            if top in own and (path / name).is_symlink():
                raise OSError(errno.ELOOP, "is a symbolic link: remove it, or choose another folder", str(path / name))
            foreign = name not in own_files and Path(name).name not in self._results
            if foreign and (top in own or top in new or not self._may_keep(top)):
                raise FileExistsError(errno.EEXIST, f"was not written by {self._program}: choose another folder",
                                      str(path / name))
        if path.samefile(Path.cwd()):
            raise OSError(errno.EBUSY, "is the current folder, which cannot be replaced: choose another", str(path))
        return others - self._results

    def _write_mark(self, files):
        """files: those that belong to the run, relative; None as long as it writes: everything in the folder does."""
        mark = {"program": self._program, "run": f"{time.strftime('%Y-%m-%dT%H:%M:%S%z')} {uuid.uuid4().hex}",
                "host": socket.gethostname(), "files": files}
        (self.working / MARK).write_text(json.dumps(mark, indent=2) + "\n", encoding="utf-8")


@contextlib.contextmanager
def whole_folder(path, program, **options):
    """Yields the Path of the staging folder and commits it at the end; options: of OutputFolder. On an error nothing is
    left behind, and what was there stays."""
    folder = OutputFolder(path, program, **options)
    try:
        with named(folder.path, folder.working):
            yield folder.working
            folder.commit()
    finally:
        folder.discard()


def remove_folder(path, program):
    """Removes the output folder `path` of the program, if it is there. Raises OSError like OutputFolder."""
    if os.path.lexists(path):
        folder = OutputFolder(path, program)
        try:
            folder.commit()  # an empty folder
            _remove(folder.path)
        finally:
            folder.discard()


def read_mark(folder):
    """The mark of a folder as a dict with program, run and files; None where there is none that can be read."""
    try:
        mark = json.loads((Path(folder) / MARK).read_text(encoding="utf-8"))
        files = mark["files"]
        good = isinstance(mark["program"], str) and (files is None or all(isinstance(name, str) for name in files))
        return mark if good else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def remove_leftovers(path):
    """Removes the staging folders of runs to the output `path` that were killed, unless a run is at work there."""
    path = Path(os.path.abspath(path))
    with contextlib.suppress(OSError):
        lock = _Lock(path)
        try:
            lock.acquire()
            _remove_stale(path)
        finally:
            lock.release()


class _Lock:
    """A file beside the output `path` that a run locks while it works."""

    def __init__(self, path):
        self._output, self._path, self._file = path, path.with_name(f".{path.name}.lock"), None

    def acquire(self):
        """BlockingIOError where another run holds it."""
        while True:
            with named(self._output, self._path):
                self._open(os.O_CREAT)
            try:
                if self._locks():
                    return
            except FileNotFoundError:
                pass  # its former owner has removed it meanwhile: try again
            except OSError:
                raise BlockingIOError(errno.EWOULDBLOCK, "another run is writing there: wait for it, or choose another "
                                      "folder", str(self._output)) from None
            self._close()

    def release(self):
        """Removes the file, unless another run holds it. A signal may have ended acquire() anywhere."""
        with contextlib.suppress(OSError):
            if self._file is None:
                self._open()
            if self._locks():
                self._path.unlink()
        self._close()

    def _locks(self):
        """Whether the file that is open now is locked, and still the one beside the output."""
        fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.path.samestat(os.fstat(self._file), os.stat(self._path))

    def _open(self, flags=0):
        self._file = os.open(self._path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | flags, 0o666)

    def _close(self):
        if self._file is not None:
            os.close(self._file)
            self._file = None


def _staging_name(path):
    return path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.incomplete")


def _remove_stale(path):
    """Staging folders of killed runs to `path`; call with its lock held."""
    for folder in path.parent.glob(f".{glob.escape(path.name)}.{'[0-9a-f]' * 12}.incomplete"):
        if read_mark(folder):
            _remove(folder)
        if folder.is_dir() and path.is_dir():  # the run was killed before it moved the user's files back
            for entry in folder.iterdir():
                if entry.name != MARK and not os.path.lexists(path / entry.name):
                    entry.rename(path / entry.name)
            _remove(folder)


def _entries(folder):
    """Names in a folder."""
    return {path.name for path in folder.iterdir()} - {MARK}


def _files(folder):
    """Relative paths of all files and empty folders below a folder."""
    found = set()
    for place, folders, files in os.walk(folder):
        empty = [name for name in folders if (Path(place) / name).is_symlink() or not os.listdir(Path(place) / name)]
        found.update((Path(place) / name).relative_to(folder).as_posix() for name in [*files, *empty])
    return found - {MARK}


def _remove(folder):
    """Removes a staging folder or former output: what its mark names, then the folder if nothing else is in it."""
    mark = read_mark(folder)
    if mark is None or folder.is_symlink():
        with contextlib.suppress(OSError):
            folder.rmdir()  # only if it is empty
        return
    files = _files(folder) if mark["files"] is None else set(mark["files"])
    for name in _entries(folder) & {name.split("/")[0] for name in files}:
        place = folder / name
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place, ignore_errors=True)
        elif os.path.lexists(place):
            with contextlib.suppress(OSError):
                place.unlink()
    if not _entries(folder):
        shutil.rmtree(folder, ignore_errors=True)


def _exchange(one, other):
    """Two folders change places, in one step where the file system can do that."""
    libc = ctypes.CDLL(None, use_errno=True)
    if hasattr(libc, "renameat2"):  # glibc 2.28
        if libc.renameat2(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE) == 0:
            return
        code = ctypes.get_errno()
        if code not in (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP):
            raise OSError(code, os.strerror(code), str(other))
    former = _staging_name(other)
    other.rename(former)
    try:
        one.rename(other)
    except OSError:
        former.rename(other)
        raise
    former.rename(one)
