"""Addresses lead to the bench they name, and to nothing else."""

from dataclasses import replace

import pytest

from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.operator import Unattended
from benchtool.acquire.session import run_experiment
from benchtool.bench.drivers import (
    DRIVERS,
    LOOPBACK,
    GrblAddress,
    MavlinkAddress,
    ReplayAddress,
    SerialAddress,
    SimAddress,
    TcpAddress,
    open_bench,
    parse_address,
    parse_stage,
)
from benchtool.core.errors import InputError
from benchtool.core.inputs import build_inputs
from benchtool.core.user_code import check_code_allowed
from benchtool.virtual.links import ServedLink
from benchtool.virtual.simulated_bench import SimulatedBench

TRUTH = """
[model]
name = "bent"
rig = "pquad"

[effects.tare_offset]
thrust_N = { value = 0.4, source = "test" }

[imperfections]
thrust_noise_N = 0.0
start_offset_N = 2.0
"""


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("sim:pquad?seed=3&rate=500", SimAddress(rig="pquad", seed=3, rate_Hz=500.0)),
        ("serial:/dev/ttyUSB0?baud=9600", SerialAddress(port="/dev/ttyUSB0", baud=9600)),
        ("serial:COM12", SerialAddress(port="COM12", baud=2_000_000)),
        (r"serial:\\.\COM12", SerialAddress(port=r"\\.\COM12")),
        (r"serial:\\?\usb#vid?baud=9600", SerialAddress(port=r"\\?\usb#vid", baud=9600)),
        ("tcp:[::1]:5555", TcpAddress(host="::1", port=5555)),
        ("replay:C:/runs/first", ReplayAddress(run="C:/runs/first")),
        (
            "mavlink:tcp:5760?system=7&cell=COM3:38400&distance=on",
            MavlinkAddress(
                link="tcp", host=LOOPBACK, port=5760, system=7, cell="COM3:38400", distance="on"
            ),
        ),
        (
            "mavlink:serial:/dev/ttyACM0:57600",
            MavlinkAddress(link="serial", serial_port="/dev/ttyACM0", baud=57600),
        ),
    ],
)
def test_an_address_is_parsed_into_typed_values(text, address):
    assert parse_address(text) == replace(address, text=text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("usb:1", f"known: {', '.join(sorted(DRIVERS))}"),
        ("/dev/ttyUSB0", "sim:pquad"),
        ("sim:pquad?sede=3", "did you mean 'seed'"),
        ("sim:pquad?seed=x", "seed .* 'x'"),
        ("sim:pquad?seed=1&seed=1", "seed .* twice"),
        ("sim:pquad?rate=nan", "rate .* nan, allowed is 1 to 5,000"),
        ("sim:pquad?seed", "name=value"),
        ("sim:pquod", "did you mean 'pquad'"),
        ("sim:pquad?schedule=plate", "schedule .* is for mode=pitch"),
        (f"sim:{'p' * 1024}", "1,028 characters; allowed: up to 1,024"),
        ("serial:COM3?baud=fast", "baud .* 'fast'"),
        (f"serial:COM3?baud={'1' * 900}", "baud .* allowed is 1,200 to 12,000,000"),
        ("tcp:5555", "host and port"),
        (f"tcp:localhost:{'1' * 900}", "host and port"),
        ("mavlink:usb:1", "unknown link of address"),
        ("mavlink:udpin:host:port", "needs host and port, .* example: mavlink:udpin:127"),
        ("mavlink:udpin:14550?system=0", "system .* 0, allowed is 1 to 255"),
        ("mavlink:udpin:14550?map=no-such-file.toml", "make one with benchtool bench map"),
        ("mavlink:udpin:14550?colour=red", "known: arm, cell, distance"),
    ],
)
def test_a_wrong_address_says_what_is_wrong(text, said):
    with pytest.raises(InputError, match=said) as caught:
        open_bench(text)
    assert "\n" not in str(caught.value)


GRBL = "grbl:/dev/x"


def test_a_stage_is_parsed_into_typed_values():
    assert parse_stage("hand") == "hand"
    text = f"{GRBL}?axis=X&zero_mm=1500.5&direction=-1&lateral=Z&lateral_zero_mm=-3&baud=9600"
    assert parse_stage(text) == GrblAddress(
        text=text, port="/dev/x", baud=9600, axis="X", zero_mm=1500.5, direction=-1,
        lateral="Z", lateral_zero_mm=-3.0,
    )  # fmt: skip
    plain = GrblAddress(text=GRBL, port="/dev/x", axis="Z", zero_mm=None, direction=1)
    assert parse_stage(GRBL) == plain


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("feet", "unknown stage 'feet'.* known: device, grbl:PORT, hand, none"),
        ("grbl:", "is incomplete"),
        (f"{GRBL}?axis=Z&zero_mm=1500&direction=1&lateral=Z", "axis and lateral .* both Z"),
        (f"{GRBL}?direction=0", "direction .* is 0; write 1 or -1"),
        (f"{GRBL}?zero_mm=1500&zero_mm=1400", "zero_mm .* twice"),
        (f"{GRBL}?zero_mm", "name=value"),
        (f"{GRBL}?axis=A", "unknown axis of address .* 'A'.* known: X, Y, Z"),
        (f"{GRBL}?tilt=A", "unknown option of grbl: addresses 'tilt'"),
    ],
)
def test_a_wrong_stage_is_refused_in_a_dry_run_too(option, said):
    given = {"address": "serial:/dev/none", "rig": "pquad_single", "stage": option, "dry_run": True}
    inputs = build_inputs(
        SweepInputs, {**given, "z_over_r": "2", "pwm": "1500"}, base=SweepInputs()
    )
    with pytest.raises(InputError, match=said):
        run_experiment(inputs, Unattended(), check_code_allowed)


DIGITS = "1" * 5000


@pytest.mark.parametrize(
    "text",
    [
        *("", "usb", "tcp:", "tcp:x", "tcp:99999", "pty:1", "mavlink:usb:1", "mavlink:pty:1"),
        *(DIGITS, f"tcp:{DIGITS}", f"mavlink:tcp:{DIGITS}"),
        *("mavlink:udpout:127.0.0.1:99999", "mavlink:udpout:127.0.0.1:0"),
    ],
    ids=lambda text: text[:30],
)
def test_a_wrong_link_is_refused_with_the_known_ones(text):
    with pytest.raises(InputError, match=r"0 .any. to 65535; allowed: pty, tcp:PORT") as caught:
        ServedLink.parse(text)
    assert len(str(caught.value)) < 300


def test_a_simulated_address_reads_its_truth_and_flaws(tmp_path):
    path = tmp_path / "bent.toml"
    path.write_text(TRUTH, encoding="utf-8")
    bench = open_bench(f"sim:pquad?seed=3&rate=400&truth={path}")
    assert isinstance(bench, SimulatedBench)
    with bench:
        assert bench.identity.facts["truth"] == "bent"
        assert bench.identity.rate_Hz == 400.0
        names = [channel.name for channel in bench.identity.channels]
        thrust = bench.read(2.0).values[:, names.index("thrust_N")]
    assert thrust[~(thrust != thrust)].mean() == pytest.approx(2.4, abs=0.005)
