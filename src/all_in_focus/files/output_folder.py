# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writes whole folders: a folder is complete or absent, and files that the program did not write are never removed.

A run writes into a staging folder beside the output. At the end the former output gives way to it, and is removed. A mark
inside (MARK, a JSON file) names the program and the files that it wrote: only those are ever removed. Other files in an
output folder either stay there or make the program refuse the folder. The staging folder is locked as long as its run lives,
which keeps two runs apart and tells what a killed one has left.
"""
import contextlib
import errno
import fcntl
import json
import os
import shutil
from pathlib import Path

from all_in_focus.files.output_file import named

MARK = ".all_in_focus"


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
        self.working, self._lock = self.path.with_name(f".{self.path.name}.incomplete"), None
        self._former = self.path.with_name(f".{self.path.name}.former")  # the output, before the new one takes its place
        try:
            with named(self.path, self.working):
                with contextlib.suppress(FileExistsError):
                    self.working.mkdir()
                self._take()
                self._recover()
                self._check()
                self._write_mark(None)
        except BaseException:
            self.discard()
            raise

    def _take(self):
        """Locks the staging folder and empties it. BlockingIOError where another run has it."""
        self._lock = os.open(self.working, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        if not _locks(self._lock, self.working):
            raise BlockingIOError(errno.EWOULDBLOCK, "another run is writing there: wait for it, or choose another folder",
                                  str(self.path))
        if not _is_of_a_run(self.working):
            raise FileExistsError(errno.EEXIST, "was not written by a run: remove it", str(self.working))
        _remove_entries(self.working, os.listdir(self.working))

    def commit(self):
        """Puts the staging folder in the place of the output. What it replaces is removed, but for what may stay."""
        self._write_mark(sorted(_files(self.working)))
        self._check(_entries(self.working))
        with named(self.path, self.working):
            if self.path.exists():
                shutil.copymode(self.path, self.working)
                if not (self.path / MARK).exists():
                    self._write_mark([], self.path)  # all in it is the user's
                self.path.rename(self._former)
            self.working.rename(self.path)
        self._recover()

    def discard(self):
        """Removes the staging folder, if commit() has not, and ends the lock. A signal may have ended __init__ anywhere."""
        with contextlib.suppress(OSError):
            if self._lock is None:
                self._lock = os.open(self.working, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
            if _locks(self._lock, self.working) and _is_of_a_run(self.working):
                shutil.rmtree(self.working, ignore_errors=True)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _recover(self):
        """Ends what commit() began: files of the user go from the former output to the new one, the rest is removed. Where
        there is no new one, the former one comes back."""
        if not read_mark(self._former):
            return
        if not self.path.exists():
            self._former.rename(self.path)
            return
        _remove(self._former)
        for entry in self._former.iterdir() if self._former.is_dir() else ():
            if entry.name != MARK and not os.path.lexists(self.path / entry.name):
                entry.rename(self.path / entry.name)
        _remove(self._former)

    def _check(self, new=frozenset()):
        """OSError where the output must not be touched. new: names to be written."""
        path = self.path
        if path.is_symlink():
            raise OSError(errno.ELOOP, "is a symbolic link: give the folder itself", str(path))
        if not path.exists():
            return
        if not path.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, "is no folder", str(path))
        if not os.access(path, os.W_OK):
            raise PermissionError(errno.EACCES, "is write-protected", str(path))
        mark = read_mark(path)
        if mark and mark["program"] != self._program:
            raise FileExistsError(errno.EEXIST, f"was written by {mark['program']}: choose another folder", str(path))
        own_files = set(mark["files"] or ()) if mark else set()
        own = {name.split("/")[0] for name in own_files}
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

    def _write_mark(self, files, folder=None):
        """files: those that belong to the run, relative; None as long as it writes: everything in the folder does."""
        mark = {"program": self._program, "files": files, "results": sorted(self._results)}
        ((folder or self.working) / MARK).write_text(json.dumps(mark, indent=2) + "\n", encoding="utf-8")


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


def read_mark(folder):
    """The mark of a folder as a dict with program, files and results; None where there is none that can be read."""
    try:
        mark = json.loads((Path(folder) / MARK).read_text(encoding="utf-8"))
        files = mark["files"]
        good = isinstance(mark["program"], str) and (files is None or all(isinstance(name, str) for name in files))
        return mark if good else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _locks(file, path):
    """Whether the open folder is locked by us now, and still the one of that path."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.path.samestat(os.fstat(file), os.stat(path))
    except OSError:
        return False


def _is_of_a_run(staging):
    return (staging / MARK).exists() or not os.listdir(staging)


def _entries(folder):
    return {path.name for path in folder.iterdir()} - {MARK}


def _files(folder):
    """Relative paths of all files and empty folders below a folder."""
    found = set()
    for place, folders, files in os.walk(folder):
        empty = [name for name in folders if (Path(place) / name).is_symlink() or not os.listdir(Path(place) / name)]
        found.update((Path(place) / name).relative_to(folder).as_posix() for name in [*files, *empty])
    return found - {MARK}


def _remove(folder):
    """Removes an output: what its mark names, then the folder if nothing else is in it."""
    mark = read_mark(folder)
    if mark is None or folder.is_symlink():
        with contextlib.suppress(OSError):
            folder.rmdir()  # only if it is empty
        return
    files = _files(folder) if mark["files"] is None else set(mark["files"])
    _remove_entries(folder, _entries(folder) & {name.split("/")[0] for name in [*files, *mark.get("results", ())]})
    if not _entries(folder):
        shutil.rmtree(folder, ignore_errors=True)


def _remove_entries(folder, names):
    for place in map(folder.joinpath, names):
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place, ignore_errors=True)
        else:
            with contextlib.suppress(OSError):
                place.unlink()
