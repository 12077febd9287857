"""Program `benchtool` for pages: every command is a fork of one process that has all imports.

As a module it starts that process and returns the folder of the program; as a script it is the
process. PNG files of reports are empty: their SVG files show the same figures.
"""

from __future__ import annotations

import atexit
import json
import os
import pkgutil
import select
import signal
import socket
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

PROGRAM = """#!{python} -IS
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    call = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
    socket.send_fds(server, [b"%08d" % len(call)], [0, 1, 2])
    server.sendall(call)
    sys.exit(int(server.recv(4) or b"70"))
"""


@cache
def program_folder() -> str:
    """Start the process, and return the folder of a program `benchtool` that forks it."""
    folder = TemporaryDirectory()
    atexit.register(folder.cleanup)
    address = f"{folder.name}/socket"
    program = Path(folder.name, "benchtool")
    program.write_text(PROGRAM.format(python=sys.executable, address=address))
    program.chmod(0o755)
    process = subprocess.Popen(
        [sys.executable, "-P", __file__, address],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"MPLBACKEND": "Agg"},
    )
    atexit.register(process.communicate)  # the end of its input ends it
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    return folder.name


def serve(address: str) -> None:
    """Import all of benchtool but the page, then fork for every call until the input ends."""
    for module in pkgutil.walk_packages(import_module("benchtool").__path__, "benchtool."):
        if not module.name.startswith(("benchtool.web", "benchtool.__main__")):
            import_module(module.name)
    for name in ("agg", "svg"):
        import_module(f"matplotlib.backends.backend_{name}")
    figure: Any = import_module("benchtool.report.figure")
    draw = figure.figure_bytes
    figure.figure_bytes = lambda shown, kind="svg": b"" if kind == "png" else draw(shown, kind)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(address)
        server.listen()
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)
        print("ready", flush=True)
        while sys.stdin not in select.select([server, sys.stdin], [], [])[0]:
            call, _ = server.accept()
            if os.fork() == 0:
                server.close()
                answer(call)
            call.close()


def answer(call: socket.socket) -> None:
    """Run one command on the streams of the caller, and send its exit code."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    size, streams, _, _ = socket.recv_fds(call, 8, 3)
    arguments, folder, environment = json.loads(call.recv(int(size), socket.MSG_WAITALL))
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    sys.stdin, sys.stdout, sys.stderr = (
        os.fdopen(number, mode, encoding="utf-8") for number, mode in enumerate("rww")
    )
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = ["benchtool", *arguments]
    code: Any = 1
    try:
        import_module("benchtool.commands.app").main()
    except SystemExit as end:
        code = end.code
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        call.sendall(b"%d" % int(code or 0))
        os._exit(0)


if __name__ == "__main__":
    serve(sys.argv[1])
