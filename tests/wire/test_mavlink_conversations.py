"""Exact conversations with an autopilot: frames out expected, frames in prepared."""

from __future__ import annotations

import pytest

from benchtool.bench.identify import PROBE
from benchtool.bench.mavlink.autopilots import ArduPilot, Px4
from benchtool.bench.mavlink.frames import MavCommand, MavlinkFrames, dialect, interval
from benchtool.bench.mavlink.link import MavlinkLink
from benchtool.bench.mavlink.streams import StreamRequest, request_streams
from benchtool.bench.serial.frames import frame
from benchtool.core.errors import InputError, LinkLost, NoDevice, ProtocolError
from tests.doubles.scripted_link import ScriptedLink, Turn

WORDS = dialect()
ACCEPTED, DENIED, UNSUPPORTED = 0, 2, 3


class Side:
    """Pack what one end says, numbered as it is said."""

    def __init__(self, system: int, component: int) -> None:
        self._frames = MavlinkFrames(system, component)

    def quadratic(self, *messages: object) -> bytes:
        return b"".join(map(self._frames.pack, messages))


def beat(autopilot: int = 3, mode: int = 1) -> object:
    return WORDS.MAVLink_heartbeat_message(2, autopilot, mode, 0, 3, 3)


def ours() -> object:
    return WORDS.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def command(order: MavCommand) -> object:
    return WORDS.MAVLink_command_long_message(1, 1, order.command, 0, *order.parameters)


def ack(order: MavCommand, result: int = ACCEPTED) -> object:
    return WORDS.MAVLink_command_ack_message(order.command, result, 0, 0, 255, 190)


def ask(name: str) -> object:
    return WORDS.MAVLink_param_request_read_message(1, 1, name.encode(), -1)


def talk_on(link: ScriptedLink) -> MavlinkLink:
    return MavlinkLink(link, "mavlink:scripted", link.clock, MavlinkFrames())


def met(*turns: Turn, host: Side, device: Side) -> tuple[MavlinkLink, ScriptedLink]:
    """Give a conversation in which system 1 was found already."""
    link = ScriptedLink(Turn(host.quadratic(ours()), device.quadratic(beat())), *turns)
    station = talk_on(link)
    station.find(1)
    return station, link


def test_a_quiet_autopilot_is_found_by_its_heartbeat_and_asked():
    host, device = Side(255, 190), Side(1, 1)
    asked = interval("SERVO_OUTPUT_RAW", 50.0)
    opening = Turn(host.quadratic(ours()), device.quadratic(beat()))
    link = ScriptedLink(opening, Turn(host.quadratic(command(asked)), device.quadratic(ack(asked))))
    station = talk_on(link)
    assert station.find(1).autopilot == 3
    assert station.exchange(asked) == ACCEPTED
    assert asked.parameters[:2] == (36.0, 20000.0)
    link.check_finished()


