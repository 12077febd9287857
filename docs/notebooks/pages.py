"""Notebooks as pages of the site: run in an empty folder, then written as Markdown with figures.

A hook of mkdocs. With ``NOTEBOOKS=unrun`` in the environment they stay without outputs.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from pathlib import Path

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from nbclient import NotebookClient
from nbconvert import MarkdownExporter

CONTROL = re.compile("\x1b\\[[?0-9;]*[A-Za-z]")
"""What a command writes to move the cursor and to colour a terminal."""


def executed(path: Path) -> nbformat.NotebookNode:
    """Return a notebook with its outputs; a cell that fails raises with what it printed."""
    notebook = nbformat.read(path, as_version=4)
    programs = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    plain = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(
            notebook,
            timeout=120,
            resources={"metadata": {"path": folder}},
            extra_arguments=["--log-level=ERROR"],
        )
        client.execute(env=plain | {"PATH": programs})
    return notebook


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for every notebook, and its figures beside it."""
    for file in [one for one in files if one.src_uri.endswith(".ipynb")]:
        path = Path(str(file.abs_src_path))
        unrun = os.environ.get("NOTEBOOKS") == "unrun"
        notebook = nbformat.read(path, as_version=4) if unrun else executed(path)
        exporter = MarkdownExporter()
        text, found = exporter.from_notebook_node(
            notebook, {"output_files_dir": f"{path.stem}_files"}
        )
        text = CONTROL.sub("", text)
        text += f'\n<a href="{path.name}" download>This page as a notebook</a>\n'
        stem = file.src_uri.removesuffix(".ipynb")
        files.append(File.generated(config, f"{stem}.md", content=text))
        for name, content in found["outputs"].items():
            files.append(
                File.generated(config, f"{Path(stem).parent.as_posix()}/{name}", content=content)
            )
    return files


def on_page_markdown(markdown: str, **_: object) -> str:
    """Return a page whose links to notebooks lead to their pages."""
    return markdown.replace(".ipynb)", ".md)")
