"""Every parser of benchtool as a function of bytes, with bytes that it can read to begin from.

A target returns, or raises an error of `benchtool.core.errors`; anything else is a fault.
"""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from benchtool.acquire.check_plan import check_plan
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.plan import plan_from_toml
from benchtool.acquire.resume import load_resume_state
from benchtool.acquire.visit_order import plan_visits
from benchtool.bench.drivers import parse_address, parse_stage
from benchtool.bench.mavlink.auxiliary_load_cell import LoadCellDecoder
from benchtool.bench.mavlink.frames import MavlinkFrames, dialect
from benchtool.bench.mavlink.rows import MavlinkRows
from benchtool.bench.mavlink.settings import MavlinkSettings, MotorMap
from benchtool.bench.serial.frames import Decoder, frame, split_messages
from benchtool.bench.serial.hello import parse_hello
from benchtool.bench.stage.grbl_lines import GrblDecoder, StatusReport
from benchtool.commands.calibrate import CalibrateInputs
from benchtool.core.errors import BenchtoolError
from benchtool.core.inputs import build_inputs, items
from benchtool.core.rig_file import load_rig_by_name, parse_rig
from benchtool.core.schedule import Schedule
from benchtool.core.toml_text import parse_json, read_strict
from benchtool.data.atomic import replace_text
from benchtool.data.calibration import parse_calibration
from benchtool.data.column_map import read_column_map
from benchtool.data.csv_text import parse_csv
from benchtool.data.formats.formats import import_bytes
from benchtool.data.repairs.import_result import ImportOptions
from benchtool.data.run.append import read_events
from benchtool.data.run.entry import FIT_FILE, read_result
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.recording_file import metadata_path, read_recording, write_recording
from benchtool.data.run.run import Run, read_settings
from benchtool.data.table import RowFilter, parse_column
from benchtool.fit.recipe import FitInputs, read_recipe
from benchtool.physics.model_file import model_from_toml
from benchtool.simulate.gain_file import parse_gains
from benchtool.virtual.faults import parse_fault
from benchtool.virtual.links import ServedLink
from benchtool.web.access import Access, AccessMiddleware
from tests.unit.data.flight_logs import dataflash, hop, text_log
from tests.unit.data.run_of import small_run
from tests.unit.data.stand_logs import log_text, steps_1580
from tests.unit.data.test_mavlink_log import hop as link_hop
from tests.unit.data.test_mavlink_log import tlog

LIBRARY = files("benchtool.library")


@dataclass(frozen=True, slots=True)
class Target:
    """One parser.

    Attributes:
        parse: reads bytes, or refuses them.
        seeds: bytes to change; the first is read without a refusal.
        binary: whether its words are no text.
    """

    name: str
    parse: Callable[[bytes], object]
    seeds: tuple[bytes, ...]
    binary: bool = field(default=False)


def text(data: bytes) -> str:
    """Return the text of a file or of a word of the command line."""
    return data.decode("utf-8", "replace")


def pieces(data: bytes) -> Iterator[bytes]:
    """Yield bytes as a link hands them over."""
    for start in range(0, len(data), 37):
        yield data[start : start + 37]


def bench_link(data: bytes) -> None:
    """Read a bench's bytes; its lines once more with a check sum that is right."""
    decoder, right = Decoder(5), Decoder(5)
    for piece in pieces(data):
        decoder.feed(piece)
    decoder.take_messages()
    split_messages(data)
    right.feed(b"".join(frame(line.split(b"*")[0].lstrip(b"$")) for line in data.split(b"\n")))
    right.take_messages()


def bench_hello(data: bytes) -> None:
    """Read what a bench says of itself."""
    parse_hello([line.split(",") for line in text(data).split("\n")])


WIRING = MotorMap(rig="", autopilot="", motors=(1,), outputs=(1,), escs=(1,))


@cache
def mavlink_kinds() -> tuple[Any, ...]:
    kinds = dialect().mavlink_map
    return tuple(kinds[number] for number in sorted(kinds))


