"""Addresses lead to the bench they name, and to nothing else."""

import pytest

from benchtool.bench.drivers import open_bench, parse_address
from benchtool.bench.serial.bench import SerialBench
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.virtual.simulated import SimulatedBench

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
    ("text", "place", "options"),
    [
        ("sim:pquad?seed=3&rate=500", "pquad", {"seed": "3", "rate": "500"}),
        ("serial:/dev/ttyUSB0?baud=2000000", "/dev/ttyUSB0", {"baud": "2000000"}),
        ("serial:COM12", "COM12", {}),
        (r"serial:\\.\COM12", r"\\.\COM12", {}),
        (r"serial:\\?\usb#vid_0403?baud=9600", r"\\?\usb#vid_0403", {"baud": "9600"}),
        ("tcp:[::1]:5555", "[::1]:5555", {}),
        ("replay:C:/runs/2026-01-31-first", "C:/runs/2026-01-31-first", {}),
    ],
)
def test_an_address_is_split_into_its_parts(text, place, options):
    address = parse_address(text)
    assert (address.place, dict(address.options)) == (place, options)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("usb:1", "known: mavlink, rcbudp, replay, serial, sim, tcp"),
        ("/dev/ttyUSB0", "sim:pquad"),
        ("pquad", "sim:pquad"),
        ("", "sim:pquad"),
        ("sim:", "names no place"),
        ("sim:pquad?sede=3", "did you mean 'seed'"),
        ("sim:pquad?seed=x", "not a number"),
        ("sim:pquad?seed=1.5", "not a whole number"),
        ("sim:pquad?seed=-1", "outside 0"),
        ("sim:pquad?rate=nan", "outside 1 to 5000"),
        ("sim:pquad?seed", "name=value"),
        ("sim:pquod", "did you mean 'pquad'"),
        ("serial:COM3?baud=fast", "not a number"),
        ("tcp:5555", "host and port"),
        ("tcp:localhost:70000", "host and port"),
        ("tcp:localhost:", "host and port"),
        ("mavlink:usb:1", "unknown link of address"),
        ("mavlink:udpin:host:port", "needs host and port; write for example mavlink:udpin:127"),
        ("mavlink:serial:", "names no port"),
        ("mavlink:udpin:14550?system=0", "outside 1 to 255"),
        ("mavlink:udpin:14550?mode=yaw", "unknown mode of address"),
        ("mavlink:udpin:14550?rate=5", "outside 10 to 1000"),
        ("mavlink:udpin:14550?map=no-such-file.toml", "make one with benchtool bench map"),
        ("mavlink:udpin:14550?key=no-such-file", "no-such-file: there is no such file"),
        ("mavlink:udpin:14550?colour=red", "known: arm, cell, distance"),
        ("rcbudp:127.0.0.1", "needs host and port of the GUI; write for example rcbudp:127"),
        ("rcbudp:127.0.0.1:99999", "needs host and port of the GUI"),
        ("rcbudp:127.0.0.1:55047?listen=70000", "outside 0 to 65535"),
        ("rcbudp:127.0.0.1:55047?colour=red", "known: listen, thrust_scale"),
    ],
)
def test_a_wrong_address_says_what_is_wrong(text, said):
    with pytest.raises(InputError, match=said) as caught:
        open_bench(text)
    assert "\n" not in str(caught.value)


def test_ports_are_not_opened_before_they_are_entered():
    for text in ("serial:/dev/there_is_no_such_port", "serial:COM12", "tcp:127.0.0.1:1"):
        assert isinstance(open_bench(text), SerialBench)


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


def test_an_unknown_flaw_is_refused_with_the_known_ones(tmp_path):
    path = tmp_path / "bent.toml"
    path.write_text(TRUTH.replace("thrust_noise_N", "noise_N"), encoding="utf-8")
    with pytest.raises(UnknownChoice, match="thrust_noise_N"):
        open_bench(f"sim:pquad?truth={path}")
