"""A report page on paper: PDF by WeasyPrint, which lives here alone and is loaded when asked."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from benchtool.errors import MissingLibrary
from benchtool.report.files import refuse_existing, write_whole


def pdf_bytes(page: str) -> bytes:
    """Return a report page, given as HTML text, as the contents of a PDF file.

    Nothing is read from a disk or a network: what the page names outside itself stays blank.

    Raises:
        MissingLibrary: Pango, which WeasyPrint sets text with, is not on this system.
    """
    weasyprint = _weasyprint()
    fetcher = weasyprint.urls.URLFetcher(allowed_protocols=("data",))
    # matplotlib's styles of SVG are no CSS properties of a page; WeasyPrint says so of each.
    log = logging.getLogger("weasyprint")
    before, log.disabled = log.disabled, True
    try:
        content: bytes = weasyprint.HTML(string=page, url_fetcher=fetcher).write_pdf()
    finally:
        log.disabled = before
    return content


def write_pdf(path: Path, page: str, *, replace: bool = False) -> Path:
    """Write the page as PDF and return its path; refuse to overwrite unless asked."""
    if not replace:
        refuse_existing([path])
    write_whole(path, pdf_bytes(page))
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
