"""Limits hold however a device spreads its channels over rows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from benchtool.bench.limit_check import LimitCheck, format_unmonitored_limits
from benchtool.bench.plate_check import plate_tolerance_m
from benchtool.bench.standstill import rotor_speeds
from benchtool.core.channel import Channel
from benchtool.core.errors import LimitExceeded
from benchtool.core.rig_file import load_rig_by_name

Array = NDArray[np.float64]

RIG = load_rig_by_name("pquad")
CHANNELS = (
    *(Channel(f"rpm{i + 1}", "rpm") for i in range(4)),
    Channel("thrust_N", "N"),
)
RATE_HZ = 100.0
TOGETHER = np.ones((1, 5), bool)
ALTERNATING = np.array([[1, 1, 1, 1, 0], [0, 0, 0, 0, 1]], bool)
ONE_BY_ONE = np.eye(5, dtype=bool)
SPREADS = pytest.mark.parametrize(
    "spread", [TOGETHER, ALTERNATING, ONE_BY_ONE], ids=["together", "alternating", "one by one"]
)


def stopped_at_s(
    spread: NDArray[np.bool_], rpm: list[float], thrust_N: float, pwm_us: float, block: int = 5
) -> tuple[float, LimitExceeded | None]:
    """Return when a check stops a bench that reads the same for ever, at most ten seconds."""
    check = LimitCheck(CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    check.record_command(np.full(4, pwm_us), 0.0)
    row = np.array([*rpm, thrust_N])
    rng = np.random.default_rng(3)
    n = int(10.0 * RATE_HZ)
    values = np.where(spread[np.arange(n) % len(spread)], row, np.nan)
    values[:, 4] += rng.normal(0.0, 0.01, n)
    values[:, :4] += np.where(np.array(rpm) > 0.0, rng.normal(0.0, 5.0, (n, 4)), 0.0)
    time_s = (1.0 + np.arange(n)) / RATE_HZ
    for start in range(0, n, block):
        rows = slice(start, start + block)
        if error := check.find_violation(time_s[rows], values[rows]):
            return float(time_s[start]), error
    return float(time_s[-1]), None


@SPREADS
def test_a_healthy_bench_goes_on(spread):
    assert stopped_at_s(spread, [4512.0] * 4, 9.2, 1500.0)[1] is None


@SPREADS
@pytest.mark.parametrize("block", [1, 5])
def test_thrust_of_the_wrong_sign_stops_it(spread, block):
    when_s, error = stopped_at_s(spread, [4512.0] * 4, -5.0, 1500.0, block)
    assert error is not None
    assert error.channel == "thrust_N"
    assert when_s < 1.0


@SPREADS
@pytest.mark.parametrize("block", [1, 3, 5])
def test_a_rotor_that_does_not_turn_stops_it(spread, block):
    when_s, error = stopped_at_s(spread, [4512.0, 4512.0, 0.0, 4512.0], 6.9, 1500.0, block)
    assert error is not None
    assert error.channel == "rpm3"
    assert when_s < 2.5


LOOP_CHANNELS = (*CHANNELS[:4], *(Channel(f"pwm{i + 1}_us", "pwm_us") for i in range(4)))
HOVER_US = 1500.0


def loop_stopped_at_s(
    pulses: Callable[[Array], Array],
    rpm: Callable[[Array, Array], Array],
    host_us: float = HOVER_US,
    *,
    channels: tuple[Channel, ...] = LOOP_CHANNELS,
    armed_else: bool = False,
    block_s: float = 0.05,
    seconds: float = 15.0,
) -> tuple[float, LimitExceeded | None]:
    """Return when a bench with a loop on board is stopped.

    Args:
        pulses: of time (n,), gives (n, 4).
        rpm: of time and the speeds that the pulses give (n, 4), gives (n, 4).
        host_us: what the host commanded last, for all rotors, at 0 s.
        channels: that the bench streams.
        armed_else: as for `expect_loop`.
        block_s: how much a read brings.
        seconds: how long.
    """
    check = LimitCheck(channels, RIG, RIG.limits, 1.0, 0.0)
    check.expect_loop(0.0, rc_arming=armed_else)
    check.record_command(np.full(4, host_us), 0.0)
    time_s = (1.0 + np.arange(int(seconds * RATE_HZ))) / RATE_HZ
    told = pulses(time_s)
    whole = np.hstack([rpm(time_s, rotor_speeds(RIG.propulsion, told)), told])
    values = whole[:, : len(channels)]
    block = max(1, round(block_s * RATE_HZ))
    for start in range(0, len(time_s), block):
        rows = slice(start, start + block)
        if error := check.find_violation(time_s[rows], values[rows]):
            return float(time_s[rows][-1]), error
    return float(time_s[-1]), None


def hovering(time_s: Array) -> Array:
    """Give pulses of a loop that swings a beam about hover: front and rear against each other."""
    swing_us = 150.0 * np.sin(2.0 * np.pi * 0.7 * time_s)
    return HOVER_US + np.outer(swing_us, [1.0, -1.0, 1.0, -1.0])


def follows(time_s: Array, told_rpm: Array) -> Array:
    return told_rpm + 5.0 * np.sin(40.0 * time_s)[:, None]


def test_a_loop_that_takes_a_rotor_far_from_the_hosts_pulse_goes_on():
    def saturated(time_s: Array) -> Array:
        pulses = hovering(time_s)
        pulses[time_s > 3.0, 2] = RIG.propulsion.pwm_start_us + 5.0  # held there by the loop
        return pulses

    assert loop_stopped_at_s(hovering, follows)[1] is None
    assert loop_stopped_at_s(saturated, follows)[1] is None
    by_host = LimitCheck(LOOP_CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    by_host.record_command(np.full(4, HOVER_US), 0.0)
    time_s = np.linspace(3.1, 6.0, 290)
    told = saturated(time_s)
    told_rpm = rotor_speeds(RIG.propulsion, told)
    error = by_host.find_violation(time_s, np.hstack([follows(time_s, told_rpm), told]))
    assert error is not None  # what the host commanded last would have stopped it
    assert error.channel == "rpm3"


def test_a_schedule_that_ends_by_itself_goes_on():
    def ends(time_s: Array) -> Array:
        stop_us = RIG.propulsion.pwm_stop_us
        return np.where(time_s[:, None] < 5.0, hovering(time_s), stop_us)

    assert loop_stopped_at_s(ends, follows)[1] is None


@pytest.mark.parametrize("block_s", [0.01, 0.05, 0.4])
def test_a_dead_motor_under_a_loop_is_stopped(block_s):
    def dead(time_s: Array, told_rpm: Array) -> Array:
        rpm = follows(time_s, told_rpm)
        rpm[time_s > 4.0, 1] = 0.0
        return rpm

    when_s, error = loop_stopped_at_s(hovering, dead, block_s=block_s)
    assert error is not None
    assert error.channel == "rpm2"
    assert "the pulse widths that the bench reports" in str(error)
    # As long as with the host's pulses; the mean remembers for 1 s, and a block is a mean, too.
    assert 6.0 < when_s < 4.0 + 2.0 + 1.0 + 2.0 * block_s


def test_a_dead_motor_is_found_though_its_pulses_touch_the_start_again_and_again():
    def wild(time_s: Array) -> Array:
        swing_us = 450.0 * np.sin(2.0 * np.pi * 1.0 * time_s)
        return HOVER_US + np.outer(swing_us, [1.0, -1.0, 1.0, -1.0])

    def dead(time_s: Array, told_rpm: Array) -> Array:
        rpm = follows(time_s, told_rpm)
        rpm[:, 0] = 0.0
        return rpm

    assert loop_stopped_at_s(wild, follows)[1] is None
    when_s, error = loop_stopped_at_s(wild, dead)
    assert error is not None
    assert when_s < 3.5


def test_a_motor_that_runs_away_under_a_loop_is_stopped():
    def away(time_s: Array, told_rpm: Array) -> Array:
        rpm = follows(time_s, told_rpm)
        rpm[time_s > 2.0, 3] = 5000.0
        return rpm

    def idle(time_s: Array) -> Array:
        return np.full((len(time_s), 4), RIG.propulsion.pwm_start_us + 20.0)

    when_s, error = loop_stopped_at_s(idle, away)
    assert error is not None
    assert error.channel == "rpm4"
    assert 7.0 < when_s < 8.5


def test_motors_that_a_loop_turns_after_the_hosts_zero_are_stopped():
    stop_us = RIG.propulsion.pwm_stop_us
    when_s, error = loop_stopped_at_s(hovering, follows, host_us=stop_us)
    assert error is not None
    assert f"a pulse of {stop_us:g} us" in str(error)
    assert 5.0 < when_s < 5.2
    # Where an operator flies with a transmitter, motors may turn before the host says anything.
    assert loop_stopped_at_s(hovering, follows, host_us=stop_us, armed_else=True)[1] is None


def test_the_hosts_zero_ends_what_an_operator_began_too():
    check = LimitCheck(LOOP_CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    check.expect_loop(0.0, rc_arming=True)
    time_s = np.arange(1, 1501) / RATE_HZ
    told = hovering(time_s)
    values = np.hstack([follows(time_s, rotor_speeds(RIG.propulsion, told)), told])
    check.record_command(np.full(4, HOVER_US), 0.0)
    assert check.find_violation(time_s[:200], values[:200]) is None
    check.record_command(np.full(4, RIG.propulsion.pwm_stop_us), 2.0)
    found = [
        check.find_violation(time_s[i : i + 5], values[i : i + 5]) for i in range(200, 1000, 5)
    ]
    error = next(item for item in found if item is not None)
    assert error.channel == "rpm1"


def test_reported_pulses_that_fall_silent_stop_a_loop():
    def silent(time_s: Array) -> Array:
        pulses = hovering(time_s)
        pulses[time_s > 4.0] = np.nan
        return pulses

    when_s, error = loop_stopped_at_s(silent, lambda t, told: follows(t, np.nan_to_num(told)))
    assert error is not None
    assert error.channel == "silence of pwm1_us in s"
    assert when_s < 5.2


def test_a_loop_that_reports_no_pulses_is_judged_by_the_hosts():
    def slow(time_s: Array, told_rpm: Array) -> Array:
        return np.where(time_s[:, None] > 3.0, 100.0, told_rpm)

    when_s, error = loop_stopped_at_s(hovering, slow, channels=LOOP_CHANNELS[:4])
    assert error is not None
    assert f"a pulse of {HOVER_US:g} us" in str(error)
    assert when_s < 3.2


def test_a_host_that_slept_does_not_stop_a_loop_for_it():
    check = LimitCheck(LOOP_CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    check.expect_loop(0.0, rc_arming=False)
    check.record_command(np.full(4, HOVER_US), 0.0)
    for first in (0.0, 9.0):  # nine seconds in between that nobody read
        time_s = first + np.arange(1, 101) / RATE_HZ
        told = hovering(time_s)
        rpm = follows(time_s, rotor_speeds(RIG.propulsion, told))
        for start in range(0, 100, 5):
            rows = slice(start, start + 5)
            values = np.hstack([rpm[rows], told[rows]])
            assert check.find_violation(time_s[rows], values) is None


@pytest.mark.parametrize("channels", [CHANNELS[:4], LOOP_CHANNELS])
def test_the_newest_speed_is_held_against_the_hosts_zero(channels):
    check = LimitCheck(channels, RIG, RIG.limits, 1.0, 0.0)
    check.expect_loop(0.0, rc_arming=False)
    check.record_command(np.full(4, RIG.propulsion.pwm_stop_us), 0.0)
    time_s = 6.0 + 0.01 * np.arange(1, 4)
    still_us = [RIG.propulsion.pwm_stop_us] * (len(channels) - 4)
    rows = np.array([[rpm] * 4 + still_us for rpm in (3000.0, 3000.0, 0.0)])
    assert check.find_violation(time_s, rows) is None
    assert check.find_violation(time_s[:1] + 0.03, rows[2:]) is None
    assert check.find_violation(time_s[:2] + 0.06, rows[[2, 0]]) is not None


def test_limits_without_a_channel_are_named():
    told = format_unmonitored_limits(LOOP_CHANNELS, RIG.n_rotors)
    missing = [name for name in ("voltage_V", "current_A", "temperature_degC")
               if name not in [channel.name for channel in LOOP_CHANNELS]]  # fmt: skip
    assert told.endswith(f"{', '.join(missing)}: the rig's limits on them are not monitored")
    whole = [Channel(name, "N") for name in ("thrust_N", "voltage_V", "current_A",
                                             "temperature_degC", "rpm1")]  # fmt: skip
    assert format_unmonitored_limits(whole, 1) == ""
    assert format_unmonitored_limits(whole, 2).startswith("no channel rpm2: ")


@pytest.mark.parametrize(
    ("rpm", "thrust_N", "stops"),
    [
        # Of four rotors at 2000 rpm k sum w^2 gives 1.81 N; 5 % of the cell's rating on top.
        (2000.0, lambda expected_N, margin_N: 3.5 * expected_N + margin_N + 0.06, True),
        (2000.0, lambda expected_N, margin_N: 3.5 * expected_N + margin_N - 0.06, False),
        (4512.0, lambda expected_N, margin_N: 0.2 * expected_N - margin_N - 0.06, True),
        (4512.0, lambda expected_N, margin_N: 0.2 * expected_N - margin_N + 0.06, False),
    ],
)
def test_the_band_of_plausible_thrust(rpm, thrust_N, stops):
    square = 4.0 * (rpm * np.pi / 30.0) ** 2
    expected_N = RIG.propulsion.thrust_coefficient_N_s2 * square
    shown_N = thrust_N(expected_N, 0.05 * RIG.limits.load_cell_rating_N)
    when_s, error = stopped_at_s(TOGETHER, [rpm] * 4, shown_N, 1500.0)
    assert (error is not None) == stops
    assert when_s < 1.0 or not stops


def test_one_implausible_reading_among_good_ones_is_borne():
    check = LimitCheck(CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    check.record_command(np.full(4, 1500.0), 0.0)
    for step in range(200):
        time_s = 0.05 * step + 0.01 * np.arange(1, 6)
        rows = np.array([[*[4512.0] * 4, thrust_N] for thrust_N in (9.2, 9.2, -5.0, 9.3, 9.3)])
        assert check.find_violation(time_s, rows) is None


@pytest.mark.parametrize(("share", "limit_N"), [(1.1, 1.0), (-1.1, -1.0)])
def test_a_reading_beyond_a_limit_names_the_limit_on_its_side(share, limit_N):
    check = LimitCheck(CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    rated_N = RIG.limits.thrust_N
    error = check.find_violation(np.array([0.1]), np.array([[0.0] * 4 + [share * rated_N]]))
    assert isinstance(error, LimitExceeded)
    assert (error.value, error.limit) == (share * rated_N, limit_N * rated_N)


def test_the_last_reading_of_a_block_is_held_against_the_pulse():
    check = LimitCheck(CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    check.record_command(np.full(4, 1500.0), 0.0)
    time_s = 3.0 + 0.01 * np.arange(1, 6)
    rows = np.array([[rpm] * 4 + [0.0] for rpm in (0.0, 0.0, 50.0, 400.0, 4512.0)])
    assert check.find_violation(time_s, rows) is None
    error = check.find_violation(time_s + 0.05, rows[::-1])
    assert error is not None
    assert error.value == 0.0


PLATE_FIRST = (Channel("plate_z_m", "m"), *CHANNELS[:4])


@pytest.mark.parametrize(
    ("more_us", "more_m", "stops"), [(1.0, -1e-6, True), (0.0, -1e-6, False), (1.0, 1e-6, False)]
)
def test_a_plate_inside_the_least_gap_stops_motors_that_turn(more_us, more_m, stops):
    check = LimitCheck(PLATE_FIRST, RIG, RIG.limits, 1.0, 0.0)
    check.record_command(np.full(4, RIG.propulsion.pwm_stop_us + more_us), 0.0)
    nearest_m = RIG.plate.z_min_m - plate_tolerance_m(RIG)
    rows = np.array([[np.nan, *[0.0] * 4], [nearest_m + more_m, *[0.0] * 4]])
    assert (check.find_violation(np.array([0.1, 0.2]), rows) is not None) == stops


def test_a_load_cell_is_not_stuck_while_nobody_reads_it():
    check = LimitCheck(CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    check.record_command(np.full(4, 1500.0), 0.0)
    found = []
    for time_s in (*np.arange(0.1, 2.5, 0.1), *np.arange(9.0, 11.0, 0.1)):
        row = np.array([[*[4512.0 + time_s] * 4, 9.2]])
        found.append(check.find_violation(np.array([time_s]), row))
    stuck = [float(number) for number, error in enumerate(found) if error is not None]
    # 2.3 s before the pause and 0.7 s after it, each counted from the reading before.
    assert stuck[0] == pytest.approx(24 + 7, abs=1.1)


def test_thrust_is_not_implausible_while_nobody_reads_it():
    check = LimitCheck(CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    check.record_command(np.full(4, 1500.0), 0.0)
    times_s = [*np.arange(0.1, 0.45, 0.1), *np.arange(9.0, 10.0, 0.1)]
    row = np.array([[*[4512.0] * 4, -5.0]])
    found = [check.find_violation(np.array([time_s]), row + 0.01 * time_s) for time_s in times_s]
    # 0.6 s, of which 0.4 s were before the pause.
    assert [error is not None for error in found].index(True) == 7


@pytest.mark.parametrize("number", range(5))
def test_a_channel_that_falls_silent_is_named(number):
    check = LimitCheck(CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    row = np.array([0.0, 0.0, 0.0, 0.0, 0.0])
    for step in range(1, 300):
        shown = row + 0.01 * np.sin(step)
        shown[number] = shown[number] if step <= 100 else np.nan
        error = check.find_violation(np.array([0.01 * step]), shown[None, :])
        if error is not None:
            break
    assert step == 201  # a reading may be as old as 1 s
    assert str(error).startswith(f"silence of {CHANNELS[number].name} in s read 1.01, limit 1;")
