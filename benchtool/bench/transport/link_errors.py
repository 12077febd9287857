"""Foreign exceptions of ports and sockets, told apart once and turned into ours."""

from __future__ import annotations

import errno
import re
import socket

from benchtool.bench.transport.port_holders import holders_text
from benchtool.core.errors import LinkError, LinkLost, NoDevice, PortBusy, PortDenied

_BUSY = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK}
_DENIED = {errno.EACCES, errno.EPERM}


def opening_error(error: Exception, where: str, windows: bool = False) -> LinkError:
    """Return what an exception on opening means.

    Args:
        error: an OSError (pyserial's SerialException is one), termios.error or socket error.
        where: port or host as the user gave it.
        windows: on Windows an access denied on a port means that somebody else has it open.
    """
    number = _number(error)
    text = _text(error)
    if number in _BUSY or "exclusively lock" in text or (windows and _denied(number, text)):
        return PortBusy(
            f"{where} is in use by {holders_text(where)}; end that program and try again"
        )
    if _denied(number, text):
        return PortDenied(
            f"{where} may not be opened by this user; `benchtool doctor` says which group or rule "
            f"is missing"
        )
    if isinstance(error, socket.gaierror | UnicodeError):
        return NoDevice(f"the host of {where} is not known; correct its name in the address")
    if isinstance(error, OverflowError):
        return NoDevice(f"{where} is no port; choose one from 1 to 65535")
    if isinstance(error, ConnectionRefusedError) or number == errno.ECONNREFUSED:
        return NoDevice(f"nobody listens at {where}; start the bench there or correct the address")
    if number == errno.ENOTTY or "Inappropriate ioctl" in text:
        return NoDevice(f"{where} is not a serial port; `benchtool ports` lists the serial ports")
    return NoDevice(f"{where} cannot be opened ({text}); `benchtool ports` lists what is there")


def lost_error(error: Exception, where: str) -> LinkLost:
    """Return what an exception on a port that was open means."""
    text = _text(error)
    return LinkLost(
        f"the link to {where} broke ({text}); check cable and power, then open it again"
    )


def _text(error: Exception) -> str:
    """Return an exception's words; of an error within an error only the inner one's.

    pyserial says "[Errno 2] could not open port X: [Errno 2] No such file or directory: 'X'".
    """
    text = " ".join(str(error).split())
    said = re.findall(r"\[Errno \d+\] ([^:\[]+)", text)
    return str(said[-1]).strip() if len(said) > 1 else text


def _number(error: Exception) -> int | None:
    number = getattr(error, "errno", None)
    if isinstance(number, int):
        return number
    # pyserial and termios leave the number in the text: "(25, 'Inappropriate ioctl for device')".
    found = re.search(r"\(?(?:Errno )?(\d+)[,\]]", str(error))
    return int(found[1]) if found else None


def _denied(number: int | None, text: str) -> bool:
    return number in _DENIED or "PermissionError" in text or "Permission denied" in text
