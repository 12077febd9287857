"""`benchtool fit`: from run folders or any CSV to parameters with uncertainties and figures."""

from __future__ import annotations

import shlex

from benchtool.commands.declared import declared
from benchtool.commands.recipe_options import recipe_given
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.own_code import refuse_code
from benchtool.fit.recipe import FitInputs


@declared(FitInputs, lambda given: FitInputs(recipe=recipe_given(given, "fit")))
def fit(inputs: FitInputs) -> None:
    """Fit a ground-effect model to run folders or any CSV."""
    import sys

    from benchtool.commands.terminal.show_fit import print_fit, working
    from benchtool.fit.diagnose import refusal
    from benchtool.fit.run_recipe import run_recipe
    from benchtool.report.fit.page import refuse_full, write_fit

    if (out := inputs.out) is not None:
        refuse_full(out)
    permit = announce_code if inputs.folder is None else refuse_code
    with working() as report:
        output = run_recipe(
            inputs.recipe, report, profile=inputs.profile, budget=inputs.budget, permit=permit
        )
    print_fit(output)
    problem = refusal(output.results)
    if out is not None:
        page = write_fit(out, output, [shlex.join(["benchtool", *sys.argv[1:]])])
        model = "model.toml" if (out / "model.toml").is_file() else "no model (there is no answer)"
        print(f"written: {page} and, beside it, result.json, {model} and the figures")
    if problem is not None:
        raise problem
