"""The project's files, as the architecture tests read them."""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
OUR_FOLDERS = ("benchtool", "tests", "docs", "fits", "datasets", ".ci")


@cache
def project_files() -> tuple[Path, ...]:
    """List the files under version control, or, outside a clone, those in our folders."""
    listing = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listing.returncode == 0:
        found = [ROOT / name for name in listing.stdout.split("\0") if name]
    else:
        found = [p for p in ROOT.glob("*") if p.is_file()]
        found += [p for folder in OUR_FOLDERS for p in (ROOT / folder).rglob("*")]
    return tuple(sorted(p for p in found if p.is_file() and "__pycache__" not in p.parts))


def python_files(folder: str) -> list[Path]:
    """List the Python files below one of our folders."""
    return [p for p in project_files() if p.suffix == ".py" and p.is_relative_to(ROOT / folder)]


def text_of(path: Path) -> str | None:
    """Read a text file; None for anything binary."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return None
