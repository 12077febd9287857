from __future__ import annotations

from benchtool.acquire.plan import Plan, read_plan
from benchtool.core.inputs import make
from benchtool.core.rig_file import rig_named
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import ConnectionStatus, SweepStatus
from benchtool.web.tabs.sweep.plan_card import FIELDS, plan_texts
from benchtool.web.tabs.sweep.ratio_card import nothing_yet


def test_an_empty_plot_says_what_comes_next() -> None:
    bench = BenchClient()
    assert nothing_yet(bench).startswith("Connect a bench")
    bench.connection = ConnectionStatus(status="on")
    assert nothing_yet(bench).startswith("Start a sweep")
    bench.sweep = SweepStatus(status="running")
    assert nothing_yet(bench).startswith("The sweep runs")
    # Also where the bench is gone in mid-sweep.
    bench.connection = ConnectionStatus()
    assert nothing_yet(bench).startswith("The sweep runs")


def test_what_an_empty_field_shows_is_what_would_be_typed_for_the_same_plan() -> None:
    rig = rig_named("pquad")
    resolved = Plan().resolved(rig)
    shown = plan_texts(resolved, rig)
    assert set(shown) == {*FIELDS} - {"z_m", "throttle"}
    assert make(Plan, shown, source="label").resolved(rig) == resolved
    steps = read_plan("steps").resolved(rig)
    assert plan_texts(steps, rig)["order"] == "counterbalanced"
