"""Browser, server and bench of the browser tests."""

from tests.browser.conftest import browser, device, open_page, page, web

__all__ = ["browser", "device", "open_page", "page", "web"]
