"""Control characters of texts as visible escapes, and warnings as lines on standard error."""

from __future__ import annotations

import re
import sys
from typing import Any

from benchtool.core.errors import DataWarning

# C0, C1 and DEL, and the characters that hide, join or reorder text (Unicode bidi controls).
_CONTROLS = re.compile(
    "[\0-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]"
)


def show_controls(text: str) -> str:
    r"""Return a text with control characters as `\x1b` or `\u202e`; line ends and tabs stay."""
    return _CONTROLS.sub(
        lambda found: f"\\x{ord(found[0]):02x}" if found[0] < "\x80" else f"\\u{ord(found[0]):04x}",
        text,
    )


def show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """Print a `DataWarning` as one line; warnings of Python itself are not shown."""
    if issubclass(category, DataWarning):
        sys.stderr.write(f"benchtool: warning: {show_controls(str(message))}\n")
        sys.stderr.flush()