def mavlink(data: bytes) -> None:
    """Read an autopilot's bytes, and what they are as whole frames of any message."""
    frames, x25crc = MavlinkFrames(), dialect().x25crc
    rows = MavlinkRows(WIRING, MavlinkSettings(), 1000.0)
    for piece in pieces(data):
        for message in frames.parse(piece):
            rows.update(message)
    whole = b""
    for start in range(0, len(data) - 3, 40):
        kind = mavlink_kinds()[
            int.from_bytes(data[start : start + 2], "little") % len(mavlink_kinds())
        ]
        body = data[start + 2 : start + 40][: kind.unpacker.size] or b"\0"
        head = bytes([len(body), 0, 0, data[start] % 8, 1, 1]) + kind.id.to_bytes(3, "little")
        crc = x25crc(head + body + bytes([kind.crc_extra])).crc
        whole += b"\xfd" + head + body + crc.to_bytes(2, "little")
    for message in frames.parse(whole):
        rows.update(message)
    rows.take_rows()


def side_cell(data: bytes) -> None:
    lines = LoadCellDecoder()
    for piece in pieces(data):
        lines.feed(piece)


def grbl(data: bytes) -> None:
    decoder = GrblDecoder()
    for piece in pieces(data):
        for line in decoder.feed(piece):
            str(line)
            if isinstance(line, StatusReport):
                decoder.machine_mm(line)


def csv_table(data: bytes) -> None:
    table = parse_csv(data, "t.csv")
    [parse_column(table, index) for index in range(len(table.header))]


def imported(data: bytes) -> None:
    import_bytes(data, "log", ImportOptions(near_m=0.5))


def plan(data: bytes) -> None:
    rig = load_rig_by_name("pquad")
    read = plan_from_toml(text(data), "plan.toml").resolved(rig)
    check_plan(read, rig)
    plan_visits(read, rig)


def one_word(cls: type[Any]) -> Callable[[bytes], object]:
    """Return a target that reads `option value` of a command."""
    names = [item.name for item in items(cls)]

    def parse(data: bytes) -> None:
        for line in text(data).split("\n")[:20]:
            name, _, value = line.partition(" ")
            try:
                build_inputs(cls, {names[hash_of(name) % len(names)]: value}, source="option")
            except BenchtoolError:
                continue

    return parse


def hash_of(name: str) -> int:
    return int(name) if name.isascii() and name.isdigit() and len(name) < 9 else sum(map(ord, name))


def where(data: bytes) -> None:
    RowFilter.parse(text(data)).matches("1")


def request(data: bytes) -> None:
    """Send the server a request: method, path and query, then a header a line."""
    first, *lines = data.split(b"\n")
    method, _, target = first.partition(b" ")
    path, _, query = target.partition(b"?")
    kind = "websocket" if method == b"WS" else "http"
    headers = [tuple(line.lower().partition(b": ")[::2]) for line in lines]
    scope = {
        "type": kind, "method": text(method), "path": text(path), "query_string": query,
        "headers": headers, "scheme": "http",
    }  # fmt: skip

    async def receive() -> dict[str, Any]:
        return {"type": f"{kind}.request", "body": data, "more_body": False}

    async def nothing(*_: Any) -> None:
        return None

    for access in (Access(), Access(any_address=True, token="t" * 20)):
        guarded = AccessMiddleware(nothing, access, "cookie", sleep=nothing)
        asyncio.run(guarded(scope, receive, nothing))  # type: ignore[arg-type]


