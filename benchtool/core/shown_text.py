"""Control characters of texts as visible escapes, and warnings as lines on standard error."""

from __future__ import annotations

import os
import re
import sys
import warnings

from benchtool.core.errors import DataWarning

# C0, C1 and DEL, and the characters that hide, join or reorder text (Unicode bidi controls).
_CONTROLS = re.compile(
    "[\0-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]"
)
_show_python_warning = warnings.showwarning


def show_controls(text: str) -> str:
    r"""Return a text with control characters as `\x1b` or `\u202e`; line ends and tabs stay."""
    return _CONTROLS.sub(
        lambda found: f"\\x{ord(found[0]):02x}" if found[0] < "\x80" else f"\\u{ord(found[0]):04x}",
        text,
    )


def show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: object = None,
    line: str | None = None,
) -> None:
    """Print a `DataWarning` as one line, and others with BENCHTOOL_DEBUG alone."""
    if issubclass(category, DataWarning):
        sys.stderr.write(f"benchtool: warning: {show_controls(str(message))}\n")
        sys.stderr.flush()
    elif os.environ.get("BENCHTOOL_DEBUG"):
        _show_python_warning(message, category, filename, lineno)
