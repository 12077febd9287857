"""A bench behind a virtual autopilot: what it proves, and what ends a run."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.bench.mavlink.bench import MavlinkBench
from benchtool.bench.mavlink.frames import MavlinkFrames
from benchtool.bench.mavlink.messages import MavCommand
from benchtool.bench.mavlink.pilots import ArduPilot
from benchtool.bench.mavlink.settings import MavlinkSettings, MotorMap
from benchtool.core.errors import (
    CommandRefused,
    DeviceStopped,
    HostPaused,
    InputError,
    LinkLost,
    ProtocolError,
    StageError,
)
from benchtool.core.rig_file import rig_named
from benchtool.testing.loopback_link import LoopbackLink
from benchtool.virtual.autopilot import VirtualAutopilot
from benchtool.virtual.firmware import Firmware
from tests.wire.still_plant import StillPlant, still_hello

PLUS = MotorMap(rig="two", autopilot="ArduPilot", motors=(1, 2), outputs=(3, 1), escs=(3, 1))
KEY = bytes(range(32))


class Cell:
    """A load cell on a port of its own: ten counts for every second of the common clock."""

    baud = None

    def __init__(self, link: LoopbackLink) -> None:
        self._link, self._reported = link, 0

    def open(self) -> None:
        self._reported = 0

    def read(self, timeout_s: float) -> bytes:
        self._link.pass_time(timeout_s) if timeout_s else None
        told, self._reported = self._reported, int(self._link.now_s * 50)
        return b"HX711 reading: %d\n" % (10 * self._link.now_s) if told != self._reported else b""

    def close(self) -> None:
        """Do nothing."""


class Bench:
    """Give a bench, the virtual autopilot behind it, and the time of both."""

    def __init__(self, kind: str = "ardupilot", plant: StillPlant | None = None, **given) -> None:
        self.kind = kind
        key = given.pop("device_key", None)
        self.autopilot = self.booted(plant or StillPlant(), key)
        self.link = LoopbackLink(self.autopilot, lambda: 100.0, baud=given.pop("baud", None))
        settings = MavlinkSettings(**{"system": 1, **given})
        cell = Cell(self.link) if settings.cell else None
        self.bench = MavlinkBench(
            self.link,
            "mavlink:loop",
            settings,
            clock=self.link.clock,
            since_1970_s=lambda: 1.7e9,
            cell=cell,
        )

    def booted(self, plant: StillPlant, key: bytes | None = None) -> VirtualAutopilot:
        hello = still_hello(simulated=True)
        return VirtualAutopilot(Firmware(plant, hello), self.kind, key=key, now_s=1.7e9)

    def read(self, seconds: float) -> tuple[np.ndarray, list[str]]:
        """Read for so long; return values (m, c) and messages."""
        parts, messages = [], []
        until_s = self.bench.now_s() + seconds
        while (left_s := until_s - self.bench.now_s()) > 1e-9:
            readings = self.bench.read(min(left_s, 0.05))
            parts.append(readings.values)
            messages.extend(readings.messages)
        return np.concatenate(parts), messages

    def last(self, values: np.ndarray, name: str) -> float:
        names = [channel.name for channel in self.bench.identity.channels]
        column = values[:, names.index(name)]
        return float(column[np.isfinite(column)][-1])


def pulses(*given: float) -> np.ndarray:
    return np.array(given)


def test_the_map_says_which_output_is_which_rotor() -> None:
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        bench.set_pwm(pulses(1000.0, 1300.0))
        values, messages = made.read(0.5)
        assert made.autopilot.outputs_us[:4] == (1300, 1000, 1000, 1000)
        assert made.last(values, "pwm2_us") == 1300.0
        assert made.last(values, "pwm1_us") == 1000.0
        assert not [text for text in messages if "hangs on" in text]


def test_a_rotor_that_turns_alone_shows_its_output() -> None:
    made = Bench()
    with made.bench as bench:
        assert bench.identity.n_rotors == 4
    made = Bench(rotors=2)
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        values, messages = made.read(0.5)
        assert "rotor 1 hangs on output 3" in messages
        assert made.last(values, "pwm1_us") == 1300.0
        assert made.last(values, "pwm2_us") == 1000.0


def test_an_order_is_renewed_while_somebody_reads_and_dies_when_nobody_does() -> None:
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(2.0)
        assert max(made.autopilot.outputs_us) == 1300
        made.link.pass_time(0.2)
        assert max(made.autopilot.outputs_us) == 1300
        made.link.pass_time(0.1)
        assert max(made.autopilot.outputs_us) == 1000
        # The order is too old to be sent again: it would start a motor that stands.
        with pytest.raises(HostPaused, match=r"did not run benchtool for 0\.\d s, limit 0\.25 s"):
            made.read(1.0)
        made.read(1.0)
        assert max(made.autopilot.outputs_us) == 1000


def test_no_order_is_sent_after_a_pause_while_its_acknowledgement_was_waited_for() -> None:
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        send, sent = made.link.write, []

        def lose_and_stand_still(data: bytes) -> None:
            """Lose the first order; the computer is suspended while its answer is waited for."""
            sent.append(data)
            if len(sent) == 1:
                made.link.pass_time(2.0)

        made.link.write = lose_and_stand_still  # type: ignore[method-assign]
        with pytest.raises(HostPaused, match=r"did not run benchtool for 2\.0 s, limit 0\.25 s"):
            bench.set_pwm(pulses(1300.0, 1000.0))
        assert len([data for data in sent if data[7:10] == b"L\0\0"]) == 1  # COMMAND_LONG
        made.link.write = send  # type: ignore[method-assign]
        bench.stop()
        made.read(1.0)
        assert max(made.autopilot.outputs_us) == 1000


def test_an_order_that_is_acknowledged_and_ignored_ends_the_run() -> None:
    ninth = MotorMap(rig="two", autopilot="ArduPilot", motors=(9, 2), outputs=(3, 1), escs=(3, 1))
    made = Bench(motor_map=ninth)
    said = r"commanded 1300 us and ArduPilot acknowledged it, but output 3 shows 1000 us after 0\.3"
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        begun_s = bench.now_s()
        with pytest.raises(DeviceStopped, match=said):
            made.read(2.0)
        assert bench.now_s() - begun_s < 0.4
        made.read(0.2)  # told once; afterwards it reads on


def test_ardupilot_turns_one_motor_at_a_time_and_says_so() -> None:
    made = Bench(motor_map=PLUS)
    with made.bench as bench, pytest.raises(InputError, match="motors 1, 2 cannot turn together"):
        bench.set_pwm(pulses(1300.0, 1300.0))


def test_px4_turns_several_together() -> None:
    straight = MotorMap(rig="two", autopilot="PX4", motors=(1, 2), outputs=(1, 2), escs=(1, 2))
    made = Bench("px4", motor_map=straight)
    with made.bench as bench:
        assert bench.identity.firmware.startswith("PX4")
        bench.set_pwm(pulses(1300.0, 1500.0))
        made.read(0.5)
        assert made.autopilot.outputs_us[:2] == (1300, 1500)
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(0.5)
        assert made.autopilot.outputs_us[:2] == (1300, 1000)
        bench.stop()
        made.read(0.2)
        assert made.autopilot.outputs_us[:2] == (1000, 1000)


def test_messages_that_do_not_come_are_told() -> None:
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        facts = bench.identity.facts
        _, messages = made.read(0.2)
    assert facts["messages denied"] == "ESC_STATUS RAW_RPM"
    assert facts["messages accepted, but nothing comes"] == "RPM"
    assert facts["messages comes unasked"] == "NAMED_VALUE_FLOAT"
    assert "RPM: accepted, but nothing comes" in messages
    assert "RAW_RPM: denied" in messages
    assert not [text for text in messages if "No ap_message" in text]


def check_ends(made: Bench, break_it: Callable[[], object], said: str, kind=DeviceStopped) -> None:
    """Turn a rotor, break something, and see that the run ends with the motors at zero."""
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(1.0)
        break_it()
        with pytest.raises(kind, match=said):
            made.read(6.0)
        assert max(made.autopilot.outputs_us) in (0, 1000)


def test_a_restart_ends_the_run() -> None:
    made = Bench(motor_map=PLUS)

    made.link.pass_time(5.0)
    check_ends(
        made,
        lambda: made.autopilot.restart(made.link.now_s),
        r"the autopilot restarted|sent nothing for 1\.0 s",
        (DeviceStopped, LinkLost),
    )


def test_a_failsafe_ends_the_run_with_its_words() -> None:
    plant = StillPlant()
    made = Bench(motor_map=PLUS, plant=plant)

    def overload() -> None:
        plant.zero_N = -1000.0

    check_ends(made, overload, "Failsafe: thrust_N 100.* against limit 30; motors stopped")


def test_disarming_ends_the_run() -> None:
    made = Bench(motor_map=PLUS)

    def disarm() -> None:
        order = MavlinkFrames(250)._mav.command_long_encode(1, 1, 400, 0, 0, 21196, 0, 0, 0, 0, 0)
        made.autopilot.receive(MavlinkFrames(250).pack(order), made.link.now_s)
        made.link.pass_time(0.02)
        assert max(made.autopilot.outputs_us) == 1300

    check_ends(made, disarm, "the autopilot disarmed")


def test_missing_heartbeats_end_the_run_though_streams_go_on() -> None:
    made = Bench(motor_map=PLUS)
    said = r"sends, but no heartbeat came for 5\.\d s, limit 5\.5 s"
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(0.5)
        made.autopilot._beat_s = 1e9
        with pytest.raises(LinkLost, match=said):
            made.read(8.0)


def test_silence_ends_the_run() -> None:
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(0.5)
        made.autopilot.tick = lambda n, now_s: (b"", [])
        made.autopilot.receive = lambda data, now_s: b""
        with pytest.raises(LinkLost, match=r"sent nothing for 1\.0 s, limit 1 s"):
            made.read(3.0)


def test_a_refused_order_carries_mavlinks_word() -> None:
    made = Bench("px4", motor_map=PLUS)
    made.autopilot._orders.order = lambda *_: 1
    with made.bench as bench, pytest.raises(CommandRefused, match="TEMPORARILY_REJECTED"):
        bench.set_pwm(pulses(1300.0, 1000.0))
    assert max(made.autopilot.outputs_us) == 1000


def test_a_tare_is_the_hosts() -> None:
    plant = StillPlant()
    plant.zero_N = -0.7
    made = Bench(motor_map=PLUS, plant=plant)
    with made.bench as bench:
        assert made.last(made.read(0.5)[0], "thrust_N") == pytest.approx(0.7)
        bench.tare()
        values, _ = made.read(2.0)
        assert made.last(values, "thrust_N") == pytest.approx(0.0, abs=1e-6)
        assert made.last(values, "thrust_raw") == pytest.approx(0.7)


def make_real(made: Bench) -> None:
    """Let the heartbeat not say any more that no motor turns."""
    beat = made.autopilot._heartbeat

    def real() -> object:
        message = beat()
        message.base_mode &= ~32
        return message

    made.autopilot._heartbeat = real


def test_a_slow_line_carries_less_and_says_so() -> None:
    made = Bench(motor_map=PLUS, baud=38400)
    make_real(made)
    with made.bench as bench:
        assert bench.identity.rate_Hz == 25.0
        _, messages = made.read(0.3)
        assert "outputs come at 25 Hz instead of 50: the link runs at 38,400 baud" in messages
        with pytest.raises(InputError, match=r"bytes/s x 10 bits = 1\d\d,\d{3} baud, but the link"):
            bench.set_rate(200.0)
    made = Bench(motor_map=PLUS, baud=9600)
    make_real(made)
    with pytest.raises(InputError, match="outputs at 10 Hz and what comes with them are"):
        made.bench.open()


def test_the_plate_of_a_real_autopilot_needs_a_stage() -> None:
    made = Bench(motor_map=PLUS)
    make_real(made)
    with made.bench as bench:
        assert not bench.identity.simulated
        assert not bench.identity.moves_plate
        with pytest.raises(StageError, match="give --stage hand or --stage grbl:PORT"):
            bench.move_plate(0.2)


def test_signed_frames_are_taken_and_others_refused() -> None:
    signed = Bench(motor_map=PLUS, key=KEY, device_key=KEY)
    with signed.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        values, _ = signed.read(0.5)
        assert signed.last(values, "pwm1_us") == 1300.0
    for theirs in (None, bytes(32)):
        other = Bench(motor_map=PLUS, key=KEY, device_key=theirs)
        with pytest.raises(ProtocolError, match="none of it bears a signature of this key"):
            other.bench.open()


def test_an_unsigned_order_turns_nothing_on_a_signed_autopilot() -> None:
    made = Bench(motor_map=PLUS, device_key=KEY)
    with pytest.raises(ProtocolError, match=r"signs its frames .* give its key as key=FILE"):
        made.bench.open()
    host = MavlinkFrames()
    order = host._mav.command_long_encode(1, 1, 209, 0, 1, 1, 1300, 3.0, 1, 0, 0)
    made.autopilot.receive(host.pack(order), 0.0)
    made.link.pass_time(0.2)
    assert max(made.autopilot.outputs_us) == 1000


def test_link_quality_counts_messages_and_losses() -> None:
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        made.read(1.0)
        tick = made.autopilot.tick
        made.autopilot.tick = lambda n, now_s: (tick(n, now_s)[0], [])
        made.link.pass_time(0.1)
        made.autopilot.tick = tick
        made.link.pass_time(0.1)
        readings = [bench.read(0.05) for _ in range(5)]
        lost = sum(part.lost for part in readings)
        facts = bench.identity.facts
    assert 10 < lost < 30
    assert facts["link_lost"].startswith(f"{lost} of ")
    assert float(facts["link_jitter_ms"]) > 0.0


def test_a_load_cell_beside_the_autopilot_is_laid_on_its_time() -> None:
    made = Bench(motor_map=PLUS, cell=("/dev/cell", 57600), thrust_scale_N=0.1)
    with made.bench as bench:
        names = [channel.name for channel in bench.identity.channels]
        parts = [bench.read(0.05) for _ in range(100)]
    time_s = np.concatenate([part.time_s for part in parts])
    device_us = np.concatenate([part.device_time_us for part in parts])
    raw = np.concatenate([part.values[:, names.index("thrust_raw")] for part in parts])
    thrust_N = np.concatenate([part.values[:, names.index("thrust_N")] for part in parts])
    assert np.all(np.diff(device_us) > 0)
    told = np.isfinite(raw)
    assert told.sum() > 40
    # The count says when it was read: whole tenths of a second.
    assert np.all(np.abs(time_s[told] - raw[told] / 10.0) < 0.11)
    np.testing.assert_allclose(thrust_N[told], 0.1 * raw[told])


def test_an_autopilot_that_does_not_tell_its_outputs_is_refused() -> None:
    made = Bench(motor_map=PLUS)
    made.autopilot._orders.lacks = made.autopilot._orders.lacks | {36}
    said = r"does not report its outputs \(SERVO_OUTPUT_RAW denied, ACTUATOR_OUTPUT_STATUS denied\)"
    with pytest.raises(ProtocolError, match=said):
        made.bench.open()


class LossyLink(LoopbackLink):
    """Lose a share of the frames of both directions."""

    def __init__(self, device: VirtualAutopilot, share: float, rng: np.random.Generator) -> None:
        super().__init__(device, lambda: 100.0)
        self.share, self._rng = share, rng

    def write(self, data: bytes) -> None:
        if self._rng.random() >= self.share:
            super().write(data)

    def read(self, timeout_s: float) -> bytes:
        data, kept = super().read(timeout_s), b""
        while data:
            size = 12 + data[1]
            if self._rng.random() >= self.share:
                kept += data[:size]
            data = data[size:]
        return kept


def test_a_link_that_loses_every_tenth_frame_ends_no_run(rng: np.random.Generator) -> None:
    made = Bench(motor_map=PLUS)
    made.link = LossyLink(made.autopilot, 0.0, rng)
    made.bench = MavlinkBench(
        made.link, "mavlink:lossy", MavlinkSettings(motor_map=PLUS), clock=made.link.clock
    )
    with made.bench as bench:
        made.link.share = 0.1
        lost = 0
        for pulse_us in (1300.0, 1000.0, 1400.0):
            bench.set_pwm(pulses(pulse_us, 1000.0))
            until_s = bench.now_s() + 10.0
            while bench.now_s() < until_s:
                lost += bench.read(0.05).lost
                assert made.autopilot.outputs_us[2] == pulse_us
        assert lost > 100
        assert made.autopilot.outputs_us[2] == 1400


def test_orders_that_get_lost_are_not_called_a_disarming() -> None:
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(0.9)
        made.autopilot.receive = lambda data, now_s: b""
        said = r"ArduPilot acknowledged no order for 0\.\d s and output 3 shows 1000 us"
        with pytest.raises(DeviceStopped, match=said):
            made.read(2.0)


def test_streams_that_nobody_here_asks_for_are_switched_off_on_a_serial_line() -> None:
    made = Bench(motor_map=PLUS, baud=57600)
    make_real(made)
    made.autopilot._every_us = {30: 20_000.0}  # ATTITUDE, of a host that has left
    made.autopilot._due_us = {30: 0.0}
    with made.bench:
        _, messages = made.read(0.5)
        assert "switched off, because nobody here asks for it: ATTITUDE" in messages
        assert 30 not in made.autopilot._every_us


def test_another_motor_waits_until_the_outputs_show_the_stop_of_the_first() -> None:
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(0.5)
        bench.set_pwm(pulses(1000.0, 1400.0))
        made.read(0.5)
        assert made.autopilot.outputs_us[:4] == (1400, 1000, 1000, 1000)
        # A stop that is acknowledged and not carried out lets nothing else turn.
        order = made.autopilot._orders.order
        made.autopilot._orders.order = lambda command, given, now_s: (
            0 if given[3] == 0.0 else order(command, given, now_s)
        )
        made.autopilot._orders.end = lambda: None
        with pytest.raises(DeviceStopped, match="outputs do not show it after 1 s; no motor was"):
            bench.set_pwm(pulses(1300.0, 1000.0))
        assert made.autopilot.outputs_us[2] == 1000


@pytest.mark.parametrize("timeout_s", [-1.0, 0.3, float("nan"), float("inf")])
def test_no_order_to_turn_can_last(timeout_s: float) -> None:
    with pytest.raises(InputError, match=r"was not made, limits 0 and 0\.25 s"):
        MavCommand(209, (1.0, 1.0, 1300.0, timeout_s, 1.0, 0.0, 0.0))


@pytest.mark.parametrize("pulse_us", [999.0, 1901.0, 2200.0, float("nan")])
def test_pulses_outside_of_the_autopilots_range_are_refused(pulse_us: float) -> None:
    range_us = ArduPilot().pulses({"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 1900.0})
    with pytest.raises(InputError, match=r"range is 1000 to 1900 us \(MOT_PWM_MIN to MOT_PWM_MAX"):
        ArduPilot().turn({1: pulse_us}, range_us)
    made = Bench(motor_map=PLUS)
    with made.bench as bench, pytest.raises(InputError, match="were not sent"):
        bench.set_pwm(pulses(pulse_us, 1000.0))


def answer_late(made: Bench, delay_s: float) -> None:
    """Let every answer come so much later than the order is carried out."""
    receive, tick = made.autopilot.receive, made.autopilot.tick
    waiting: list[tuple[float, bytes]] = []

    def late_receive(data: bytes, now_s: float) -> bytes:
        waiting.append((now_s + delay_s, receive(data, now_s)))
        return b""

    def late_tick(n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        ready = [answer for due_s, answer in waiting if due_s <= now_s]
        waiting[:] = [one for one in waiting if one[0] > now_s]
        news, samples = tick(n, now_s)
        return b"".join(ready) + news, samples

    made.autopilot.receive, made.autopilot.tick = late_receive, late_tick


@pytest.mark.parametrize("delay_s", [0.7, 2.5])
def test_a_late_acknowledgement_alone_ends_nothing(delay_s: float) -> None:
    made = Bench(rotors=1)
    with GuardedBench(made.bench, rig_named("pquad_single")) as guard:
        assert guard.identity.longest_delay_s == pytest.approx(0.3)
        answer_late(made, delay_s)
        guard.set_pwm(pulses(1000.0))
        assert guard.identity.longest_delay_s == pytest.approx(delay_s, abs=0.1)
        made.bench.set_pwm(pulses(1300.0))
        made.read(2.0)
        assert made.autopilot.outputs_us[2] == 1300


@pytest.mark.parametrize("mode", ["plate", "pitch"])
def test_only_orders_that_lapse_end_by_a_short_silence(mode: str) -> None:
    made = Bench(rotors=1, mode=mode, arm="host")
    made.autopilot._hover_us = 1300.0
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0))
        made.read(1.0)
        tick = made.autopilot.tick
        begun_s = made.link.now_s

        def silent(n: int, now_s: float) -> tuple[bytes, list[bytes]]:
            said = tick(n, now_s)
            return said if now_s - begun_s > 0.6 else (b"", [])

        receive = made.autopilot.receive

        def deaf(data: bytes, now_s: float) -> bytes:
            said = receive(data, now_s)
            return said if now_s - begun_s > 0.6 else b""

        made.autopilot.tick, made.autopilot.receive = silent, deaf
        if mode == "plate":
            with pytest.raises(DeviceStopped, match=r"came from the autopilot for 0\.\d s while a"):
                made.read(0.9)
        else:
            made.read(0.9)
