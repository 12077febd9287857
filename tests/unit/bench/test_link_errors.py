"""Every foreign exception of a port or socket becomes one of ours."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from unittest.mock import Mock

import pytest
import serial

from benchtool.bench.transport.ports import SerialPort, TcpSocket
from benchtool.bench.transport.transport import opening_error, port_owners
from benchtool.core.errors import LinkLost, NoDevice, PortBusy, PortDenied

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")


def refusing(error: Exception) -> Callable[..., None]:
    """Return what always raises an error."""

    def refuse(*_: object, **__: object) -> None:
        raise error

    return refuse


@pytest.fixture
def terminal():
    """Give both ends of a terminal and a port on it, not open."""
    import pty

    near, far = pty.openpty()
    port = SerialPort(os.ttyname(far))
    yield near, far, port
    port.close()
    for end in (near, far):
        with suppress(OSError):
            os.close(end)


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (serial.SerialException(errno.EBUSY, "could not open port: busy"), PortBusy),
        (OSError(errno.EBUSY, "Device or resource busy"), PortBusy),
        (
            serial.SerialException(
                errno.EAGAIN, "Could not exclusively lock port /dev/x: [Errno 11] unavailable"
            ),
            PortBusy,
        ),
        (serial.SerialException("Could not exclusively lock port /dev/x: [Errno 35]"), PortBusy),
        (serial.SerialException(errno.EACCES, "could not open port: denied"), PortDenied),
        (PermissionError(errno.EPERM, "Operation not permitted"), PortDenied),
        (serial.SerialException(errno.ENOENT, "could not open port: no such file"), NoDevice),
        (serial.SerialException(errno.ENXIO, "could not open port"), NoDevice),
        (serial.SerialException("Could not configure port: (25, 'Inappropriate ioctl')"), NoDevice),
        (serial.SerialException("Could not configure port: (5, 'Input/output error')"), NoDevice),
        (serial.SerialException("could not open port 'COM9': FileNotFoundError(2, '')"), NoDevice),
    ],
)
def test_what_opening_may_raise(error, kind, monkeypatch):
    monkeypatch.setattr(serial, "Serial", refusing(error))
    with pytest.raises(kind) as caught:
        SerialPort("/dev/example").open()
    assert type(caught.value) is kind
    assert caught.value.__cause__ is error
    assert "/dev/example" in str(caught.value)


@posix
def test_a_second_opening_names_the_holder(terminal):
    first, second = terminal[2], SerialPort(terminal[2].port)
    first.open()
    with pytest.raises(PortBusy) as caught:
        second.open()
    if sys.platform == "linux":
        assert f"(pid {os.getpid()}, this program)" in str(caught.value)
        assert [holder.pid for holder in port_owners(first.port)] == [os.getpid()]
    first.close()
    second.open()
    second.close()


@posix
def test_a_port_that_vanishes_is_a_lost_link(terminal):
    near, far, port = terminal
    port.open()
    os.write(near, b"last words")
    assert port.read(0.1) == b"last words"
    assert port.read(0.0) == b""
    os.close(near)
    os.close(far)
    for said in ("check cable and power", "is closed"):
        for use in (lambda: port.read(0.1), lambda: port.write(b"x")):
            with pytest.raises(LinkLost, match=said):
                use()
        port.close()


@posix
def test_a_port_that_takes_nothing_is_a_lost_link(terminal):
    terminal[2].open()
    with pytest.raises(LinkLost, match="accepted no data"):
        terminal[2].write(b"x" * 1_000_000)


@pytest.mark.parametrize("error", [ConnectionResetError(104, "reset"), BrokenPipeError(32, "pipe")])
def test_tcp_links_that_break(error):
    link = TcpSocket("127.0.0.1", 1)
    link._socket = Mock(recv=refusing(error), send=refusing(error))
    for use in (lambda: link.read(0.0), lambda: link.write(b"x")):
        with pytest.raises(LinkLost, match="broke"):
            use()


def test_access_denied_on_windows_means_busy():
    error = serial.SerialException("could not open port 'COM3': PermissionError(13, 'denied')")
    assert type(opening_error(error, "COM3", windows=True)) is PortBusy
    assert type(opening_error(error, "COM3")) is PortDenied
