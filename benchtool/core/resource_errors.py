"""System errors for lack of disk space, memory, file descriptors or permission."""

from __future__ import annotations

import errno
import os

from benchtool.core.errors import ResourceExhausted

_NUMBERS = frozenset(
    {
        *(errno.ENOSPC, getattr(errno, "EDQUOT", -1), errno.EFBIG, errno.EMFILE, errno.ENFILE),
        *(errno.ENOMEM, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO, errno.EPIPE),
        errno.EBADF,
    }
)


def is_exhaustion(error: OSError | MemoryError) -> bool:
    """Return True for a lack of resources or permission, not for a wrong path."""
    return isinstance(error, MemoryError) or error.errno in _NUMBERS


def resource_error(error: OSError | MemoryError, subject: str, then: str = "") -> ResourceExhausted:
    """Return the error with a message for the user.

    Args:
        error: of the system.
        subject: failed operation ("run cannot be closed").
        then: next step after its cause is removed.
    """
    if isinstance(error, MemoryError):
        what = os.strerror(errno.ENOMEM)
    else:
        name = f" ({error.filename})" if error.filename else ""
        what = f"{error.strerror or str(error) or type(error).__name__}{name}"
    message = f"{subject}: {what[:1].lower()}{what[1:]}"
    return ResourceExhausted(f"{message}; {then}" if then else message)
