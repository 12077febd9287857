"""Notifications on the page: one sentence for a fault, the same as the command line prints."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from functools import wraps
from inspect import iscoroutinefunction
from typing import Any

from nicegui import Client, ui

from benchtool.core.errors import BenchtoolError
from benchtool.web.bench_process.events import Notice
from benchtool.web.jobs import fault_sentence


def notify(text: str) -> None:
    """Show a short note."""
    ui.notify(text, type="info", position="bottom-left")


def notify_error(error: Exception) -> None:
    """Show why something was refused or failed, until it is closed."""
    known = isinstance(error, BenchtoolError)
    if not known:
        traceback.print_exception(error)
    ui.notify(
        str(error) if known else fault_sentence(error),
        type="negative", position="bottom-left", multi_line=True, timeout=0, close_button="Close",
    )  # fmt: skip


def notify_all_pages(notice: Notice) -> None:
    """Show a notice of the bench process on every page."""
    for client in list(Client.instances.values()):
        if client.has_socket_connection:
            with client:
                if notice.is_error:
                    notify_error(BenchtoolError(notice.text))
                else:
                    notify(notice.text)


def shows_errors(handler: Callable[..., Any]) -> Callable[..., Any]:
    """Make a handler of the page show its errors instead of losing them in a log."""
    if iscoroutinefunction(handler):

        @wraps(handler)
        async def waiting(*args: Any, **kwargs: Any) -> Any:
            page = ui.context.client
            try:
                return await handler(*args, **kwargs)
            except Exception as error:  # noqa: BLE001 -- the boundary where errors are shown
                # On the page, not where the handler began: that card may be gone by now.
                with page:
                    notify_error(error)

        return waiting

    @wraps(handler)
    def at_once(*args: Any, **kwargs: Any) -> Any:
        try:
            return handler(*args, **kwargs)
        except Exception as error:  # noqa: BLE001 -- as above
            notify_error(error)

    return at_once
