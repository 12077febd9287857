"""Recordings as MCAP files, which Foxglove and PlotJuggler open, and back without loss.

Each row is one message of Protocol Buffers: every channel a double, a column of words an enum. The
schema carries units and calibration as comments, so does the channel's metadata; a metadata record
carries the provenance. All fields are always written, so messages have one length, and NumPy lays
out thousands of them at once (https://mcap.dev/spec, https://protobuf.dev/programming-guides).
"""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError
from benchtool.core.parsed_text import parse_json
from benchtool.core.recording import Recording
from benchtool.core.table_bounds import check_columns, check_decoded
from benchtool.core.user_file import MOST_FACTS_BYTES, open_file
from benchtool.data.atomic import replacing
from benchtool.data.catalogue.extra import load_extra
from benchtool.data.columns import WORDS

T = TypeVar("T")
R = TypeVar("R")

FORMAT = "benchtool-mcap-1"
MAGIC = b"\x89MCAP0\r\n"
SCHEMA = "benchtool.Recording"
TOPIC = "/benchtool/recording"

CHUNK_BYTES = 4 << 20
"""Of messages, before they are compressed; a choice."""

WORKERS = 2
"""Threads that compress; a choice."""

_HEAD = [("op", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
         ("log", "<u8"), ("publish", "<u8")]  # fmt: skip
_LENGTH_BYTES = 9
"""Opcode and length of a record, which the length leaves out."""


def write_mcap(
    path: Path,
    recording: Recording,
    *,
    start_ns: int = 0,
    calibration: Mapping[str, Any] | None = None,
) -> None:
    """Write a recording in one step.

    Args:
        start_ns: Unix time of its `time_s` 0.
        calibration: of the load cell, as metadata.json has it.

    Raises:
        InputError: the package mcap is not installed.
    """
    load_extra("mcap.records", "mcap", "an MCAP file")
    with replacing(path, path.with_name(f".{path.name}.new")) as file:
        _Writer(file, recording, start_ns, dict(calibration or {})).write()


class _Writer:
    """Write one file: data, then the summary that readers begin with."""

    def __init__(
        self, file: Any, recording: Recording, start_ns: int, calibration: dict[str, Any]
    ) -> None:
        from mcap import records

        self._file, self._recording, self._start_ns = file, recording, start_ns
        names = [channel.name for channel in recording.channels]
        units = {f"unit:{one.name}": one.unit for one in recording.channels}
        stated = {"calibration": json.dumps(calibration)} if calibration else {}
        self._layout = _layout(names)
        self._schema = records.Schema(
            id=1, name=SCHEMA, encoding="protobuf", data=_descriptor(recording, stated)
        )
        self._channel = records.Channel(
            id=1, topic=TOPIC, message_encoding="protobuf", schema_id=1, metadata=units | stated
        )
        self._metadata = records.Metadata(
            name="benchtool",
            metadata={
                "format": FORMAT,
                "rows": str(len(recording)),
                "channels": json.dumps([[one.name, one.unit] for one in recording.channels]),
                "simulated": str(recording.simulated).lower(),
                "provenance": json.dumps(dict(recording.provenance)),
                **stated,
            },
        )
        self._indexes: list[Any] = []

    def write(self) -> None:
        from mcap import records

        self._file.write(MAGIC)
        self._put(records.Header(profile="", library="benchtool"))
        self._put(self._schema)
        self._put(self._channel)
        at = self._file.tell()
        self._put(self._metadata)
        about = records.MetadataIndex(offset=at, length=self._file.tell() - at, name="benchtool")
        first, last = self._write_chunks()
        self._put(records.DataEnd(data_section_crc=0))
        rows = len(self._recording)
        counts = records.Statistics(
            attachment_count=0, channel_count=1, channel_message_counts={1: rows},
            chunk_count=len(self._indexes), message_count=rows, message_end_time=last,
            message_start_time=first, metadata_count=1, schema_count=1,
        )  # fmt: skip
        start = self._file.tell()
        groups: list[list[Any]] = [
            [self._schema],
            [self._channel],
            [counts],
            self._indexes,
            [about],
        ]
        offsets = []
        for group in (group for group in groups if group):
            at = self._file.tell()
            for record in group:
                opcode = self._put(record)
            offsets.append((opcode, at, self._file.tell() - at))
        offset_start = self._file.tell()
        for opcode, at, length in offsets:
            self._put(records.SummaryOffset(opcode, at, length))
        self._put(
            records.Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=0)
        )
        self._file.write(MAGIC)

    def _put(self, record: Any) -> int:
        from mcap.data_stream import RecordBuilder

        builder: Any = RecordBuilder()
        record.write(builder)
        data = builder.end()
        self._file.write(data)
        return int(data[0])

    def _write_chunks(self) -> tuple[int, int]:
        rows = max(1, CHUNK_BYTES // self._layout.itemsize)
        first, last = (1 << 63), 0

        def made(start: int) -> tuple[NDArray[np.uint64], bytes, int, int]:
            end = min(start + rows, len(self._recording))
            times, messages = self._messages(start, end)
            return times, *_compressed(messages)

        for chunk in _in_threads(made, range(0, len(self._recording), rows)):
            first, last = min(first, int(chunk[0].min())), max(last, int(chunk[0].max()))
            self._write_chunk(*chunk)
        return (first, last) if len(self._recording) else (0, 0)

    def _messages(self, start: int, end: int) -> tuple[NDArray[np.uint64], NDArray[Any]]:
        """Return times (m,) and messages (m,) of some rows."""
        values = self._recording.values[start:end]
        out = np.empty(end - start, self._layout)
        names = self._recording.names
        out["op"], out["channel"] = 5, 1
        out["length"] = self._layout.itemsize - _LENGTH_BYTES
        out["sequence"] = np.arange(start, end, dtype=np.uint64) & 0xFFFFFFFF
        time_s = values[:, names.index("time_s")] if "time_s" in names else np.zeros(end - start)
        since = np.round(np.nan_to_num(time_s) * 1e9).astype(np.int64)
        out["log"] = out["publish"] = np.maximum(since + self._start_ns, 0).astype(np.uint64)
        for index, name in enumerate(names):
            out[f"t{index}"] = _tag(index, name in WORDS)
            out[f"v{index}"] = values[:, index]
        return out["log"].copy(), out

    def _write_chunk(self, times: NDArray[np.uint64], data: bytes, size: int, crc: int) -> None:
        from mcap import records

        span = {"message_start_time": int(times.min()), "message_end_time": int(times.max())}
        at = self._file.tell()
        self._put(
            records.Chunk(
                compression="zstd", data=data, uncompressed_crc=crc, uncompressed_size=size, **span
            )
        )
        behind = self._file.tell()
        entries = np.empty((len(times), 2), "<u8")
        entries[:, 0] = times
        entries[:, 1] = np.arange(len(times), dtype=np.uint64) * self._layout.itemsize
        body = entries.tobytes()
        # A MessageIndex: opcode, length, channel, bytes of its entries.
        head = np.array([(7, len(body) + 6, 1, len(body))], "u1, <u8, <u2, <u4")
        self._file.write(head.tobytes())
        self._file.write(body)
        self._indexes.append(
            records.ChunkIndex(
                chunk_length=behind - at,
                chunk_start_offset=at,
                compression="zstd",
                compressed_size=len(data),
                uncompressed_size=size,
                message_index_length=self._file.tell() - behind,
                message_index_offsets={1: behind},
                **span,
            )
        )


def _in_threads(work: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """Yield the result of each item in order, at most a few of them made before."""
    waiting: deque[Future[R]] = deque()
    with ThreadPoolExecutor(WORKERS) as pool:
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > WORKERS:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _compressed(messages: NDArray[Any]) -> tuple[bytes, int, int]:
    """Return messages compressed, their size and checksum before."""
    import zstandard

    data = messages.view(np.uint8).data
    return zstandard.ZstdCompressor(level=1).compress(data), data.nbytes, zlib.crc32(data)


def _tag(index: int, is_word: bool) -> NDArray[np.uint8]:
    """Return what stands before a field: its number and its form, a varint."""
    number = (index + 1) << 3 | (0 if is_word else 1)
    coded = [number] if number < 128 else [number & 127 | 128, number >> 7]
    return np.array(coded, np.uint8)


def _layout(names: list[str]) -> np.dtype[Any]:
    """Return how a message record lies in memory; at most 2,047 fields."""
    fields: list[Any] = list(_HEAD)
    for index, name in enumerate(names):
        fields.append((f"t{index}", "u1", (len(_tag(index, name in WORDS)),)))
        fields.append((f"v{index}", "u1" if name in WORDS else "<f8"))
    return np.dtype(fields)


def _descriptor(recording: Recording, stated: Mapping[str, str]) -> bytes:
    """Return the schema: a FileDescriptorSet with units and calibration as comments."""
    pb = load_extra("google.protobuf.descriptor_pb2", "mcap", "an MCAP file")
    file = pb.FileDescriptorProto(name="benchtool.proto", package="benchtool", syntax="proto3")
    message = file.message_type.add(name=SCHEMA.partition(".")[2])
    about = file.source_code_info.location.add(path=[4, 0], span=[0, 0, 0])
    about.leading_comments = "; ".join(f"{key}: {text}" for key, text in stated.items())
    for index, channel in enumerate(recording.channels):
        is_name = re.fullmatch(r"[A-Za-z]\w*", channel.name, re.ASCII)
        name = channel.name if is_name else f"channel{index + 1}"
        field = message.field.add(name=name, json_name=name, number=index + 1, label=1, type=1)
        if channel.name in WORDS:
            field.type, field.type_name = 14, f".{SCHEMA}.{channel.name.capitalize()}"
            words = message.enum_type.add(name=channel.name.capitalize())
            for code, word in enumerate(WORDS[channel.name]):
                words.value.add(name=f"{channel.name}_{word}".upper(), number=code)
        unit = file.source_code_info.location.add(path=[4, 0, 2, index], span=[0, 0, 0])
        unit.trailing_comments = f"unit: {channel.unit}"
    data: bytes = pb.FileDescriptorSet(file=[file]).SerializeToString()
    return data


def read_mcap(path: Path) -> Recording:
    """Return a recording that `write_mcap` wrote.

    Raises:
        FileFormatError: it is no such file, or it is damaged.
    """
    load_extra("mcap.records", "mcap", "an MCAP file")
    from mcap.exceptions import McapError

    where = str(path)
    facts: dict[str, str] = {}
    try:
        with open_file(path) as file:
            chunks = _chunks(file, facts, where)
            next(chunks)  # the facts stand before the first chunk
            stated = parse_json(facts["channels"], where)
            channels = tuple(Channel(str(name), str(unit)) for name, unit in stated)
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
    """Fill `facts` and yield nothing once, then each chunk as it stands in the file.

    The library's reader would turn every entry of the message indexes into an object.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.records import Metadata

    if file.read(len(MAGIC)) != MAGIC:
        raise FileFormatError(where, "this is no MCAP file; name one")
    while len(head := file.read(_LENGTH_BYTES)) == _LENGTH_BYTES:
        opcode, length = head[0], int.from_bytes(head[1:], "little")
        if opcode == 0x0C and length < MOST_FACTS_BYTES:
            record = Metadata.read(ReadDataStream(BytesIO(file.read(length))))
            if record.name == "benchtool":
                facts |= record.metadata
                yield b""
        elif opcode == 0x06 and facts.get("format") == FORMAT:
            if length > 2 * CHUNK_BYTES:
                raise ValueError(f"a chunk of {length} bytes")
            yield file.read(length)
        elif opcode in (0x0F, 0x06):
            break
        else:
            file.seek(length, 1)
    if facts.get("format") != FORMAT:
        raise FileFormatError(where, "benchtool has not written this MCAP file; name one of its")


def _values(chunks: Iterator[bytes], channels: tuple[Channel, ...], rows: int, where: str) -> Array:
    import zstandard
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk

    names = [channel.name for channel in channels]
    layout, at = _layout(names), 0
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
        return np.frombuffer(plain, layout)

    for messages in _in_threads(messages_in, chunks):
        end = at + len(messages)
        for index, name in enumerate(names):
            ends = messages[f"t{index}"][:: max(1, len(messages) - 1)]
            if (ends != _tag(index, name in WORDS)).any():
                raise ValueError(f"field {name} is not where it should be")
            values[at:end, index] = messages[f"v{index}"]
        at = end
    if at != rows:
        raise FileFormatError(where, f"it holds {at} of {rows} rows; restore it from a copy")
    return values
