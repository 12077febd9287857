"""Command line in this process."""

from __future__ import annotations

import pytest

from benchtool.commands.app import main


def run(*arguments: object) -> int:
    """Return the exit code of `benchtool ARGUMENTS`."""
    with pytest.raises(SystemExit) as leaving:
        main([str(word) for word in arguments])
    return int(leaving.value.code or 0)


def said(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Return exit code, standard output and standard error of `benchtool ARGUMENTS`."""
    code = run(*arguments)
    return code, *capsys.readouterr()
