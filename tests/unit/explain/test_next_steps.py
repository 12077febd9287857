"""What to do after an answer: every command that is given can be typed as it stands."""

from __future__ import annotations

import shlex
from dataclasses import replace

import pytest

from benchtool.commands.app import build
from benchtool.core.parameter import Parameters
from benchtool.explain.engine.verdict import KINDS, Kind, NotJudged
from benchtool.explain.next_steps import lines, next_sentence, next_steps
from benchtool.physics.catalogue import EFFECTS
from benchtool.report.answer.added_words import added_sentence, changes, changes_table
from benchtool.report.answer.page import answer_page
from benchtool.report.html import render_report
from tests.unit.explain.hand_made import FRICTION, NEXT, answer, verdict


def test_what_was_added_is_told_with_whole_values_and_those_before() -> None:
    given = answer("effect")
    assert added_sentence(given, "found") == (
        "Written: found/model.toml, which is pitch_bench with Coulomb friction in it."
    )
    found, moved = changes(given)
    assert found.words == "coulomb_friction.torque_Nm = 0.0241 N m (0 before)"
    assert (found.found, moved.found) == (True, False)
    assert (moved.name, moved.now) == ("inertia_kgm2", 0.0309)
    assert changes_table(given).rows[1][1] == "adjusted within what was known of it"


def test_of_a_class_the_likeliest_is_added_and_told_to_be_a_guess() -> None:
    said = added_sentence(answer("class"), "found")
    assert said.endswith("pitch_bench with Coulomb friction, the likeliest of the class, in it.")


@pytest.mark.parametrize(
    ("kind", "why"), [("none", "nothing is missing"), ("unknown", "no effect is named")]
)
def test_without_a_named_effect_there_is_no_new_model(kind: Kind, why: str) -> None:
    said = added_sentence(answer(kind), "found")
    assert said.startswith(f"No new model: {why}, so pitch_bench stays as it is.")
    assert changes(answer(kind)) == ()


def test_a_named_effect_leads_to_asking_again_and_to_simulating() -> None:
    given = answer("effect", model_given="beam.toml", effects_given="own.py")
    again, simulate = next_steps(given, "found")
    assert again.command == (
        "benchtool explain learn.csv --model found/model.toml --check check.csv --effects own.py "
        "--out found-again"
    )
    assert simulate.command.startswith("benchtool simulate pitch --model found/model.toml --out ")


def test_a_sweep_can_be_fitted_and_swept_with_what_was_found() -> None:
    given = answer("effect")
    sweep = replace(
        given,
        explanation=replace(given.explanation, verdict=verdict("effect", bench="sweep")),
    )
    commands = [step.command.split()[1] for step in next_steps(sweep, "found")]
    assert commands == ["explain", "fit", "sweep"]
    assert "'sim:beam?truth=found/model.toml'" in next_steps(sweep, "found")[2].command


@pytest.mark.parametrize("bench", ["pitch", "sweep"])
@pytest.mark.parametrize("kind", ["class", "unknown"])
def test_an_open_question_leads_to_the_next_experiment(kind: Kind, bench: str) -> None:
    plan = replace(NEXT, schedule=None, plan_toml="seed = 3\n") if bench == "sweep" else NEXT
    given = answer(kind, model_given="beam.toml")
    made = verdict(kind, bench=bench, next=plan)
    steps = next_steps(
        replace(given, explanation=replace(given.explanation, verdict=made)), "found"
    )
    assert ("found/next_schedule.toml" if bench == "pitch" else "found/next_plan.toml") in (
        steps[0].command
    )
    assert steps[-1].command == (
        "benchtool explain learn.csv found-next --model beam.toml --check check.csv --out "
        "found-again"
    )


@pytest.mark.parametrize(("probability", "asked"), [(0.999, False), (0.6, True)])
def test_a_richer_recording_is_asked_for_only_where_the_answer_is_unsure(
    probability: float, asked: bool
) -> None:
    blind = verdict(
        effects=(replace(FRICTION, probability=probability),),
        not_judged={
            name: NotJudged(reason="no_trace", size=100.0)
            for name in EFFECTS
            if name != "coulomb_friction"
        },
    )
    assert blind.mostly_blind
    given = answer()
    told = replace(given, explanation=replace(given.explanation, verdict=blind))
    assert bool(next_sentence(told)) == asked


@pytest.mark.parametrize("folder", ["", "found"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_option_of_the_commands_exists(kind: Kind, folder: str) -> None:
    for step in next_steps(answer(kind), folder):
        program, name, *words = shlex.split(step.command)
        assert program == "benchtool"
        options = {word for word in words if word.startswith("--")}
        assert options <= known_options(name, words[0])


def known_options(name: str, first: str) -> set[str]:
    """Return the options of a command, or of the first word's where it has several."""
    from typer.main import get_command

    found = get_command(build([name, first])).commands[name]  # type: ignore[attr-defined]
    inner = getattr(found, "commands", {}).get(first, found)
    return {option for item in inner.params for option in item.opts}


def test_the_page_has_it_all_in_its_first_section() -> None:
    given = answer("effect")
    text = render_report(answer_page(given, {}, folder="found"))
    first = text[text.index(">What now</h2>") : text.index(">Where</h2>")]
    assert "found/model.toml" in first
    assert ">adjusted within what was known of it</td>" in first
    for line in lines(next_steps(given, "found")):
        assert line in first
    unwritten = render_report(answer_page(given, {}))
    assert "Not written yet: a model that is pitch_bench with Coulomb friction in it." in unwritten
    assert "found-again" not in unwritten


def test_what_an_optimiser_left_of_a_zero_is_no_change() -> None:
    given = answer("effect")
    model = given.request.loaded.model.with_effect(EFFECTS["plate_side"])
    found = Parameters(
        (name, item.at(4.9e-27) if name == "plate_side.dx_m" else item)
        for name, item in model.parameters.items()
    )
    told = replace(
        given,
        explanation=replace(given.explanation, verdict=verdict("effect", parameters=found)),
    )
    assert [one.name for one in changes(told)] == ["coulomb_friction.torque_Nm"]
