"""What our driver does with the bytes of a real ArduCopter 4.6.2, and what it asks of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from benchtool.acquire.bench_check import CheckResult, check_bench, detect_motor_map
from benchtool.bench.bench import Readings
from benchtool.bench.mavlink.bench import MavlinkBench
from benchtool.bench.mavlink.drive import classify_status_text
from benchtool.bench.mavlink.frames import MOTOR_TEST, Message
from benchtool.bench.mavlink.settings import MavlinkSettings, MotorMap
from benchtool.core.errors import BenchError, CommandRefused, DeviceStopped, LinkLost
from benchtool.core.rig_file import load_rig_by_name
from tests.wire.recorded_autopilot import (
    RecordedPeer,
    chunks_of,
    facts_of,
    folder_of,
    messages_of,
    parser_of,
    texts_of,
)

PQUAD = MotorMap(
    rig="pquad", autopilot="ArduPilot", motors=(1, 4, 3, 2), outputs=(3, 2, 4, 1), escs=(3, 2, 4, 1)
)
STOP = np.full(4, 1000.0)


@pytest.fixture(scope="module")
def folder(reference_data):
    return folder_of(reference_data)


def opened(
    folder: Path,
    name: str,
    free_after_s: float = math.inf,
    until_s: float = math.inf,
    **given: object,
) -> tuple[RecordedPeer, MavlinkBench]:
    """Give the peer of a conversation and our bench on it, not opened yet."""
    chunks = [chunk for chunk in chunks_of(folder, name) if chunk.time_s < until_s]
    peer = RecordedPeer(chunks, free_after_s)
    settings = MavlinkSettings(**{"motor_map": PQUAD, "speeds": False, **given})  # type: ignore[arg-type]
    bench = MavlinkBench(
        peer, "mavlink:recorded", settings, clock=peer.clock, since_1970_s=lambda: 1.7e9
    )
    return peer, bench


def pulse(rotor: int, pulse_us: float) -> np.ndarray:
    """Give the pulses of one rotor that turns alone."""
    pulses = STOP.copy()
    pulses[rotor - 1] = pulse_us
    return pulses


def read(bench: MavlinkBench, seconds: float) -> list[Readings]:
    """Read for so long."""
    parts, until_s = [], bench.now_s() + seconds
    while (left_s := until_s - bench.now_s()) > 1e-9:
        parts.append(bench.read(min(left_s, 0.05)))
    return parts


def shown(bench: MavlinkBench, parts: list[Readings], name: str) -> np.ndarray:
    column = [channel.name for channel in bench.identity.channels].index(name)
    values = np.concatenate([part.values[:, column] for part in parts])
    return values[np.isfinite(values)]


def orders_of(peer: RecordedPeer) -> list[tuple[float, Message]]:
    """Give the motor tests that our host ordered."""
    return [
        (time_s, message)
        for time_s, message in peer.sent
        if message.get_type() == "COMMAND_LONG" and message.command == MOTOR_TEST
    ]


INFORMATION = {
    "PreArm: ", "Arm: ", "Radio Failsafe Cleared", "Battery 1 is low", "starting motor test",
    "finished motor test", "Disarming motors", "Arming motors", "No ap_message", "ArduCopter V",
    "Frame: ", "AHRS: ", "EKF3 ", "GPS 1: ", "Barometer ", "RC7: ", "Requested rate",
    "e SCHED_LOOP_RATE", "ServoRelayEvent: ", "3d1219c7c4c5404aaa1f6d2a48adfda4",
}  # fmt: skip
OTHERS = {
    "Battery Failsafe - Disarming": "failsafe",
    "Radio Failsafe - Disarming": "failsafe",
    "Motor Test: Safety switch": "refusal",
    "Motor Test: Motor Emergency Stopped": "refusal",
    "Motor Test: RC not calibrated": "refusal",
    "Motor Test: Board initialising": "restart",
    "ArduPilot Ready": "restart",
}


def test_every_recorded_text_means_what_it_should(folder):
    met = set()
    for severity, component, text in texts_of(facts_of(folder)):
        assert component == 1
        known = [start for start in INFORMATION if text.startswith(start)]
        expected = OTHERS.get(text) or ("information" if known else "not classified yet")
        assert classify_status_text(text, severity) == expected, text
        met |= {text if text in OTHERS else start for start in [*known, text]}
    assert met >= INFORMATION | set(OTHERS)


@pytest.mark.parametrize("number", range(1, 7))
def test_a_rotor_turns_stops_and_the_run_goes_on(folder, number):
    peer, bench = opened(folder, f"r{number}_turn_2s_and_stop")
    with bench:
        bench.set_pwm(pulse(1, 1300.0))
        turned = read(bench, 1.8)
        bench.set_pwm(STOP)
        still = read(bench, 1.0)
        assert {1300.0} <= set(shown(bench, turned, "pwm1_us")) <= {1000.0, 1300.0}
        assert bench.outputs_us()[:4] == (1000, 1000, 1000, 1000)
        assert set(shown(bench, still, "pwm2_us")) == {1000.0}
    assert "finished motor test" in [text for part in still for text in part.messages]
    assert sum(part.lost for part in turned + still) == 0
    assert all(0.0 <= order.param4 <= 0.25 for _, order in orders_of(peer))


def test_the_first_motor_is_stopped_before_another_one_turns(folder):
    # Recorded with a driver that did not, so that both turned: ours waits for the outputs.
    for name in ("q2_other_rotor_without_a_stop", "q2_other_rotor_without_a_stop_patched"):
        peer, bench = opened(folder, name)
        with bench:
            bench.set_pwm(pulse(1, 1300.0))
            read(bench, 1.4)
            with pytest.raises(BenchError):
                bench.set_pwm(pulse(2, 1250.0))
        motors = [(order.param1, order.param4) for _, order in orders_of(peer)]
        first_stop = next(at for at, (_, timeout_s) in enumerate(motors) if timeout_s == 0.0)
        assert {motor for motor, timeout_s in motors if timeout_s > 0.0} == {1.0}
        assert set(motors[first_stop:]) == {(1.0, 0.0)}


def test_a_refusal_is_told_in_the_autopilots_words(folder):
    _, bench = opened(folder, "j2_check_safety_switch_on", speeds=True)
    with bench:
        with pytest.raises(CommandRefused, match=r"DO_MOTOR_TEST .*: Motor Test: Safety switch"):
            bench.set_pwm(STOP)
        # Without a pulse, not with that of a standing motor.
        assert set(shown(bench, read(bench, 0.2), "pwm1_us")) == {0.0}


def test_orders_to_turn_end_when_the_autopilot_falls_silent(folder):
    peer, bench = opened(folder, "h1_autopilot_killed_and_restarted", until_s=4.0)
    with bench:
        bench.set_pwm(pulse(1, 1400.0))
        with pytest.raises(LinkLost, match=r"sent nothing for 1\.0 s, limit 1 s; no motor command"):
            read(bench, 6.0)
    turning = [time_s for time_s, order in orders_of(peer) if order.param4 > 0.0]
    assert 0.2 < max(turning) - peer.said_s < 0.3


def test_an_autopilot_that_starts_anew_is_called_so_and_gets_no_order(folder):
    peer, bench = opened(folder, "h1_autopilot_killed_and_restarted", free_after_s=3.62)
    with bench:
        bench.set_pwm(pulse(1, 1400.0))
        with pytest.raises(DeviceStopped, match="the run was ended: the autopilot restarted"):
            read(bench, 6.0)
        ended_s = peer.now_s
        with pytest.raises(BenchError):
            bench.set_pwm(pulse(1, 1400.0))
        bench.stop()
    assert not [order for time_s, order in orders_of(peer) if time_s >= ended_s]


def test_a_restart_by_command_is_noticed_at_rest(folder):
    name = "h2_reboot_command"
    parser, health = parser_of(), []
    for chunk in chunks_of(folder, name):
        if not chunk.host:
            health += [
                classify_status_text(message.text, message.severity)
                for message in messages_of(chunk.data, parser)
                if message.get_type() == "STATUSTEXT"
            ]
    assert "restart" in health


@pytest.mark.parametrize("name", ["g1_companion_own_clock", "g1_companion_own_clock_patched"])
def test_a_companion_with_a_clock_of_its_own_is_no_restart(folder, name):
    _, bench = opened(folder, name)
    with bench:
        bench.set_pwm(pulse(1, 1300.0))
        turned = read(bench, 0.04)
        bench.set_pwm(STOP)
        turned += read(bench, 0.1)
        thrust_N = shown(bench, turned, "thrust_N")
    assert thrust_N.size
    assert sum(part.lost for part in turned) == 0
    time_s = np.concatenate([part.time_s for part in turned])
    assert np.all(np.diff(time_s) > 0.0)
    assert time_s[-1] - time_s[0] < 0.4


@pytest.mark.parametrize(
    "name", ["g2_companion_distance_unasked", "g2_companion_distance_unasked_patched",
             "g3_rangefinder_streams_unasked"]
)  # fmt: skip
def test_a_distance_that_nobody_asked_for_is_left_aside(folder, name):
    _, bench = opened(folder, name)
    with bench:
        assert "plate_z_m" not in [channel.name for channel in bench.identity.channels]


def test_only_escs_that_tell_something_have_a_speed(folder):
    _, bench = opened(folder, "c2_sweep_telemetry_on_some_patched", speeds=True)
    with bench:
        names = {channel.name for channel in bench.identity.channels}
    assert {"rpm1", "rpm3"} <= names
    assert not {"rpm2", "rpm4"} & names
    _, bench = opened(folder, "c3_sweep_telemetry_on_all_patched", speeds=True)
    with bench:
        names = {channel.name for channel in bench.identity.channels}
    assert {"rpm1", "rpm2", "rpm3", "rpm4", "voltage_V", "current_A"} <= names


def check_of(folder: Path, name: str, **given: object) -> list[CheckResult]:
    """Give the findings of a bench check with the peer of a conversation."""
    _, bench = opened(folder, name, **given)
    with bench:
        return list(check_bench(bench, load_rig_by_name("pquad")))


def test_a_bench_check_passes_with_speeds(folder):
    findings = check_of(folder, "a1_check_with_telemetry_patched", speeds=True)
    assert len(findings) == 2 + 2 * 4
    assert [finding.text for finding in findings if not finding.passed] == []


def test_a_bench_check_passes_without_speeds_and_says_so(folder):
    findings = check_of(folder, "a2_check_rpm_none_patched")
    assert [finding.text for finding in findings if not finding.passed] == []
    assert "no speed channel for rotors 1, 2, 3, 4" in findings[0].text
    assert findings[2].text == "pwm1_us reads 1185 us of 1185 us; its speed is not measured"


@pytest.mark.parametrize(
    ("name", "asked", "motors"),
    [
        ("b1_map_without_motors_patched", [0, 3, 2, 1], (1, 4, 3, 2)),
        ("b2_map_with_motors_patched", [0, 3, 2, 1], (1, 4, 3, 2)),
    ],
)
def test_the_map_is_what_eyes_and_outputs_say(folder, name, asked, motors):
    _, bench = opened(folder, name, motor_map=None, speeds=True, rotors=4)
    with bench:
        found = detect_motor_map(
            bench, load_rig_by_name("pquad"), lambda motor: asked[motor - 1], print
        )
    assert found.motors == motors
    assert found.outputs == (3, 2, 4, 1)


@pytest.mark.parametrize(
    "name",
    ["k1_57600_check", "k2_57600_serial_check", "k4_57600_uart_check",
     "k5_57600_uart_serial_check", "l1_through_mavproxy"],
)  # fmt: skip
def test_a_slow_line_and_a_router_start_a_motor(folder, name):
    # What was recorded of them ends here: "starting motor test" had ended the run.
    _, bench = opened(folder, name, speeds=True)
    with bench:
        bench.set_pwm(STOP)
        read(bench, 0.5)
        bench.set_pwm(pulse(1, 1185.0))
        assert bench.outputs_us()[2] in (1000, 1185)


def test_an_acknowledgement_that_takes_long_ends_nothing(folder):
    # Behind MAVProxy on a busy machine the first one came after the host had given up.
    peer, bench = opened(folder, "l1_through_mavproxy_patched", speeds=True)
    with bench:
        bench.set_pwm(STOP)
        assert len(orders_of(peer)) > 1
        read(bench, 0.3)


def test_every_conversation_of_ours_opens_with_all_that_its_streams_promise(folder):
    opened_ones = 0
    for name, facts in facts_of(folder).items():
        command = str(facts.get("command", ""))
        if "mavlink:" not in command:
            continue
        mapped = {} if "bench map" not in command else {"motor_map": None, "rotors": 4}
        _, bench = opened(folder, name, speeds="rpm=none" not in command, **mapped)
        with bench:
            names = {channel.name for channel in bench.identity.channels}
            parts = read(bench, 0.3)
        assert {"pwm1_us", "pwm4_us", "voltage_V", "current_A"} <= names, name
        assert ("thrust_N" in names) is (name[:2] in ("a3", "a4") or name[0] in "cg"), name
        assert not {"plate_z_m", "theta_rad"} & names, name
        assert sum(part.lost for part in parts) == 0, name
        opened_ones += 1
    assert opened_ones == 44
