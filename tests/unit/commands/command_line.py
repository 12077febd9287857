"""Run the command line in this process."""

from __future__ import annotations

import pytest

from benchtool.commands.app import main


def run(*words: object) -> int:
    """Return the exit code of `benchtool WORDS`."""
    with pytest.raises(SystemExit) as leaving:
        main([str(word) for word in words])
    return int(leaving.value.code or 0)


def said(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Return the exit code of `benchtool WORDS`, and what it printed."""
    code = run(*words)
    return code, *capsys.readouterr()
