"""The page on the JSON answer: its example is what the code writes, its table names every key."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from benchtool.report.answer.folder import VERSION, answer_tables
from tests.unit.explain.hand_made import answer

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "results.md").read_text("utf-8")


def example() -> dict[str, Any]:
    found = re.search(r"```json\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    tables: dict[str, Any] = json.loads(found[1])
    return tables


def test_the_example_is_what_the_code_writes():
    written = {"model": "found/model.toml", "schedule": "found/next_schedule.toml"}
    made = json.loads(json.dumps(answer_tables(answer("class"), **written)))
    shown = example()
    shortened = shown["next_experiment"]["text"].removesuffix("...")
    assert made["next_experiment"]["text"].startswith(shortened)
    assert shown["tolerances"].items() <= made["tolerances"].items()
    for tables in (made, shown):
        del tables["next_experiment"]["text"], tables["tolerances"], tables["software"]
    assert shown == made


def test_the_table_names_every_key_and_the_version():
    made = answer_tables(answer("class"))
    told = set(re.findall(r"`\.?([\w.\[\]]+)`", PAGE.split("## Example")[0]))
    words = {word for one in told for word in re.split(r"[.\[\]]+", one)}
    assert set(made) <= words
    assert set(made["effects"][0]) <= words
    assert set(made["effects"][0]["parameters"]["torque_Nm"]) <= words
    for key in ("where", "nearest", "next_experiment"):
        assert set(made[key]) <= words
    assert set(made["gap"]["rpm"]) <= words
    assert f"`version` is {VERSION};" in PAGE
