"""Reading of user-supplied files (regular files of limited size only), and of library files.

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

from benchtool.core.errors import FileFormatError, ResourceExhausted, UnknownChoice

MAX_TEXT_BYTES = 1 << 20  # of a plan, rig, model or map: hundreds of times the library; assumed
MAX_METADATA_BYTES = 1 << 26  # of a JSON file: ten times a result with all draws; assumed
MAX_DATA_BYTES = 1 << 32  # largest file of data: a day of flight logs; assumed
MAX_COLUMNS = 4096  # of any table; the widest logs have some hundred; assumed
MAX_CELLS = 6_000_000  # of a table read as text: about 0.6 GB; assumed
MAX_TABLE_BYTES = 1 << 28  # largest file of such a table
MAX_LOG_BYTES = 1 << 30  # largest imported file: hours of an autopilot's log; assumed
MAX_DECODED_BYTES = 1 << 31  # of one recording: 10^7 rows of 25 channels; assumed
MAX_NUMBER = 1e20  # largest magnitude in any unit: its products stay finite; assumed

LIBRARY = Path(__file__).resolve().parents[1] / "library"  # folder of the bundled files

_PIECE_BYTES = 1 << 20

_EXHAUSTION = frozenset(
    {
        *(errno.ENOSPC, getattr(errno, "EDQUOT", -1), errno.EFBIG, errno.EMFILE, errno.ENFILE),
        *(errno.ENOMEM, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO, errno.EPIPE),
        errno.EBADF,
    }
)

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
    """Open a regular file for reading bytes; `follow` is whether to follow a symbolic link.

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


def user_library_folder() -> Path:
    """Return the folder of user-defined rigs, propellers and so on, with a subfolder per kind.

    BENCHTOOL_LIBRARY if set, else below the user's data folder. It need not exist.
    """
    if folder := os.environ.get("BENCHTOOL_LIBRARY"):
        return Path(folder)
    return user_folder("XDG_DATA_HOME", ".local/share") / "library"


def user_names(folder: str) -> tuple[str, ...]:
    """Return the names of user-defined files of one kind."""
    return tuple(sorted(path.stem for path in (user_library_folder() / folder).glob("*.toml")))


def list_names(folder: str) -> tuple[str, ...]:
    """Return the names in `benchtool/library/<folder>`."""
    return tuple(sorted(path.stem for path in (LIBRARY / folder).glob("*.toml")))


def read_library_file(kind: str, folder: str, name_or_path: str | Path) -> tuple[str, str]:
    """Return (text, where) for a library name, a user-defined name, or a path ending in .toml.

    Raises:
        UnknownChoice: unknown name.
        FileFormatError: unreadable path, or a user-defined file with the name of a bundled one.
    """
    name, user_defined = str(name_or_path), user_names(folder)
    if name in user_defined:
        user_path = user_library_folder() / folder / f"{name}.toml"
        if name in list_names(folder):
            raise FileFormatError(
                str(user_path), f"benchtool has a {kind} of this name; rename your file"
            )
        return read_text(user_path), str(user_path)
    if name in list_names(folder):
        where = f"{folder}/{name}.toml"
        return (LIBRARY / where).read_text(encoding="utf-8"), where
    path = Path(name)
    if path.suffix != ".toml" and not os.path.exists(path):
        raise UnknownChoice(
            f"{kind} or file",
            display_path(name),
            (*list_names(folder), *user_defined),
        )
    if os.path.isdir(path):
        inside = ", ".join(str(item) for item in sorted(path.glob("*.toml"))[:6])
        raise FileFormatError(
            name, f"this is a folder; name a TOML file{f' in it: {inside}' if inside else ''}"
        )
    return read_text(path), name


def check_columns(count: int, where: str) -> None:
    """Raise FileFormatError for a table with too many columns."""
    if count > MAX_COLUMNS:
        raise FileFormatError(
            where, f"it has {count:,} columns, limit {MAX_COLUMNS:,}; keep those that you need"
        )


def check_cells(count: int, where: str) -> None:
    """Raise FileFormatError for a table with too many cells for memory."""
    if count > MAX_CELLS:
        raise FileFormatError(
            where,
            f"it has {count:,} cells, limit {MAX_CELLS:,}; keep the rows and columns that you need",
        )


def check_decoded(rows: int, columns: int, where: str) -> None:
    """Raise FileFormatError for a table of float64 that is too large for memory."""
    decoded = 8 * rows * columns
    if decoded > MAX_DECODED_BYTES:
        raise FileFormatError(
            where,
            f"its {rows:,} rows of {columns} columns take {decoded / 1e9:.1f} GB when they are "
            f"read, limit {MAX_DECODED_BYTES / 1e9:.1f} GB; write fewer rows or columns",
        )


def is_exhaustion(error: OSError | MemoryError) -> bool:
    """Return True for a lack of resources or permission, not for a wrong path."""
    return isinstance(error, MemoryError) or error.errno in _EXHAUSTION


def resource_error(error: OSError | MemoryError, subject: str, then: str = "") -> ResourceExhausted:
    """Return the error with a message for the user.

    Args:
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
