"""Reading of user-supplied files: regular files of limited size only.

Every path from a command, an address, a file or a run folder is opened here. A FIFO, a device or a
socket would block the program or fill its memory.
"""

from __future__ import annotations

import errno
import os
import stat
import sys
from io import BufferedReader
from pathlib import Path

from benchtool.core.errors import FileFormatError

MAX_TEXT_BYTES = 1 << 20  # of a plan, rig, model or map: hundreds of times the library; assumed
MAX_METADATA_BYTES = 1 << 26  # of a JSON file: ten times a result with all draws; assumed
MAX_DATA_BYTES = 1 << 32  # largest file of data: a day of flight logs; assumed

_PIECE_BYTES = 1 << 20

_KINDS = (
    (stat.S_ISDIR, "this is a folder"),
    (stat.S_ISFIFO, "this is a pipe"),
    (stat.S_ISCHR, "this is a device"),
    (stat.S_ISBLK, "this is a device"),
    (stat.S_ISSOCK, "this is a socket"),
)


def user_folder(variable: str, unix: str, mac: str = "Application Support") -> Path:
    """Return the user's folder for one kind of files.

    LOCALAPPDATA on Windows, ~/Library on macOS; elsewhere by the XDG Base Directory Specification
    0.8.

    Args:
        variable: of that specification, such as XDG_STATE_HOME.
        unix: below the home folder if the variable is not set.
        mac: below ~/Library.
    """
    home = Path.home()
    if sys.platform == "win32":
        root = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        root = home / "Library" / mac
    else:
        root = Path(os.environ.get(variable) or home / unix)
    return root / "benchtool"


def open_file(path: str | Path, *, follow: bool = True) -> BufferedReader:
    """Open a regular file for reading bytes.

    Args:
        path: of the file.
        follow: whether to follow a symbolic link.

    Raises:
        FileFormatError: cannot be opened, or not a regular file.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    if not follow:
        flags |= getattr(os, "O_NOFOLLOW", 0)
    try:
        handle = os.open(path, flags)
    except (OSError, ValueError) as error:
        raise FileFormatError(display_path(path), _reason(error, path)) from error
    mode = os.fstat(handle).st_mode
    if not stat.S_ISREG(mode):
        os.close(handle)
        kind = next((text for is_kind, text in _KINDS if is_kind(mode)), "this is not a file")
        raise FileFormatError(display_path(path), f"{kind}; name a regular file")
    return os.fdopen(handle, "rb")


def read_file(path: str | Path, max_bytes: int = MAX_DATA_BYTES, *, follow: bool = True) -> bytes:
    """Return the bytes of a regular file.

    Raises:
        FileFormatError: cannot be opened or read, not a regular file, or too large.
    """
    with open_file(path, follow=follow) as file:
        size = os.fstat(file.fileno()).st_size
        try:
            # One byte more than the stated size: files that grow, or of /proc, are larger.
            data = file.read(min(size, max_bytes) + 1)
            while len(data) <= max_bytes and (more := file.read(_PIECE_BYTES)):
                data += more
        except OSError as error:
            raise FileFormatError(display_path(path), _reason(error, path)) from error
    if len(data) <= max_bytes:
        return data
    raise FileFormatError(
        display_path(path),
        f"it has {max(size, len(data)):,} bytes, limit {max_bytes:,}; name a smaller file of "
        f"this kind",
    )


def read_text(path: str | Path, max_bytes: int = MAX_TEXT_BYTES, *, follow: bool = True) -> str:
    """Return the text of a regular UTF-8 file, without a byte order mark.

    Raises:
        FileFormatError: as `read_file`, or the bytes are not UTF-8.
    """
    data = read_file(path, max_bytes, follow=follow)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(
            display_path(path),
            f"this is not UTF-8 text (byte {error.start} is 0x{data[error.start]:02x}); save it "
            f"as UTF-8, or name a text file",
        ) from error


def display_path(path: str | Path) -> str:
    """Return a path for a message; shortened beyond 300 characters, invalid characters escaped."""
    text = str(path)
    text = text if len(text) <= 300 else f"{text[:60]}... ({len(text)} characters)"
    return text.encode("utf-8", "backslashreplace").decode().replace("\0", "\\0")


def _reason(error: OSError | ValueError, path: str | Path) -> str:
    if not isinstance(error, OSError):  # NUL or invalid character
        return "this is not a valid file name; use another"
    if error.errno == errno.ELOOP:
        is_link = os.path.islink(path)
        link = "this is a symbolic link, which is not followed here"
        return f"{link if is_link else 'its links are circular'}; name the file itself"
    return f"{(error.strerror or 'it cannot be read').lower()}; check the path"
