"""Every code block in the documentation does what its page says."""

from __future__ import annotations

from pathlib import Path

import pytest
from _pytest.mark import ParameterSet

from tests.docs.page import blocks_of, run_page

ROOT = Path(__file__).parents[2]
PAGES = [
    page
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if any(block.is_run for block in blocks_of(page.read_text(encoding="utf-8")))
]


def as_case(page: Path) -> ParameterSet:
    serves = "bench serve" in page.read_text(encoding="utf-8")
    marks = [pytest.mark.real_time(deadline_s=0.1)] if serves else []
    return pytest.param(page, marks=marks, id=page.relative_to(ROOT).as_posix())


@pytest.mark.parametrize("page", [as_case(page) for page in PAGES])
def test_page(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    failures = run_page(page.read_text(encoding="utf-8"), str(page), tmp_path)
    assert failures == []


SAMPLE = """
Text.

<!-- file: notes/plan.toml -->
```toml
seed = 3
```

```console
$ make demo
$ benchtool --version
benchtool 0.0.0
$ python -c \\
    "print(1)"
$ benchtool no-such-command   # exit 2
```

<!-- not run: needs a bench on a port -->
```console
$ benchtool no-such-command
```

```python
from pathlib import Path
seed = Path("notes/plan.toml").read_text()
```

- in a list
  ```python
  Path("copy.toml").write_text(seed)
  ```
"""


def test_a_page_is_run_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_page(SAMPLE, "sample.md", tmp_path) == []
    assert (tmp_path / "copy.toml").read_text() == "seed = 3\n"
    assert [block.is_run for block in blocks_of(SAMPLE)] == [True, True, False, True, True]


def test_a_wrong_exit_code_is_reported_with_its_line(tmp_path: Path) -> None:
    page = "intro\n\n```sh\n$ benchtool no-such-command\n```\n"
    (failure,) = run_page(page, "page.md", tmp_path)
    assert failure.startswith("page.md:3: $ benchtool no-such-command\nexit code 2, expected 0")
    assert "unknown command" in failure


def test_what_is_not_quoted_means_what_it_means_to_a_shell(tmp_path: Path) -> None:
    words = "import sys; assert sys.argv[1:] == ['a?b&c=1', '--yes']"
    quoted = f"```sh\n$ python -c \"{words}\" 'a?b&c=1' --yes\n```\n"
    assert run_page(quoted, "page.md", tmp_path) == []
    (failure,) = run_page(quoted.replace("'a?b&c=1'", "a?b&c=1"), "page.md", tmp_path)
    assert "--yes: command not found" in failure


def test_a_command_left_running_ends_with_the_page(tmp_path: Path) -> None:
    (tmp_path / "wait.py").write_text("print('up', flush=True)\nimport time\ntime.sleep(60)\n")
    assert run_page("```sh\n$ python wait.py &\n$ python -c 1\n```\n", "page.md", tmp_path) == []
    assert run_page("```sh\n$ python -c 1 &\n```\n", "page.md", tmp_path) == [
        "page.md:1: $ python -c 1 &\nended without a word"
    ]
