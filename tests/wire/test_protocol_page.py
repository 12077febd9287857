"""The protocol's page tells the truth: its conversation, its test vector, its C code."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from benchtool.bench.serial.commands import decode_command
from benchtool.bench.serial.frames import Decoder, crc16
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.server import DeviceLink
from tests.wire.still_plant import StillPlant, still_hello

PAGE = (Path(__file__).parents[2] / "docs/reference/bench-protocol.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    (found,) = re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    return str(found)


def replayed(page: str) -> list[str]:
    """Say the host's lines to the device, let the times pass, and write down what happens."""
    device = DeviceLink(Firmware(StillPlant(), still_hello()))
    told: list[str] = []
    tick = 0
    for line in page.splitlines():
        if line.startswith("> "):
            told.append(line)
            answer = device.receive(line[2:].encode() + b"\n", tick / 100)
            told += [f"< {text}" for text in answer.decode().splitlines()]
        elif line.startswith("-- "):
            told.append(line)
            for _ in range(int(line.split()[1]) // 10):
                tick += 1
                events, samples = device.tick(1, tick / 100)
                shown = b"".join(samples) if "not shown" not in line else b""
                told += [f"< {text}" for text in (shown + events).decode().splitlines()]
    return told


def test_the_conversation_is_what_the_device_says():
    conversation = block("text")
    assert replayed(conversation) == conversation.splitlines()


def test_every_line_of_the_conversation_is_whole():
    lines = [line for line in block("text").splitlines() if line[0] in "<>"]
    decoder = Decoder(5)
    batch = decoder.feed("".join(line[2:] + "\n" for line in lines).encode())
    assert batch.corrupt == 0
    messages = decoder.take_messages()
    assert len(messages) + len(batch.values) == len(lines)
    for message in messages:
        if message.letter == "C":
            _, name, time, *values = message.fields
            decode_command((name, time) if name == "hello" else (name, *values))


def test_the_vector():
    assert "`123456789` is `29B1`" in PAGE
    assert crc16(b"123456789") == 0x29B1


MAIN = r"""
int main(void)
{
    char good[] = "noise$C,4,tare*EF53", bad[] = "$C,4,tare*EF54", none[] = "Grbl 1.1h";
    send_line("123456789");
    send_sample(65535, 4294967295UL, 1200, 1, 4.25);
    send_sample(0, 9999, 1200, 0, 0.0);
    puts(take_line(good));
    puts(take_line(bad) ? "taken" : "refused");
    puts(take_line(none) ? "taken" : "refused");
    return 0;
}
"""


@pytest.mark.skipif(os.name != "posix" or not shutil.which("cc"), reason="needs a C compiler")
def test_the_c_code_speaks_the_protocol(tmp_path):
    source, program = tmp_path / "device.c", tmp_path / "device"
    source.write_text(block("c") + MAIN, encoding="utf-8")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["cc", *flags, "-o", str(program), str(source)], check=True)
    lines = subprocess.run([str(program)], capture_output=True, check=True).stdout.splitlines(True)
    assert lines[0] == b"$123456789*29B1\n"
    batch = Decoder(2).feed(b"".join(lines[1:3]))
    assert batch.values[:, 0].tolist() == [1200.0, 1200.0]
    assert batch.values[0, 1] == 4.25
    assert batch.values[1, 1] != batch.values[1, 1]
    assert (batch.lost, batch.corrupt) == (0, 0)
    assert lines[3:] == [b"C,4,tare\n", b"refused\n", b"refused\n"]
