"""Recording files: CSV or Parquet with a JSON file of the provenance, or MCAP.

MCAP files are for Foxglove and PlotJuggler. Each row is one Protocol Buffers message: every channel
a double, a column of labels an enum. The schema's comments and the channel's metadata contain units
and calibration; a metadata record contains the provenance. All fields are always written, so
messages have one length (https://mcap.dev/spec, https://protobuf.dev/programming-guides).
"""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel
from benchtool.core.errors import BenchtoolError, FileFormatError, WouldOverwrite
from benchtool.core.recording import Recording
from benchtool.core.toml_text import build_dataclass, parse_json
from benchtool.core.units import Array
from benchtool.core.user_file import MAX_METADATA_BYTES, check_columns, check_decoded, open_file
from benchtool.data.atomic import atomic_writer, file_hash, make_folder, read_json, replace_json
from benchtool.data.columns import WORDS
from benchtool.data.parquet import load_extra, read_parquet, read_stream, write_parquet
from benchtool.data.run.run_metadata import RECORDING_SCHEMA, check_format
from benchtool.data.table import read_own_table

FORMAT = "benchtool-recording-1"


def metadata_path(path: Path) -> Path:
    """Return the path of the JSON file of a recording."""
    return path.with_name(f"{path.name}.json")


def read_recording_facts(path: Path) -> dict[str, Any]:
    """Return the contents of the JSON file of a recording, checked."""
    json_path = metadata_path(path)
    facts = read_json(json_path)
    check_format(facts, FORMAT, str(json_path))
    build_dataclass(RECORDING_SCHEMA, facts, str(json_path))
    return facts


def write_recording(
    path: Path, recording: Recording, facts: Mapping[str, Any], *, overwrite: bool = False
) -> None:
    """Write a .csv or .parquet file, then its JSON file with hash and `facts`, each atomically."""
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise FileFormatError(
            str(path), f"suffix {suffix!r} is not supported; allowed: .csv, .parquet"
        )
    if not overwrite:
        for target in (path, metadata_path(path)):
            if target.exists():
                raise WouldOverwrite(str(target))
    make_folder(path.parent)
    (_write_csv if suffix == ".csv" else write_parquet)(path, recording)
    channels = [{"name": item.name, "unit": item.unit} for item in recording.channels]
    replace_json(
        metadata_path(path),
        {
            "format": FORMAT,
            "sha256": file_hash(path),
            "rows": len(recording),
            "simulated": recording.simulated,
            "channels": channels,
            "provenance": dict(recording.provenance),
            **facts,
        },
    )


def read_recording(path: str | Path) -> Recording:
    """Return a recording of `write_recording` with its provenance, or that of an MCAP file."""
    path = Path(path)
    if not path.is_file():
        raise FileFormatError(str(path), "there is no such recording; check the path")
    if path.suffix.lower() == ".mcap":
        return read_mcap(path)
    facts = read_recording_facts(path)
    if facts.get("sha256") != file_hash(path):
        raise FileFormatError(
            str(path), "it has changed since it was written; import it again or restore a backup"
        )
    if path.suffix.lower() == ".csv":
        try:
            recording, _ = read_stream(path, None)
        except BenchtoolError:  # fallback for text or another format; errors name the line
            recording, _ = read_own_table(path)
    else:
        recording = read_parquet(path)
    units = {str(item["name"]): str(item["unit"]) for item in facts["channels"]}
    return replace(
        recording,
        channels=tuple(Channel(name, units.get(name, "")) for name in recording.names),
        provenance={str(key): str(value) for key, value in facts["provenance"].items()},
        simulated=bool(facts["simulated"]),
    )


def _write_csv(path: Path, recording: Recording) -> None:
    """Write with pyarrow without loss of precision; nan is an empty cell."""
    import pyarrow as pa
    from pyarrow import csv

    columns = [pa.array(values, from_pandas=True) for values in recording.values.T]
    # Readers skip a line of empty cells only, so its first cell is the text nan.
    is_nan = np.isnan(recording.values)
    first = np.ascontiguousarray(recording.values[:, 0])
    columns[0] = pa.array(first, mask=is_nan[:, 0] & ~is_nan.all(axis=1))
    table = pa.table(columns, names=list(recording.names))
    with atomic_writer(path, path.with_name(f".{path.name}.new")) as file:
        file.write(f"{','.join(recording.names)}\n".encode())
        csv.write_csv(table, file, csv.WriteOptions(include_header=False, quoting_style="none"))


