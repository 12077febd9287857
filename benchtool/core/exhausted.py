"""What the system refused for want of room, memory, descriptors or permission, in words."""

from __future__ import annotations

import errno

from benchtool.core.errors import ResourceExhausted

_WORDS: dict[int, tuple[str, str]] = {
    errno.ENOSPC: ("the disk is full", "make room on the disk"),
    getattr(errno, "EDQUOT", -1): (
        "your quota on the disk is used up",
        "delete files of yours or have the quota raised",
    ),
    errno.EFBIG: (
        "the file may not grow any further",
        "raise the limit on file sizes (ulimit -f) or choose another disk",
    ),
    errno.EMFILE: (
        "this process may not open any more files",
        "raise the limit on open files (ulimit -n)",
    ),
    errno.ENFILE: ("this computer has too many open files", "close other programs"),
    errno.ENOMEM: ("the memory is used up", "close other programs or raise the limit (ulimit -v)"),
    errno.EROFS: ("the disk is read-only", "mount it for writing or choose another place"),
    errno.EACCES: ("permission is denied", "give yourself the right to read and write there"),
    errno.EPERM: ("permission is denied", "give yourself the right to read and write there"),
    errno.EIO: ("the disk reports a fault", "copy what is on it and look at the disk"),
    errno.EPIPE: ("nobody reads it any more", "write to a file or keep the reader running"),
    errno.EBADF: ("it is closed", "open it, for example with > FILE"),
}


def exhaustion(error: OSError | MemoryError) -> tuple[str, str]:
    """Return what is used up, refused or failed, and what to do."""
    if isinstance(error, MemoryError):
        return _WORDS[errno.ENOMEM]
    reason = (error.strerror or str(error) or type(error).__name__).lower()
    return _WORDS.get(error.errno or 0, (reason, "look at the disk and its permissions"))


def is_exhaustion(error: OSError | MemoryError) -> bool:
    """Return whether something is used up or refused, not merely wrong (a folder for a file)."""
    return isinstance(error, MemoryError) or error.errno in _WORDS


def exhausted(error: OSError | MemoryError, subject: str, then: str = "") -> ResourceExhausted:
    """Return the error for people.

    Args:
        error: of the system.
        subject: what could not be done ("run cannot be closed").
        then: what to do after its cause is mended.
    """
    what, advice = exhaustion(error)
    name = f" ({error.filename})" if isinstance(error, OSError) and error.filename else ""
    return ResourceExhausted("; ".join(filter(None, (f"{subject}: {what}{name}", advice, then))))
