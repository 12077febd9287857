"""Public Python interface: one function per command.

Keyword arguments have the names, ranges, defaults and error messages of the command-line options
(`benchtool fit --help`); `help(bt.fit)` lists them.
"""

from benchtool.api.fits import fit, pool
from benchtool.api.models import explain, export, load_model, load_rig, motor
from benchtool.api.recordings import compare, read, record, sweep
from benchtool.api.simulations import simulate_flight, simulate_pitch
from benchtool.core.rig import Rig
from benchtool.data.catalogue.query import runs
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.report.figure import look as figure_style
from benchtool.report.result import Result
from benchtool.simulate.flight.study import fly_and_measure as fly

__all__ = [
    "Effect", "Model", "Result", "Rig", "compare", "explain", "export", "figure_style", "fit",
    "fly", "load_model", "load_rig", "motor", "pool", "read", "record", "runs",
    "simulate_flight", "simulate_pitch", "sweep",
]  # fmt: skip
