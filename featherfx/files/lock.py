"""One process at a time."""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path

from filelock import FileLock


class Lock:
    """A lock file that this process holds until release; the system drops it with the process.

    Raises TimeoutError at once where another holds it, OSError where it cannot be made or
    something else has its name.
    """

    def __init__(self, path: Path) -> None:
        if path.is_symlink() or (path.exists() and not (path.is_file() and _is_empty(path))):
            raise FileExistsError(errno.EEXIST, "is no lock of this program", str(path))
        self._path = path
        self._lock = FileLock(path, timeout=0, thread_local=False)
        self._lock.acquire()

    def release(self) -> None:
        """Remove the file and let go; nothing where that is done already."""
        if not self._lock.is_locked:
            return
        # While it is held, so that nobody locks a file without a name. Windows cannot remove an
        # open file, but nobody waits for this lock.
        if os.name != "nt":
            self._path.unlink(missing_ok=True)
        self._lock.release()
        if os.name == "nt":
            with contextlib.suppress(OSError):
                self._path.unlink()


def _is_empty(path: Path) -> bool:
    try:
        return path.stat().st_size == 0
    except FileNotFoundError:  # its holder has let go
        return True
