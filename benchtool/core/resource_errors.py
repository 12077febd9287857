"""Errors of the system for want of room, memory, descriptors or permission, in its own words."""

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
    """Return whether something is used up or refused, not merely wrong (a folder for a file)."""
    return isinstance(error, MemoryError) or error.errno in _NUMBERS


def resource_error(error: OSError | MemoryError, subject: str, then: str = "") -> ResourceExhausted:
    """Return the error for people.

    Args:
        error: of the system.
        subject: what could not be done ("run cannot be closed").
        then: what to do after its cause is removed.
    """
    if isinstance(error, MemoryError):
        what = os.strerror(errno.ENOMEM)
    else:
        name = f" ({error.filename})" if error.filename else ""
        what = f"{error.strerror or str(error) or type(error).__name__}{name}"
    said = f"{subject}: {what[:1].lower()}{what[1:]}"
    return ResourceExhausted(f"{said}; {then}" if then else said)
