"""Say things on the page: one sentence for a fault, the same as the command line prints."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from inspect import iscoroutinefunction
from typing import Any

from nicegui import Client, ui

from benchtool.errors import BenchtoolError
from benchtool.web.desk.news import Said


def say(text: str) -> None:
    """Show a short note."""
    ui.notify(text, type="info", position="bottom-left")


def say_error(error: Exception) -> None:
    """Show why something was refused or failed, until it is closed."""
    text = str(error)
    if not isinstance(error, BenchtoolError):
        said = " ".join(text.split())
        text = f"a fault in benchtool itself, {type(error).__name__}: {said}; please report it"
    ui.notify(
        text, type="negative", position="bottom-left", multi_line=True, timeout=0,
        close_button="Close",
    )  # fmt: skip


def say_everywhere(said: Said) -> None:
    """Show on every page what the bench process says."""
    for client in list(Client.instances.values()):
        if client.has_socket_connection:
            with client:
                if said.is_error:
                    say_error(BenchtoolError(said.text))
                else:
                    say(said.text)


def tells_errors(handler: Callable[..., Any]) -> Callable[..., Any]:
    """Make a handler of the page tell its errors instead of losing them in a log."""
    if iscoroutinefunction(handler):

        @wraps(handler)
        async def waiting(*args: Any, **kwargs: Any) -> Any:
            page = ui.context.client
            try:
                return await handler(*args, **kwargs)
            except Exception as error:  # noqa: BLE001 -- the boundary where errors are told
                # On the page, not where the handler began: that card may be gone by now.
                with page:
                    say_error(error)

        return waiting

    @wraps(handler)
    def at_once(*args: Any, **kwargs: Any) -> Any:
        try:
            return handler(*args, **kwargs)
        except Exception as error:  # noqa: BLE001 -- as above
            say_error(error)

    return at_once