MCAP_FORMAT = "benchtool-mcap-1"
MAGIC = b"\x89MCAP0\r\n"
SCHEMA = "benchtool.Recording"
TOPIC = "/benchtool/recording"

CHUNK_BYTES = 4 << 20  # uncompressed messages of a chunk; assumed

_DEFINITIONS = (b"\x03", b"\x04")  # opcodes of schema and channel, before the first message
_LENGTH_BYTES = 9  # opcode and length of a record, not counted in the length

_HEAD_BYTES = _LENGTH_BYTES + 22  # channel, sequence and two times


def write_mcap(
    path: Path,
    recording: Recording,
    *,
    start_ns: int = 0,
    calibration: Mapping[str, Any] | None = None,
) -> None:
    """Write a recording atomically; `start_ns` is the Unix time of its `time_s` 0."""
    mcap = load_extra("mcap.writer", "mcap", "an MCAP file")
    names = [channel.name for channel in recording.channels]
    extra = {"calibration": json.dumps(dict(calibration))} if calibration else {}
    units = {f"unit:{channel.name}": channel.unit for channel in recording.channels}
    facts = {
        "format": MCAP_FORMAT,
        "rows": str(len(recording)),
        "channels": json.dumps([[channel.name, channel.unit] for channel in recording.channels]),
        "simulated": str(recording.simulated).lower(),
        "provenance": json.dumps(dict(recording.provenance)),
        **extra,
    }
    layout = _layout(names)
    size, rows = layout.itemsize, max(1, CHUNK_BYTES // layout.itemsize)
    time_s = recording.column("time_s") if "time_s" in recording else np.zeros(len(recording))
    since_ns = np.round(np.nan_to_num(time_s) * 1e9).astype(np.int64)
    times_ns = np.maximum(since_ns + start_ns, 0)
    with atomic_writer(path, path.with_name(f".{path.name}.new")) as file:
        writer = mcap.Writer(file, chunk_size=CHUNK_BYTES)
        writer.start(library="benchtool")
        schema = writer.register_schema(SCHEMA, "protobuf", _descriptor(recording, extra))
        channel = writer.register_channel(TOPIC, "protobuf", schema, units | extra)
        writer.add_metadata("benchtool", facts)
        for first in range(0, len(recording), rows):
            values = recording.values[first : first + rows]
            records = np.zeros(len(values), layout)
            for index, name in enumerate(names):
                records[f"t{index}"] = _tag(index, name in WORDS)
                records[f"v{index}"] = values[:, index]
            data = records.tobytes()
            for row, time_ns in enumerate(times_ns[first : first + rows].tolist()):
                message = data[row * size + _HEAD_BYTES : (row + 1) * size]
                sequence = (first + row) & 0xFFFFFFFF
                writer.add_message(channel, time_ns, message, time_ns, sequence)
        writer.finish()


def _tag(index: int, is_word: bool) -> NDArray[np.uint8]:
    """Return the tag of a field: number and wire type, as a varint."""
    number = (index + 1) << 3 | (0 if is_word else 1)
    coded = [number] if number < 128 else [number & 127 | 128, number >> 7]
    return np.array(coded, np.uint8)


def _layout(names: list[str]) -> np.dtype[Any]:
    """Return the memory layout of a message record; at most 2,047 fields."""
    fields: list[Any] = [("head", "u1", (_HEAD_BYTES,))]
    for index, name in enumerate(names):
        fields.append((f"t{index}", "u1", (len(_tag(index, name in WORDS)),)))
        fields.append((f"v{index}", "u1" if name in WORDS else "<f8"))
    return np.dtype(fields)


def _descriptor(recording: Recording, comments: Mapping[str, str]) -> bytes:
    """Return the schema: a FileDescriptorSet with units and calibration as comments."""
    pb = load_extra("google.protobuf.descriptor_pb2", "mcap", "an MCAP file")
    file = pb.FileDescriptorProto(name="benchtool.proto", package="benchtool", syntax="proto3")
    message = file.message_type.add(name=SCHEMA.partition(".")[2])
    about = file.source_code_info.location.add(path=[4, 0], span=[0, 0, 0])
    about.leading_comments = "; ".join(f"{key}: {text}" for key, text in comments.items())
    for index, channel in enumerate(recording.channels):
        is_name = re.fullmatch(r"[A-Za-z]\w*", channel.name, re.ASCII)
        name = channel.name if is_name else f"channel{index + 1}"
        field = message.field.add(name=name, json_name=name, number=index + 1, label=1, type=1)
        if channel.name in WORDS:
            field.type, field.type_name = 14, f".{SCHEMA}.{channel.name.capitalize()}"
            enum_type = message.enum_type.add(name=channel.name.capitalize())
            for code, word in enumerate(WORDS[channel.name]):
                enum_type.value.add(name=f"{channel.name}_{word}".upper(), number=code)
        unit = file.source_code_info.location.add(path=[4, 0, 2, index], span=[0, 0, 0])
        unit.trailing_comments = f"unit: {channel.unit}"
    data: bytes = pb.FileDescriptorSet(file=[file]).SerializeToString()
    return data


def read_mcap(path: Path) -> Recording:
    """Return a recording written by `write_mcap`."""
    load_extra("mcap.records", "mcap", "an MCAP file")
    from mcap.exceptions import McapError

    where = str(path)
    facts: dict[str, str] = {}
    try:
        with open_file(path) as file:
            chunks = _chunks(file, facts, where)
            next(chunks)  # reads the metadata, which precede the first chunk
            names_units = parse_json(facts["channels"], where)
            channels = tuple(Channel(str(name), str(unit)) for name, unit in names_units)
            check_columns(len(channels), where)
            rows = int(facts["rows"])
            check_decoded(rows, len(channels), where)
            values = _values(chunks, channels, rows, where)
    except (McapError, KeyError, ValueError, TypeError, EOFError, struct.error) as error:
        reason = " ".join(str(error).split())[:160]
        raise FileFormatError(where, f"it is damaged ({reason}); restore it from a copy") from error
    provenance = {str(k): str(v) for k, v in parse_json(facts["provenance"], where).items()}
    return Recording(channels, values, provenance, facts.get("simulated") == "true")


def _chunks(file: Any, facts: dict[str, str], where: str) -> Iterator[bytes]:
    """Fill `facts` and yield empty bytes once, then the raw bytes of each chunk.

    The library's reader would create an object for every entry of the message indexes.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.records import Metadata

    if file.read(len(MAGIC)) != MAGIC:
        raise FileFormatError(where, "this is not an MCAP file")
    while len(head := file.read(_LENGTH_BYTES)) == _LENGTH_BYTES:
        opcode, length = head[0], int.from_bytes(head[1:], "little")
        if opcode == 0x0C and length < MAX_METADATA_BYTES:
            record = Metadata.read(ReadDataStream(BytesIO(file.read(length))))
            if record.name == "benchtool":
                facts |= record.metadata
                yield b""
        elif opcode == 0x06 and facts.get("format") == MCAP_FORMAT:
            if length > 2 * CHUNK_BYTES:
                raise ValueError(f"a chunk of {length} bytes")
            yield file.read(length)
        elif opcode in (0x0F, 0x06):
            break
        else:
            file.seek(length, 1)
    if facts.get("format") != MCAP_FORMAT:
        message = "this MCAP file was not written by benchtool, which reads only its own"
        raise FileFormatError(where, message)


def _values(chunks: Iterator[bytes], channels: tuple[Channel, ...], rows: int, where: str) -> Array:
    import zstandard
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk

    names = [channel.name for channel in channels]
    layout, start = _layout(names), 0
    values = np.empty((rows, len(names)))

    def messages_in(data: bytes) -> NDArray[Any]:
        chunk = Chunk.read(ReadDataStream(BytesIO(data)))
        try:
            plain = zstandard.ZstdDecompressor().decompress(
                chunk.data, max_output_size=2 * CHUNK_BYTES
            )
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error
        if zlib.crc32(plain) != chunk.uncompressed_crc:
            raise FileFormatError(where, "a checksum in it is wrong; restore it from a copy")
        offset = 0
        while plain[offset : offset + 1] in _DEFINITIONS:
            offset += _LENGTH_BYTES + int.from_bytes(plain[offset + 1 : offset + 9], "little")
        return np.frombuffer(plain, layout, offset=offset)

    for messages in map(messages_in, chunks):
        end = start + len(messages)
        for index, name in enumerate(names):
            ends = messages[f"t{index}"][:: max(1, len(messages) - 1)]
            if (ends != _tag(index, name in WORDS)).any():
                raise ValueError(f"field {name} is at a wrong position")
            values[start:end, index] = messages[f"v{index}"]
        start = end
    if start != rows:
        raise FileFormatError(where, f"it contains {start} of {rows} rows; restore it from a copy")
    return values
