"""What something unknown depends on: the residual over that variable, with a law."""

from __future__ import annotations

from matplotlib.figure import Figure

from benchtool.explain.answer import Answer
from benchtool.report.figure import figure
from benchtool.report.palette import BLACK, BLUE, GREY, ORANGE, PALE


def depends_sentence(answer: Answer) -> str | None:
    """Say what was weighed, and how a law is scored; None where nothing depends on anything."""
    found = answer.verdict.depends
    if found is None:
        return None
    text = (
        f"What is missing depends on {found.phrase}, probability {found.probability:.2f} among "
        f"{found.candidates} pairs of a variable and where it acts, which are paid for."
    )
    if found.law is None:
        return f"{text} No law of it closes enough of the gap to be drafted."
    numbers = ", ".join(f"{name} = {value:.4g}" for name, value in found.law.values.items())
    return (
        f"{text} The shortest law is {found.formula} with {numbers}. Laws that were chosen without "
        f"a tenth of the readings close {100.0 * found.closed:.0f} % of the squared gap there. It "
        f"describes, it does not explain: its cause is for a person to name."
    )


@figure(
    page="answer",
    name="depends",
    title=lambda answer: f"What is missing, over {answer.verdict.depends.phrase}",
    caption="Dots: what each reading misses, beside what may vary within tolerance. Line with its "
    "95 % band: a smooth function of the variable. Dashed: the law, up to a constant.",
    when=lambda answer: answer.verdict.depends is not None,
    height_in=3.4,
)
def depends(figure: Figure, answer: Answer) -> None:
    """Draw readings, the smooth function with its band, and the law through its mean."""
    found = answer.verdict.depends
    assert found is not None
    curve, axes = found.curve, figure.subplots()
    axes.axhline(0.0, color=GREY, linewidth=0.9)
    axes.plot(curve.points, 100.0 * curve.shares, "o", ms=3.0, color=GREY, alpha=0.6)
    if found.variable.blocks:
        axes.plot(curve.at, 100.0 * curve.mean, "_", color=BLUE)
    else:
        axes.fill_between(
            curve.at, 100.0 * curve.low, 100.0 * curve.high, color=PALE, linewidth=0.0
        )
        axes.plot(curve.at, 100.0 * curve.mean, color=BLUE, label="a smooth function")
    if len(curve.law):
        shift = float((curve.mean - curve.law).mean()) if found.form.name != "covered" else 0.0
        law = 100.0 * (curve.law + shift)
        axes.plot(curve.at, law, "--", color=ORANGE, label="the law")
        axes.legend(loc="best")
    if found.variable.scale in ("positive", "distance") and 0.0 < 4.0 * curve.at[0] < curve.at[-1]:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel(f"{found.variable.phrase}, {found.variable.symbol} [–]")
    axes.set_ylabel(f"missed [% of {found.form.share_of}]", color=BLACK)
