"""A report page on paper: PDF by WeasyPrint, which lives here alone and is loaded when asked."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchtool.errors import MissingLibrary
from benchtool.report.files import refuse_existing, write_whole

Tell = Callable[[str], None]
"""tell(what is being done)."""


def pdf_bytes(page: str, tell: Tell | None = None) -> bytes:
    """Return a report page as the contents of a PDF file.

    Nothing is read from a disk or a network: what the page names outside itself stays blank.

    Args:
        page: HTML text.
        tell: told what is being done, a few words at a time; a long page takes half a minute.

    Raises:
        MissingLibrary: Pango, which WeasyPrint sets text with, is not on this system.
    """
    weasyprint = _weasyprint()
    fetcher = weasyprint.urls.URLFetcher(allowed_protocols=("data",))
    # matplotlib's styles of SVG are no CSS properties of a page; WeasyPrint says so of each.
    log = logging.getLogger("weasyprint")
    before, log.disabled = log.disabled, True
    try:
        with _told(tell):
            content: bytes = weasyprint.HTML(string=page, url_fetcher=fetcher).write_pdf()
    finally:
        log.disabled = before
    return content


class _PassedOn(logging.Handler):
    def __init__(self, tell: Tell) -> None:
        super().__init__()
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        step = re.sub(r"^Step \d+ - ", "", record.getMessage())
        self._tell(step.replace(" - ", ", ").lower())


@contextmanager
def _told(tell: Tell | None) -> Iterator[None]:
    """Pass on what WeasyPrint says of its progress: "Step 5 - Creating layout - Page 3"."""
    log = logging.getLogger("weasyprint.progress")
    if tell is None:
        yield
        return

    handler, before = _PassedOn(tell), (log.level, log.propagate)
    log.addHandler(handler)
    log.propagate = False
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.level, log.propagate = before


def write_pdf(path: Path, page: str, *, replace: bool = False, tell: Tell | None = None) -> Path:
    """Write the page as PDF and return its path; refuse to overwrite unless asked."""
    if not replace:
        refuse_existing([path])
    write_whole(path, pdf_bytes(page, tell))
    return path


def _weasyprint() -> Any:
    try:
        import weasyprint
    except OSError as error:  # a shared library that it loads is not there
        raise MissingLibrary(
            "the system library Pango",
            "a PDF",
            install="install the packages libpango-1.0-0 and libpangoft2-1.0-0 with apt, or print "
            "the HTML page from a browser",
        ) from error
    except ImportError as error:
        raise MissingLibrary("weasyprint", "a PDF", install="pip install weasyprint") from error
    return weasyprint