class Files:
    """Targets that read a folder; one in memory where there is such."""

    def __init__(self) -> None:
        memory = Path("/dev/shm")
        self.root = Path(mkdtemp(prefix="fuzz", dir=memory if memory.is_dir() else None))
        made = small_run(self.root / "run")
        made.update_metadata(rig=asdict(load_rig_by_name("pquad_single")))
        replace_text(made.path / "plan.toml", text(PLAN))
        made.close()
        self.run = made.path
        (self.run / "samples.parquet").unlink()
        log = made.event_log()
        log.write(b'{"time_s": 0.5, "event": "tare", "text": "tared"}\n')
        log.close()
        recording = read_points(self.run)
        write_recording(self.root / "r.csv", recording, {})
        self.written = {
            path: path.read_bytes() for path in (*self.run.iterdir(), metadata_path(self.recording))
        }

    @property
    def recording(self) -> Path:
        return self.root / "r.csv"

    def seed(self, name: str) -> bytes:
        return self.written[self.run / name]

    def in_run(self, name: str) -> Callable[[bytes], object]:
        """Return a target that reads a run of which one file is hostile."""

        def parse(data: bytes) -> None:
            (self.run / name).write_bytes(data)
            readers: tuple[Callable[[], object], ...] = (
                lambda: load_resume_state(Run.open(self.run)),
                lambda: read_points(self.run),
                lambda: read_samples(self.run),
                lambda: read_settings(self.run / "settings.csv"),
                lambda: read_events(self.run / "events.jsonl"),
            )
            try:
                for read in readers:
                    try:
                        read()
                    except BenchtoolError:
                        continue
            finally:
                for path in self.run.iterdir():
                    if path not in self.written:
                        path.unlink()
                (self.run / name).write_bytes(self.seed(name))

        return parse

    def recording_facts(self, data: bytes) -> None:
        metadata_path(self.recording).write_bytes(data)
        read_recording(self.recording)

    def fit_result(self, data: bytes) -> None:
        (self.root / FIT_FILE).write_bytes(data)
        read_result(self.root)

    def columns(self, data: bytes) -> None:
        (self.root / "columns.toml").write_bytes(data)
        read_column_map(self.root / "columns.toml")

    def recipe(self, data: bytes) -> None:
        (self.root / "recipe.toml").write_bytes(data)
        read_recipe(self.root)

    def close(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.root)


HELLO = b"""\
protocol,2
device,bench-0042
firmware,example 1.0
rotors,2
pwm,1000,1050
rate,100
channel,thrust_N,N,50
limit,rpm,9000"""
LINK = b"".join(
    frame(line) for line in (*(b"H," + line for line in HELLO.split(b"\n")), b"A,1,0,23",
                             b"S,0,10000,1000,1000,0,0.1,12", b"E,arrived,0.098,0,0", b"N,7,no")
)  # fmt: skip
GRBL = b"""\
Grbl 1.1h ['$' for help]\r
<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r
ok\r
error:9\r
ALARM:2\r
$110=500.000\r
[MSG:'$H'|'$X' to unlock]\r
<Run:1|WPos:1.0,2.0,3.0|Ov:100,100,100>\r
"""
PLAN = b"""\
name = "quad"
repeats = 2
sample_s = 1.0
[plate]
distances_m = [0.1, 0.2, 0.4]
[throttle]
pwm_us = [1450.0]
[order]
kind = "randomised"
seed = 7
"""
MOTOR_MAP = b"""\
autopilot = "px4"
rig = "pquad"
motors = [1, 4]
outputs = [3, 2]
escs = [3, 2]
"""
COLUMNS = b'[columns]\nthrust_N = { column = "F", unit = "gf", sign = -1, factor = 2.0 }\n'
RECIPE = b'[recipe]\nname = "a"\ndata = ["d.csv"]\nmodel = "single"\n'
FIT_RESULT = b'{"format": "benchtool-fit-1", "results": {}}'
CALIBRATION = {
    "id": "a", "date": "2026-01-01", "device_id": "d", "slope_N_per_count": 1e-5,
    "offset_N": 0.0, "covariance": [[1e-12, 0.0], [0.0, 1.0]], "relative_sd": 0.01,
    "straightness": 0.0, "hysteresis": None, "residual_sd_N": 0.01, "masses_kg": [0.0, 1.0],
    "counts": [0.0, 1e6], "residuals_N": [0.0, 0.0],
}  # fmt: skip
ADDRESSES = (
    b"serial:/dev/ttyUSB0?baud=2000000",
    b"tcp:127.0.0.1:5555",
    b"mavlink:serial:/dev/ttyACM0:115200?rotors=1&thrust_scale=0.1&system=2&cell=/dev/x:1",
    b"mavlink:udpin:127.0.0.1:14550?map=m.toml",
    b"mavlink:tcp:[::1]:5760?key=k&mode=pitch&arm=host",
    b"sim:pquad?seed=3&truth=single&rate=200",
    b"replay:runs/first",
)
STAGES = (b"grbl:/dev/x?axis=Z&zero_mm=1500&direction=1&lateral=X&lateral_zero_mm=0", b"hand")
LINKS = (b"mavlink:udpout:127.0.0.1:14550", b"tcp:localhost:5555", b"mavlink:pty")
OPTIONS = b"z_over_r 0.5:2:0.5\n1 0.5,1\n2 1450\n3 0.1 m\n4 yes\n5 1e3\n6 a=1,b=2\n7 12"
REQUEST = b"""\
GET /?token=tttttttttttttttttttt&a=1
host: 127.0.0.1:8460
origin: http://127.0.0.1:8460
sec-fetch-site: same-origin
sec-fetch-mode: navigate
cookie: cookie=x; other="y"
"""