def test_an_acknowledgement_that_got_lost_is_asked_for_again():
    host, device = Side(255, 190), Side(1, 1)
    pulses = ArduPilot().pulses({"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0})
    turn_it = ArduPilot().turn({2: 1150.0}, pulses)[0]
    assert turn_it.parameters == (2.0, 1.0, 1150.0, 0.25, 1.0, 0.0, 0.0)
    said = WORDS.MAVLink_statustext_message(6, b"something else", 0, 0)
    station, link = met(host=host, device=device)
    link._turns += [
        Turn(host.quadratic(command(turn_it)), device.quadratic(said)),
        Turn(host.quadratic(command(turn_it)), device.quadratic(ack(turn_it))),
    ]
    assert station.exchange(turn_it) == ACCEPTED
    link.check_finished()


def test_no_acknowledgement_at_all_is_a_lost_link():
    host, device = Side(255, 190), Side(1, 1)
    stop = ArduPilot().stop((1, 2))[0]
    assert stop.parameters[3] == 0.0
    station, link = met(host=host, device=device)
    link._turns += [Turn(host.quadratic(command(stop))) for _ in range(4)]
    said = r"did not acknowledge command 209, sent 4 times in 0\.4 s"
    with pytest.raises(LinkLost, match=said):
        station.exchange(stop, (0.1,) * 4)
    link.check_finished()


def test_a_message_that_it_has_not_is_denied_with_its_words():
    host, device = Side(255, 190), Side(1, 1)
    asked = interval("RAW_RPM", 20.0)
    words = WORDS.MAVLink_statustext_message(4, b"No ap_message for mavlink id (339)", 0, 0)
    answer = device.quadratic(beat()), device.quadratic(ack(asked, DENIED), words)
    link = ScriptedLink(
        Turn(host.quadratic(ours()), answer[0]), Turn(host.quadratic(command(asked)), answer[1])
    )
    station = talk_on(link)
    station.find(1)
    received: list[str] = []
    station.on_message = lambda message, _: received.append(message.msgname)
    assert station.exchange(asked) == DENIED
    assert received == ["COMMAND_ACK", "STATUSTEXT"]
    link.check_finished()


def test_denied_and_accepted_but_silent_are_told_apart():
    host, device = Side(255, 190), Side(1, 1)
    wanted = (
        StreamRequest("SERVO_OUTPUT_RAW", 50.0),
        StreamRequest("RPM", 20.0),
        StreamRequest("RAW_RPM", 20.0),
    )
    orders = [interval(request.name, request.rate_Hz) for request in wanted]
    outputs = WORDS.MAVLink_servo_output_raw_message(1000, 0, *[1000] * 8)
    station, link = met(host=host, device=device)
    link._turns += [
        Turn(host.quadratic(command(orders[0])), device.quadratic(ack(orders[0]))),
        Turn(host.quadratic(command(orders[1])), device.quadratic(ack(orders[1]), outputs)),
        Turn(host.quadratic(command(orders[2])), device.quadratic(ack(orders[2], DENIED))),
        # A second of listening: our own heartbeat, and the outputs once more.
        Turn(host.quadratic(ours()), device.quadratic(outputs)),
    ]
    counts = dict.fromkeys((request.name for request in wanted), 0)

    def count(message: object, _: float) -> None:
        counts[message.msgname] = counts.get(message.msgname, 0) + 1

    station.on_message = count
    states = request_streams(station, wanted, counts, speed=1.0)
    assert states == {
        "SERVO_OUTPUT_RAW": "comes",
        "RPM": "accepted, but nothing comes",
        "RAW_RPM": "denied",
    }
    link.check_finished()


def test_an_unknown_parameter_gets_no_answer_and_is_left_out():
    host, device = Side(255, 190), Side(1, 1)
    told = WORDS.MAVLink_param_value_message(b"MOT_PWM_MIN", 1000.0, 9, 900, 65535)
    station, link = met(host=host, device=device)
    link._turns += [
        Turn(host.quadratic(ask("MOT_PWM_MIN")), device.quadratic(told)),
        Turn(host.quadratic(ask("NO_SUCH"))),
        Turn(host.quadratic(ask("NO_SUCH"))),
    ]
    assert station.read_parameters(("MOT_PWM_MIN", "NO_SUCH")) == {"MOT_PWM_MIN": 1000.0}
    link.check_finished()


def test_a_whole_number_of_px4_comes_bit_by_bit():
    host, device = Side(255, 190), Side(1, 1)
    # 4 as the bits of a float.
    told = WORDS.MAVLink_param_value_message(b"CA_ROTOR_COUNT", 5.605193857299268e-45, 6, 9, 1)
    station, link = met(host=host, device=device)
    link._turns.append(Turn(host.quadratic(ask("CA_ROTOR_COUNT")), device.quadratic(told)))
    assert station.read_parameters(("CA_ROTOR_COUNT",)) == {"CA_ROTOR_COUNT": 4.0}
    assert Px4().n_motors({"CA_ROTOR_COUNT": 4.0}) == 4


def test_several_autopilots_are_listed_and_one_is_chosen():
    beats = (
        Side(1, 1).quadratic(beat())
        + Side(7, 1).quadratic(beat(12))
        + Side(9, 154).quadratic(beat(8))
    )
    opening = Turn(Side(255, 190).quadratic(ours()), beats)
    link = ScriptedLink(opening, *_beats_of_ours(4))
    with pytest.raises(InputError, match=r"has 2 autopilots, systems 1, 7; choose one with sys"):
        talk_on(link).find(None)
    chosen = talk_on(ScriptedLink(opening))
    assert chosen.find(7).autopilot == 12
    absent = ScriptedLink(opening, *_beats_of_ours(6))
    with pytest.raises(InputError, match=r"has no system 3; it has 1, 7"):
        talk_on(absent).find(3)


@pytest.mark.parametrize(
    ("received", "words"),
    [
        (frame(b"E,boot,ready"), "speaks the bench protocol, not MAVLink; use a serial:"),
        (b"\r\nGrbl 1.1h ['$' for help]\r\n", "is a G-code stage"),
        (b"nsh> \r\nnsh> ", "another device, or the autopilot's console"),
        (bytes(range(128, 250)) + b"\xfd\x80\x01", "the baud rate is wrong, or another program"),
        (bytes(range(128, 240)), "the baud rate is wrong"),
    ],
)
def test_strangers_are_told_apart(received, words):
    link = ScriptedLink(Turn(Side(255, 190).quadratic(ours()), received), *_beats_of_ours(6))
    with pytest.raises(ProtocolError, match=words):
        talk_on(link).find(None)


def test_silence_names_power_and_port():
    beats = _beats_of_ours(4)
    link = ScriptedLink(Turn(Side(255, 190).quadratic(ours())), *beats, Turn(PROBE))
    with pytest.raises(NoDevice, match="is open, but nothing came for 5 s; check power"):
        talk_on(link).find(None)


def _beats_of_ours(count: int) -> list[Turn]:
    """Give the heartbeats that a host sends while it waits, after its first."""
    host = Side(255, 190)
    host.quadratic(ours())
    return [Turn(host.quadratic(ours())) for _ in range(count)]


def test_what_is_meant_for_another_ground_station_is_passed_over():
    host, device = Side(255, 190), Side(1, 1)
    stop = ArduPilot().stop((1,))[0]
    other = WORDS.MAVLink_command_ack_message(209, 4, 0, 0, 250, 190)
    station, link = met(host=host, device=device)
    link._turns.append(Turn(host.quadratic(command(stop)), device.quadratic(other, ack(stop))))
    assert station.exchange(stop) == ACCEPTED
    link.check_finished()
