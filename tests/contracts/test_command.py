"""Every command: it takes declared inputs, its help is theirs, and it refuses in one sentence.

A new command needs a row in `REFUSED` here and one in docs/reference/commands.md
(`python docs/reference/write_commands.py` writes it).
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import pytest

from benchtool.acquire.plan import Plan
from benchtool.commands.app import COMMANDS, main, module_of
from benchtool.core.inputs import Item, items

WRITTEN = Path(__file__).parents[2] / "docs" / "reference" / "commands.md"

RUNNABLE = [name for name, (where, _) in COMMANDS.items() if where]

REFUSED: dict[str, tuple[str, str]] = {
    "demo": ("--speed 0.1", "--speed is 0.1, allowed is 1 to 1,000"),
    "sweep": ("sim:pquad --dry-run --tilt 900", "--tilt names 900 deg, allowed is -89 to 89 deg"),
    "record": (
        "sim:pquad?mode=pitch --limit-deg 100",
        "--limit-deg is 100 deg, allowed is",
    ),
    "runs close": ("nowhere", "nowhere"),
    "calibrate": ("--gravity 1", "--gravity is 1 m/s2, allowed is 9.76 to 9.84 m/s2"),
    "recalibrate": ("nowhere", "nowhere"),
    "import": ("a.csv --near-m -1", "--near-m is -1 m, allowed is 0 to 100,000 m"),
    "fit": ("a.csv --model quad --loss hubre", "unknown --loss 'hubre'; did you mean 'huber'?"),
    "plan": ("a.csv --model quad --for R", "--for is 'R', but a quantity and a number"),
    "explain": ("a.csv --draws 3", "--draws is 3, allowed is 20 to 100,000"),
    "report": ("a.csv --motors 0,1", "--motors names 0, allowed is 1 or more"),
    "simulate pitch": ("--seeds 0", "--seeds is 0, allowed is 1 or more"),
    "simulate flight": ("--lag-s -1", "--lag-s is -1 s, allowed is 0 to 10 s"),
    "simulate paper": ("--sensitivty", "--sensitivty"),
    "web": ("--port 99999", "--port is 99999, allowed is 0 to 65,535"),
    "bench check": ("usb:1", "unknown address scheme 'usb'"),
    "bench map": ("sim:pquad --motors 1,x", "--motors is '1,x', but whole numbers"),
    "bench bridge": ("--out a.js --port 0", "--port is 0, allowed is 1 to 65,535"),
    "bench serve": ("--system 0", "--system is 0, allowed is 1 to 250"),
    "firmware": ("--out a --board due", "unknown board 'due'"),
    "ports": ("--baud 0", "--baud is 0, allowed is 1 to 100,000,000"),
    "doctor": ("--udevrule", "--udevrule"),
    "flow table": ("--spacing-R 1", "--spacing-R is 1, allowed is 2 to 1,000"),
    "flow picture": ("--z-over-r nan", "--z-over-r is nan, allowed is 0.5 to 1,000"),
    "rigs": ("pqad", "did you mean 'pquad'"),
    "models": ("sngle", "did you mean 'single'"),
    "effects": ("body_lft", "did you mean 'body_lift'"),
}
"""Words that a command refuses, and what its sentence says."""


def inputs_of(name: str) -> tuple[Item, ...]:
    called = getattr(import_module(module_of(name)), COMMANDS[name][0].partition(":")[2])
    return items(called.inputs)


def test_every_command_has_a_case_of_its_own() -> None:
    assert set(REFUSED) == set(RUNNABLE)


@pytest.mark.parametrize("name", RUNNABLE)
def test_what_is_refused_ends_in_one_sentence_and_exit_code_2(
    name: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    words, sentence = REFUSED[name]
    with pytest.raises(SystemExit) as leaving:
        main([*name.split(), *words.split()])
    error = capsys.readouterr().err
    assert leaving.value.code == 2
    assert sentence in error
    assert (error.count("\n"), list(tmp_path.iterdir())) == (1, [])


@pytest.mark.parametrize("name", RUNNABLE)
def test_every_input_says_what_it_is(name: str) -> None:
    found = inputs_of(name)
    assert len({item.option for item in found}) == len(found)
    for item in found:
        assert item.about.help.strip(), item.key
        assert item.about.help[-1] == ".", item.key
        unit = re.search(r"_(us|m|s|deg|m_s|rad_s|kg)$", item.key.rpartition(".")[2])
        if unit is not None:
            assert item.about.unit.replace("/", "_") == unit[1], item.key
        if item.kind in (int, float) and not item.count:
            assert item.range, f"{item.key} takes any number; give it a range"


@pytest.mark.parametrize("name", RUNNABLE)
def test_a_command_is_described_in_one_place(name: str) -> None:
    called = getattr(import_module(module_of(name)), COMMANDS[name][0].partition(":")[2])
    assert called.__doc__.splitlines()[0].rstrip(".") == COMMANDS[name][1].rstrip(".")
    section = WRITTEN.read_text("utf-8").partition(f"## {name}\n")[2].partition("\n## ")[0]
    for item in inputs_of(name):
        assert f"| `{item.option}" in section, item.key


def test_every_key_of_a_plan_stands_on_the_page_of_the_plan_file() -> None:
    page = WRITTEN.with_name("plan.md").read_text("utf-8")
    for item in items(Plan):
        assert f"| `{item.key.rpartition('.')[2]}` |" in page, item.key