def shipped(folder: str) -> tuple[bytes, ...]:
    """Return the TOML files of one kind that benchtool ships."""
    found = sorted(LIBRARY.joinpath(folder).iterdir(), key=lambda item: item.name)
    return tuple(item.read_bytes() for item in found if item.name.endswith(".toml"))


def targets(on_disk: Files) -> dict[str, Target]:
    """Return every target by its name."""
    recording = metadata_path(on_disk.recording)
    table = b"time_s,thrust_N,rpm1,plate_z_m\n0,1.5,4000,0.1\n0.1,1.6,4010,0.1\n0.2,1.6,4010,0.12\n"
    stand = log_text(steps_1580()).encode()
    found = [
        Target("bench link", bench_link, (LINK,), binary=True),
        Target("bench hello", bench_hello, (HELLO,)),
        Target("mavlink", mavlink, (tlog(link_hop()[:20]), bytes(range(256))), binary=True),
        Target("side cell", side_cell, (b"HX711 reading: 124006\r\none reading:\t16.1\t| x: 4\n",)),
        Target("grbl", grbl, (GRBL,)),
        Target("csv", csv_table, (table, stand[:2000])),
        Target("import", imported, (stand[:4000], table, text_log(hop(0.2)).encode())),
        Target("import log", imported, (dataflash(hop(0.2)), tlog(link_hop()[:40])), binary=True),
        Target("plan", plan, (PLAN, *shipped("plans"))),
        Target("rig", lambda data: parse_rig(text(data), "rig.toml"), shipped("rigs")),
        Target("model", lambda data: model_from_toml(text(data), "m.toml"), shipped("models")),
        Target("gains", lambda data: parse_gains(text(data), "g.toml"), shipped("gains")),
        Target("schedule", lambda data: read_strict(Schedule, text(data), "s.toml"),
               shipped("schedules")),
        Target("motor map", lambda data: read_strict(MotorMap, text(data), "map.toml"),
               (MOTOR_MAP,)),
        Target("columns", on_disk.columns,
               (COLUMNS,)),
        Target("recipe", on_disk.recipe, (RECIPE,)),
        Target("address", lambda data: parse_address(text(data)), ADDRESSES),
        Target("stage", lambda data: parse_stage(text(data)), STAGES),
        Target("link", lambda data: ServedLink.parse(text(data)), LINKS),
        Target("virtual fault", lambda data: parse_fault(text(data)),
               (b"silence:at_s=12,for_s=1", b"stuck:channel=rpm1,at_s=2")),
        Target("options of sweep", one_word(SweepInputs), (OPTIONS,)),
        Target("options of fit", one_word(FitInputs), (OPTIONS,)),
        Target("options of calibrate", one_word(CalibrateInputs), (OPTIONS,)),
        Target("where", where, (b"RotorType=DJI 9450", b"a>=1.5")),
        Target("web request", request, (REQUEST, REQUEST.replace(b"GET", b"WS"))),
        Target("calibration", lambda data: parse_calibration(parse_json(data, "c.json"), "c.json"),
               (json.dumps(CALIBRATION).encode(),)),
        Target("recording facts", on_disk.recording_facts, (on_disk.written[recording],)),
        Target("fit result", on_disk.fit_result, (FIT_RESULT,)),
        *(Target(f"run {name.split('.')[0]}", on_disk.in_run(name), (on_disk.seed(name),))
          for name in ("metadata.json", "plan.toml", "points.csv", "samples.csv", "settings.csv",
                       "events.jsonl")),
    ]  # fmt: skip
    return {target.name: target for target in found}
