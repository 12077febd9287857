"""Code blocks of a Markdown page, and how each is run.

In order, in one empty folder per page:

- ``console`` and ``sh``: lines that begin with ``$ benchtool`` or ``$ python`` are run by bash, as
  somebody who copies them does: what is not quoted means what it means to a shell. Exit code 0
  is expected, another one where the line ends in ``# exit CODE``. A line that ends in ``&`` runs
  on until the page ends. Other programs (make, pip, git) and shown output are passed over.
- ``python``: executed, all blocks of a page in one namespace.
- any block below ``<!-- file: NAME -->`` is written to that file.
- a block below ``<!-- not run: REASON -->`` is passed over.

Each port that a page serves a virtual bench on (``bench serve --link KIND:PORT``) becomes a free
one, wherever the page names it: an earlier run may have left a program on the page's own.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.docs.forked import program_folder

BLOCK = re.compile(
    r"(?:^<!--[ ]*(?P<mark>not[ ]run|file):[ ]*(?P<note>[^\n]*?)[ ]*-->\n\s*)?"
    r"^(?P<indent>[ ]*)```(?P<language>\w+)[^\n]*\n(?P<body>.*?)^(?P=indent)```[ ]*$",
    re.MULTILINE | re.DOTALL,
)
LONGEST_S = 150.0
PROGRAMS = ("benchtool", "python")


@dataclass(frozen=True, slots=True)
class Block:
    """One fenced block: where, in which language, its text, and the comment above it."""

    line: int
    language: str
    body: str
    mark: str | None
    note: str

    @property
    def is_run(self) -> bool:
        """Tell whether this block does anything when the page is run."""
        if self.mark == "not run":
            return False
        return self.mark == "file" or self.language == "python" or bool(list(self.commands()))

    def commands(self) -> list[str]:
        """List the command lines that are run, continuation lines joined, without their ``$``."""
        if self.language not in {"console", "sh"}:
            return []
        lines = self.body.replace("\\\n", " ").splitlines()
        typed = [line.strip()[2:] for line in lines if line.strip().startswith("$ ")]
        return [command for command in typed if command.split()[0] in PROGRAMS]


def blocks_of(text: str) -> list[Block]:
    """Find the fenced blocks of a page."""
    return [
        Block(
            line=text.count("\n", 0, found.start("body")),
            language=found["language"],
            body="".join(
                line.removeprefix(found["indent"]) for line in found["body"].splitlines(True)
            ),
            mark=found["mark"],
            note=found["note"] or "",
        )
        for found in BLOCK.finditer(text)
    ]


def run_page(text: str, name: str, folder: Path) -> list[str]:
    """Run a page's blocks in ``folder``, the current one; give what went wrong, a line each."""
    text = on_free_ports(text)
    namespace: dict[str, Any] = {"__name__": "__main__"}
    failures: list[str] = []
    with ExitStack() as until_the_end:
        for block in blocks_of(text):
            if not block.is_run:
                continue
            if block.mark == "file":
                target = folder / block.note
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(block.body, encoding="utf-8")
            elif block.language == "python":
                source = "\n" * block.line + block.body  # a traceback then names the page's line
                exec(compile(source, name, "exec"), namespace)
            for command in block.commands() if block.mark is None else []:
                problem = run_command(command, folder, until_the_end)
                failures += [f"{name}:{block.line}: $ {command}\n{problem}"] if problem else []
    return failures


def on_free_ports(text: str) -> str:
    """Give a page whose virtual benches are served on ports that nobody uses."""
    for port in set(re.findall(r"bench serve [^\n]*--link [^\s?]*?:(\d{4,5})\b", text)):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            text = re.sub(rf"(?<=[:=]){port}\b", str(probe.getsockname()[1]), text)
    return text


def run_command(command: str, folder: Path, until_the_end: ExitStack) -> str | None:
    """Run one command line; say what is wrong with how it ended, or None."""
    expected = int(found[1]) if (found := re.search(r"# exit (\d+)\s*$", command)) else 0
    if command.rstrip().endswith("&"):
        process = subprocess.Popen(
            ["bash", "-c", f"exec {command.rstrip().removesuffix('&')}"],
            cwd=folder,
            env=environment(),
            stdout=subprocess.PIPE,
            text=True,
        )
        until_the_end.callback(stop, process)
        assert process.stdout is not None
        return None if process.stdout.readline() else "ended without a word"
    ended = run_line(command, folder)
    if ended.returncode == expected:
        return None
    return f"exit code {ended.returncode}, expected {expected}\n{ended.stdout}{ended.stderr}"


def environment(*folders: str) -> dict[str, str]:
    """Return the variables of a command; its programs are first looked for in some folders."""
    programs = (*folders, str(Path(sys.executable).parent), os.environ["PATH"])
    own = {"MPLBACKEND": "Agg", "COLUMNS": "100", "PYTHONIOENCODING": "utf-8"}
    return os.environ | own | {"PATH": os.pathsep.join(programs)}


def run_line(command: str, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run one line in bash to its end; a fork takes the part of `benchtool`."""
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", command],
        cwd=folder,
        env=environment(program_folder()) | variables,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=LONGEST_S,
        check=False,
    )


def stop(process: subprocess.Popen[str]) -> None:
    """End a command that was left running and close its pipe."""
    process.terminate()
    process.wait(timeout=10)
    assert process.stdout is not None
    process.stdout.close()
