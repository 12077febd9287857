"""Recordings as MCAP files: what other readers see, and what comes back."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import benchtool as bt
from benchtool.core.channel import Channel
from benchtool.core.errors import BenchtoolError, FileFormatError
from benchtool.core.recording import Recording
from benchtool.data.columns import PHASES, find_channel
from benchtool.data.run import recording_file
from benchtool.data.run.recording_file import read_mcap, write_mcap


def recording(rows: int, extra: int = 0) -> Recording:
    rng = np.random.default_rng(3)
    names = ["time_s", "point", "phase", "thrust_N", "rpm1", *(f"c{i}_V" for i in range(extra))]
    values = rng.normal(size=(rows, len(names)))
    values[:, 0] = np.arange(rows) / 1000.0
    values[:, 1] = np.arange(rows) // 7
    values[:, 2] = np.arange(rows) % len(PHASES)
    values[::3, 3] = np.nan
    values[1::5, 4] = np.resize([0.0, -0.0, 1e-310, np.pi, -1e300], len(values[1::5]))
    channels = (*map(find_channel, names[:5]), *(Channel(name, "V") for name in names[5:]))
    return Recording(channels, values, {"rig": "lab", "sha256": "ab" * 32}, simulated=True)


@pytest.mark.parametrize(("rows", "extra"), [(0, 0), (1, 0), (25, 0), (700, 30)])
def test_what_was_written_comes_back(tmp_path, rows, extra, monkeypatch):
    monkeypatch.setattr(recording_file, "CHUNK_BYTES", 20_000)
    made = recording(rows, extra)
    write_mcap(tmp_path / "a.mcap", made)
    back = read_mcap(tmp_path / "a.mcap")
    assert back.values.tobytes() == made.values.tobytes()
    assert [(message.name, message.unit) for message in back.channels] == [
        (message.name, message.unit) for message in made.channels
    ]
    assert (back.provenance, back.simulated) == (made.provenance, True)


def test_the_format_s_own_reader_sees_messages_units_and_calibration(tmp_path, monkeypatch):
    monkeypatch.setattr(recording_file, "CHUNK_BYTES", 2_000)
    made, path = recording(100), tmp_path / "a.mcap"
    start_ns = 1_790_000_000_000_000_000
    calibration = {"id": "cal-7", "slope_N_per_count": 2e-4}
    write_mcap(path, made, start_ns=start_ns, calibration=calibration)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 100
        assert len(summary.chunk_indexes) > 3
        channel = summary.channels[1]
        assert channel.metadata["unit:thrust_N"] == "N"
        assert json.loads(channel.metadata["calibration"])["id"] == "cal-7"
        assert b"unit: N" in summary.schemas[1].data
        assert b"cal-7" in summary.schemas[1].data
        messages = list(reader.iter_decoded_messages(topics=["/benchtool/recording"]))
    assert len(messages) == 100
    for row, message in enumerate(messages):
        assert message.message.log_time == start_ns + row * 1_000_000
        seen = message.decoded_message
        assert seen.rpm1 == made.values[row, 4]
        assert seen.thrust_N == pytest.approx(made.values[row, 3], abs=0.0, nan_ok=True)
        label = seen.DESCRIPTOR.fields_by_name["phase"].enum_type.values_by_number[seen.phase].name
        assert label == f"PHASE_{PHASES[row % len(PHASES)]}".upper()
    with path.open("rb") as file:
        between = make_reader(file).iter_messages(
            starting_at=start_ns + 50_000_000, ending_before=start_ns + 60_000_000
        )
        assert len(list(between)) == 10


def test_damage_is_one_sentence(tmp_path):
    path = tmp_path / "a.mcap"
    write_mcap(path, recording(500))
    data = path.read_bytes()
    for damaged in (b"", b"nothing", data[:200], data[: len(data) // 2]):
        path.write_bytes(damaged)
        with pytest.raises(BenchtoolError):
            read_mcap(path)
    middle = len(data) // 2
    path.write_bytes(data[:middle] + bytes([data[middle] ^ 255]) + data[middle + 1 :])
    with pytest.raises(FileFormatError):
        read_mcap(path)


def test_another_s_file_is_refused(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/x", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    for read in (read_mcap, bt.read):
        with pytest.raises(FileFormatError, match="not written by benchtool"):
            read(path)
