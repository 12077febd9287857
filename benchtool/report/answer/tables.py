"""Tables of an answer, for the page and, narrower, for the terminal."""

from __future__ import annotations

from benchtool.explain.answer import ExplainResult, channel_words
from benchtool.explain.engine.verdict import STAGES, ChannelGap, FoundParameter, NamedEffect
from benchtool.report.answer.figures import parameter_text, percentage
from benchtool.report.numbers import decimal_exponent, decimals_for, power_of_ten, scaled, with_unit
from benchtool.report.page import Table


def effects_table(answer: ExplainResult) -> Table:
    """List every named effect with its parameters, intervals and evidence."""
    rows = [
        _effect_row(effect, item, first=item is effect.parameters[0])
        for effect in answer.verdict.effects
        for item in effect.parameters
    ]
    return Table(
        _effects_caption(answer, "; log ratio: of likelihoods, with the effect over without it"),
        (
            *("effect", "stage", "parameter", "value", "95 % interval", "tolerance"),
            *("probability", "log ratio", "p"),
        ),
        rows,
        text_columns=3,
    )


def short_effects_table(answer: ExplainResult) -> Table:
    """List every named effect in the width of a terminal."""
    return effects_table(answer).narrowed((0, 2, 3, 4, 5, 6), _effects_caption(answer), 2)


def _effects_caption(answer: ExplainResult, more: str = "") -> str:
    alone = (
        " A member of a class has the numbers that it would have by itself."
        if answer.verdict.kind == "class"
        else ""
    )
    return (
        f"What was found. Value: the whole parameter in the new model, nothing to add to the old "
        f"one; tolerance: a change that would not matter{more}.{alone}"
    )


def _effect_row(effect: NamedEffect, item: FoundParameter, *, first: bool) -> tuple[str, ...]:
    head = (effect.title, STAGES[effect.stage])
    p_value = f"{effect.p_value:.2g}" if effect.p_value >= 1e-15 else f"<\u00a0{1e-15:.0e}"
    ratio = f"{effect.log_likelihood_ratio:.1f}"
    # A line may break behind a hyphen, never behind a minus.
    evidence = (percentage(effect.probability), ratio, p_value.replace("-", "−"))
    return (
        *(head if first else ("", "")),
        item.name,
        parameter_text(item),
        _interval(item),
        with_unit(f"{item.tolerance:.3g}", item.unit),
        *(evidence if first else ("", "", "")),
    )


def _interval(item: FoundParameter) -> str:
    exponent = decimal_exponent(item.value, item.std)
    decimals = decimals_for(item.std / 10.0**exponent)
    shown = f"{scaled(item.low, exponent, decimals)} … {scaled(item.high, exponent, decimals)}"
    return f"({shown})·{power_of_ten(exponent)}" if exponent else shown


SHORT_LEGEND = (
    "Before: the model with what is uncertain or within tolerance adjusted; after: with what was "
    "named, too. Floor: what a true model would still miss, because sensors and wake are noisy. "
    "Closed: how much of the squared error above the floor is gone, 100 % at the floor."
)
LEGEND = f"As given: the model as its file states it. {SHORT_LEGEND}"


def gap_table(answer: ExplainResult) -> Table:
    """List the gap of each channel: as given, before, after, floor."""
    return Table(
        f"{_gap_caption(answer)} {LEGEND}",
        (
            *("channel", "unit", "as given", "before (95 %)", "after (95 %)", "floor"),
            *("floor, 5 to 95 %", "closed"),
        ),
        [_gap_row(gap, answer.has_model) for gap in answer.verdict.gaps],
        text_columns=2,
    )


def short_gap_table(answer: ExplainResult) -> Table:
    """List the gap in the width of a terminal."""
    caption = f"{_gap_caption(answer)} {SHORT_LEGEND}"
    return gap_table(answer).narrowed((0, 1, 3, 4, 5, 7), caption)


def _gap_caption(answer: ExplainResult) -> str:
    window = answer.verdict.window_s
    each = f"over windows of {window:g} s" if window > 0.0 else "of settled points"
    return f"Prediction error on the check recordings, root mean square {each}."


def _gap_row(gap: ChannelGap, changed: bool) -> tuple[str, ...]:
    words = channel_words(gap.channel, gap.unit)

    def shown(value: float) -> str:
        return f"{words.factor * value:.3g}"

    return (
        words.title,
        words.unit,
        shown(gap.as_given),
        f"{shown(gap.before)} ({shown(gap.before_low)} … {shown(gap.before_high)})",
        f"{shown(gap.after)} ({shown(gap.after_low)} … {shown(gap.after_high)})"
        if changed
        else "as before",
        shown(gap.floor),
        f"{shown(gap.floor_low)} … {shown(gap.floor_high)}",
        _share(gap) if changed else "–",
    )


def _share(gap: ChannelGap) -> str:
    """Return how much of a gap is closed; not of one that noise could have made."""
    if gap.before <= gap.floor_high:
        return "within noise"
    return f"{100.0 * min(1.0, max(0.0, gap.share_closed)):.0f} %"


def unjudged_sentence(answer: ExplainResult, name: str) -> str:
    """Say of an effect why this data cannot show it."""
    one = answer.verdict.not_judged[name]
    if one.reason == "no_trace":
        return "leaves no trace in this data, however large it is"
    if one.reason == "not_tried":
        return "is not tried: it is a candidate on no bench; try it in the model by hand"
    items, tolerances = answer.verdict.parameters, answer.verdict.tolerances
    sizes = [
        f"{full.partition('.')[2]} off by {with_unit(f'{one.size * value:.3g}', items[full].unit)}"
        for full, value in tolerances.items()
        if full.partition(".")[0] == name and full in items
    ]
    own = f" ({', '.join(sizes)})" if sizes else ""
    return f"would have to be {one.size:.2g} tolerances large to show{own}"


def tolerances_table(answer: ExplainResult) -> Table:
    """List the tolerances of every effect that was tried."""
    items = answer.verdict.parameters
    rows = [
        (name, with_unit(f"{value:.3g}", items[name].unit if name in items else "1"))
        for name, value in answer.verdict.tolerances.items()
    ]
    departures = answer.request.loaded.model.discrepancy.shown_by(answer.verdict.bench)
    rows += [(f"discrepancy.{name}", f"{value:.3g}") for name, value in departures.items()]
    return Table(
        "What does not matter on this bench; an effect is named only beyond it, and a departure "
        "from all laws only beyond discrepancy of the model file.",
        ("parameter", "tolerance"),
        rows,
    )


def next_table(answer: ExplainResult) -> Table:
    """List what the next experiment is expected to separate the likeliest explanation from."""
    experiment = answer.verdict.next
    expected = experiment.expected if experiment is not None else {}
    first = answer.title_of(experiment.candidates[0]) if experiment is not None else ""
    return Table(
        f"What it is expected to separate {first} from: log evidence ratio, on average.",
        ("rival", "expected evidence"),
        [(answer.title_of(name), f"{value:.1f}") for name, value in expected.items()],
    )
