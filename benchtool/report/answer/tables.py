"""Tables of an explanation for the page, and narrower ones for the terminal."""

from __future__ import annotations

from benchtool.explain.findings import ChannelGap, FoundParameter, NamedEffect
from benchtool.explain.result import Explanation
from benchtool.report.answer.figures import (
    STAGE_TITLES,
    find_channel_label,
    parameter_text,
    percentage,
)
from benchtool.report.numbers import decimal_exponent, decimals_for, power_of_ten, scaled, with_unit
from benchtool.report.page import Table


def effects_table(answer: Explanation) -> Table:
    """Return a table of named effects with parameters, intervals and evidence."""
    rows = [
        _effect_row(effect, item, first=item is effect.parameters[0])
        for effect in answer.effects
        for item in effect.parameters
    ]
    return Table(
        _effects_caption(answer, "; log ratio: log likelihood ratio with and without the effect"),
        (
            *("effect", "stage", "parameter", "value", "95 % interval", "tolerance"),
            *("probability", "log ratio", "p"),
        ),
        rows,
        text_columns=3,
    )


def short_effects_table(answer: Explanation) -> Table:
    """Return the table of named effects for a terminal."""
    return effects_table(answer).select_columns((0, 2, 3, 4, 5, 6), _effects_caption(answer), 2)


def _effects_caption(answer: Explanation, more: str = "") -> str:
    alone = " Values of a class member assume that it acts alone."
    return (
        f"Named effects. Value: absolute value in the new model, not an increment; tolerance: "
        f"negligible change{more}.{alone if answer.kind == 'class' else ''}"
    )


def _effect_row(effect: NamedEffect, item: FoundParameter, *, first: bool) -> tuple[str, ...]:
    head = (effect.title, STAGE_TITLES[effect.stage])
    exponent = decimal_exponent(item.value, item.std)
    decimals = decimals_for(item.std / 10.0**exponent)
    interval = " … ".join(scaled(end, exponent, decimals) for end in (item.low, item.high))
    p_value = f"{effect.p_value:.2g}" if effect.p_value >= 1e-15 else f"<\u00a0{1e-15:.0e}"
    ratio = f"{effect.log_likelihood_ratio:.1f}"
    # Browsers break lines after a hyphen but not after a minus.
    evidence = (percentage(effect.probability), ratio, p_value.replace("-", "−"))
    return (
        *(head if first else ("", "")),
        item.name,
        parameter_text(item),
        f"({interval})·{power_of_ten(exponent)}" if exponent else interval,
        with_unit(f"{item.tolerance:.3g}", item.unit),
        *(evidence if first else ("", "", "")),
    )


SHORT_LEGEND = (
    "Before: model adjusted within uncertainty and tolerance; after: with the named effects. "
    "Floor: error of a correct model due to sensor and wake noise. Closed: share of the squared "
    "error above the floor that is removed, 100 % at the floor."
)


def gap_table(answer: Explanation) -> Table:
    """Return a table of the gap of each channel: as given, before, after, floor."""
    return Table(
        f"{_gap_caption(answer)} As given: model file without adjustment. {SHORT_LEGEND}",
        (
            *("channel", "unit", "as given", "before (95 %)", "after (95 %)", "floor"),
            *("floor, 5 to 95 %", "closed"),
        ),
        [_gap_row(gap, bool(answer.effects)) for gap in answer.gaps],
        text_columns=2,
    )


def short_gap_table(answer: Explanation, *, legend: bool = True) -> Table:
    """Return the table of gaps for a terminal."""
    caption = f"{_gap_caption(answer)} {SHORT_LEGEND}" if legend else _gap_caption(answer)
    return gap_table(answer).select_columns((0, 1, 3, 4, 5, 7), caption)


def _gap_caption(answer: Explanation) -> str:
    window = answer.window_s
    scope = f"over windows of {window:g} s" if window > 0.0 else "of settled points"
    return f"Root mean square prediction error on the validation recordings {scope}."


def _gap_row(gap: ChannelGap, changed: bool) -> tuple[str, ...]:
    display = find_channel_label(gap.channel)

    def to_text(*values: float) -> str:
        return " … ".join(f"{display.factor * value:.3g}" for value in values)

    after, share = "as before", "–"
    if changed:
        after = f"{to_text(gap.after)} ({to_text(gap.after_low, gap.after_high)})"
        share = f"{100.0 * min(1.0, max(0.0, gap.share_closed)):.0f} %"
        if gap.before <= gap.floor_high:  # noise alone can cause the gap
            share = "within noise"
    return (
        display.title,
        display.unit,
        to_text(gap.as_given),
        f"{to_text(gap.before)} ({to_text(gap.before_low, gap.before_high)})",
        after,
        to_text(gap.floor),
        to_text(gap.floor_low, gap.floor_high),
        share,
    )


def unjudged_sentence(answer: Explanation, name: str) -> str:
    """Return the reason why the data cannot judge an effect."""
    unjudged = answer.not_judged[name]
    if unjudged.reason == "no_trace":
        return "has no effect on this data at any size"
    if unjudged.reason == "not_tried":
        return "is not a candidate on any bench; test it manually in the model"
    items, tolerances = answer.parameters, answer.tolerances
    sizes = [
        f"{full.partition('.')[2]} off by "
        f"{with_unit(f'{unjudged.size * value:.3g}', items[full].unit)}"
        for full, value in tolerances.items()
        if full.partition(".")[0] == name and full in items
    ]
    limits = f" ({', '.join(sizes)})" if sizes else ""
    return f"detection limit: {unjudged.size:.2g} tolerances{limits}"


def tolerances_table(answer: Explanation) -> Table:
    """Return a table of the tolerances of all candidates."""
    items = answer.parameters
    rows = [
        (name, with_unit(f"{value:.3g}", items[name].unit if name in items else "1"))
        for name, value in answer.tolerances.items()
    ]
    departures = answer.request.loaded.model.discrepancy.relevant_on(answer.bench)
    rows += [(f"discrepancy.{name}", f"{value:.3g}") for name, value in departures.items()]
    return Table(
        "Tolerances. An effect is named only beyond its tolerance, a discrepancy from all laws "
        "only beyond `discrepancy` of the model file.",
        ("parameter", "tolerance"),
        rows,
    )


def next_table(answer: Explanation) -> Table:
    """Return a table of the evidence that the next experiment is expected to give."""
    experiment = answer.next
    expected = experiment.expected if experiment is not None else {}
    first = answer.find_title(experiment.candidates[0]) if experiment is not None else ""
    return Table(
        f"Expected log evidence ratio of {first} against each alternative.",
        ("alternative", "expected evidence"),
        [(answer.find_title(name), f"{value:.1f}") for name, value in expected.items()],
    )
