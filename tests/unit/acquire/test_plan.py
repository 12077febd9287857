from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.acquire.check_plan import check_plan, expected_extremes
from benchtool.acquire.plan import Plan, plan_from_toml, plan_to_toml
from benchtool.acquire.visit_order import expected_duration_s, plan_settings, plan_visits
from benchtool.core.errors import (
    BenchtoolError,
    PlanError,
)
from benchtool.core.rig_file import load_rig_by_name

SINGLE, QUAD = load_rig_by_name("pquad_single"), load_rig_by_name("pquad")

TEXT = """
repeats = 2
[plate]
distances_over_R = [0.5, 1.0]
[throttle]
pwm_us = [1400.0, 1600.0]
rotors_on = [1, 3]
[order]
kind = "counterbalanced"
anchor_every = 4
"""


def test_a_plan_reads_back_to_itself():
    plan = plan_from_toml(TEXT, "plan.toml").resolved(QUAD)
    assert plan_from_toml(plan_to_toml(plan), "again") == plan
    assert plan.plate.distances_m == (0.06, 0.12)


@pytest.mark.parametrize("kind", ["randomised", "counterbalanced", "as_given"])
def test_every_setting_is_visited_once_in_every_repeat(kind):
    plan = plan_from_toml(f"[order]\nkind = '{kind}'", "plan").resolved(QUAD)
    visits = plan_visits(plan, QUAD)
    assert [visit.point for visit in visits] == list(range(1, len(visits) + 1))
    planned = [visit for visit in visits if visit.kind != "anchor"]
    seen = {(visit.setting, visit.repeat) for visit in planned}
    assert len(seen) == len(planned) == len(plan_settings(plan, QUAD)) * 5
    for repeat in range(1, 6):
        numbers = [v.setting for v in planned if v.repeat == repeat]
        assert sorted(numbers) == [setting.setting for setting in plan_settings(plan, QUAD)]


def test_anchors_stand_at_moves_of_the_plate_and_at_both_ends():
    plan = plan_from_toml(TEXT, "plan").resolved(QUAD)
    visits = plan_visits(plan, QUAD)
    anchors = [index for index, visit in enumerate(visits) if visit.kind == "anchor"]
    assert anchors[0] == 0
    assert anchors[-1] == len(visits) - 1
    assert len({visits[index].setting for index in anchors}) == 1
    for index in anchors[1:-1]:
        assert visits[index - 1].position != visits[index + 1].position
    none = replace(plan, order=replace(plan.order, anchor_every=0))
    assert all(visit.kind != "anchor" for visit in plan_visits(none, QUAD))


def test_rotors_that_are_off_get_the_stop_pulse():
    plan = plan_from_toml(TEXT, "plan").resolved(QUAD)
    assert plan_settings(plan, QUAD)[0].pwm_us == (1400.0, 1000.0, 1400.0, 1000.0)


def test_expected_thrust_is_that_of_k_and_the_pwm_map():
    plan = plan_from_toml("[throttle]\npwm_us = [1550.0]", "p").resolved(SINGLE)
    found = expected_extremes(plan, SINGLE)
    speed = 1.05 * (1550.0 - 1050.0)
    assert found.rpm == pytest.approx(speed * 30.0 / np.pi)
    assert found.thrust_oge_N == pytest.approx(1.035e-5 * speed**2)
    # Eq. (2) at z/R = 0.5: 1/(1 - 1/4).
    assert found.thrust_N == pytest.approx(1.035e-5 * speed**2 * 4.0 / 3.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[throttle]\npwm_us = [1990.0]", r"1990 us, allowed are 1000 to 1950 us"),
        ("[throttle]\npwm_us = [900.0]", "900 us, allowed"),
        ("[throttle]\npwm_us = [1400.0, 1400.0]", "contains 1400 twice"),
        ("[throttle]\nrotors_on = [5]", "names rotor 5"),
        ("[plate]\ndistances_m = [0.01]", r"0\.01 m .* allowed: 0\.05 to 1\.5 m"),
        ("[plate]\ndistances_m = [2.0]", r"allowed: 0\.05 to 1\.5 m"),
        ("[plate]\ndistances_m = [0.1]\ntilts_deg = [20.0]", "tilt at most 8.2 deg"),
        (
            "[plate]\ndistances_m = [0.1]\ntilts_deg = [6.0]\nlateral_m = [-0.2]",
            "tilt at most 5.2 deg",
        ),
        (
            "[plate]\ndistances_m = [0.1]\ntilts_deg = [6.0]\nlateral_m = [0.9]",
            "tilt at most 4.8 deg",
        ),
        ("[plate]\nlateral_m = [1.0]", r"1 m is out of range; allowed: -0\.945 to 0\.945 m"),
        ("repeats = 1000000000", r"h, limit 48 h; lower repeats \(1,000,000,000\)"),
        ("[throttle]\npwm_us = [1900.0]", r"limit 45 N; lower throttle\.pwm_us"),
        ("[rest]\nabove_degC = 40.0", "not below rest.above_degC"),
    ],
)
def test_plans_beyond_the_limits_are_refused(text, words):
    with pytest.raises(PlanError, match=words):
        check_plan(plan_from_toml(text, "plan").resolved(QUAD), QUAD)


def test_narrower_limits_of_the_device_hold_too():
    plan = Plan().resolved(QUAD)
    assert check_plan(plan, QUAD).pwm_us == 1590.0
    with pytest.raises(PlanError, match="limit 5 N"):
        check_plan(plan, QUAD, {"thrust_N": 5.0})
    with pytest.raises(BenchtoolError, match="1000 to 1500 us"):
        check_plan(plan, QUAD, {"pwm_us": 1500.0})


def test_duration_counts_moves_settling_and_tares():
    plan = plan_from_toml(
        "repeats = 1\n[plate]\ndistances_m=[0.4]\n[throttle]\npwm_us=[1400.0]\n"
        "[order]\nreferences=false\nanchor_every=0\n",
        "plan",
    ).resolved(SINGLE)
    visits = plan_visits(plan, SINGLE)
    # 1 m at 0.1 m/s, 1.5 s standstill, 0.3 + 1.4 + 2 s for the point, 2.5 s for the tare.
    assert expected_duration_s(plan, SINGLE, visits) == pytest.approx(10.0 + 1.5 + 3.7 + 2.5)


def test_the_largest_rest_of_a_tare_follows_from_the_stated_zero():
    cell = SINGLE.sensors["thrust_N"]

    def residual_N(**facts: float) -> float:
        sensors = {**SINGLE.sensors, "thrust_N": replace(cell, **facts)}
        found_N = Plan().resolved(replace(SINGLE, sensors=sensors)).tare.residual_N
        assert found_N is not None
        return found_N

    error_N = cell.noise / cell.rate_Hz**0.5
    for zero_sd in (0.002, 0.03):
        expected_N = 5.0 * float(np.hypot(zero_sd, error_N))
        assert residual_N(zero_sd=zero_sd) == pytest.approx(expected_N)
    assert residual_N(zero_sd=0.0) == 0.001 * SINGLE.limits.thrust_N
    assert residual_N(zero_sd=0.0, quantum=0.01) == 0.02
