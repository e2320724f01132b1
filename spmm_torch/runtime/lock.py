"""A lock of a file among processes, also where the file system knows none."""

from __future__ import annotations

import errno
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock

# What file systems say that have no flock: some NFS, Lustre and FUSE mounts.
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL)


@contextmanager
def locked(
    path: Path, *, wait: bool = True, say: Callable[[str], object] = warnings.warn
) -> Iterator[None]:
    """Holds the lock `path` within the block under `with`, or goes on without one.

    Args:
        path: file of the lock; it is made, and stays.
        wait: whether to wait while another process holds it.
        say: told in one line where the file system has no locks.

    Raises:
        filelock.Timeout: another process holds the lock, and `wait` is False.
        OSError: the file cannot be made.
    """
    lock = FileLock(path, blocking=wait, fallback_to_soft=False)
    try:
        lock.acquire()
    except (OSError, NotImplementedError) as error:
        if isinstance(error, OSError) and error.errno not in NO_LOCKS:
            raise
        say(
            f"{path.parent} lies on a file system without locks ({error}); going on "
            f"without: start no second process on the same files."
        )
        yield
        return
    try:
        yield
    finally:
        lock.release()
