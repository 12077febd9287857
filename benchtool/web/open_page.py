"""Open the page in a browser without showing its token to other users of the machine."""

from __future__ import annotations

import os
import webbrowser
from collections.abc import Callable
from html import escape
from pathlib import Path

from benchtool.store.state import state_folder


def open_page(
    address: str,
    folder: Path | None = None,
    open_address: Callable[[str], object] = webbrowser.open,
) -> Path | None:
    """Open an address in the browser of this user.

    A command line can be read by every user of the machine. So an address with a token is not put
    on the browser's; it stands in a file that only this user can read and that leads on to it.

    Args:
        address: of the page, with its token where it wants one.
        folder: for that file; that of this user's state when None.
        open_address: opens it.

    Returns:
        The file, to be deleted when the token is worth nothing any more; None where there is none.
    """
    if "token=" not in address:
        open_address(address)
        return None
    folder = folder or state_folder()
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"open-{os.getpid()}.html"
    file.unlink(missing_ok=True)
    with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as text:
        text.write(
            '<!doctype html><meta name="referrer" content="no-referrer">'
            f'<meta http-equiv="refresh" content="0; url={escape(address)}">'
        )
    open_address(file.as_uri())
    return file
