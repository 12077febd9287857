"""Logs of stands as their programs write them, made here with known numbers."""

from __future__ import annotations

import numpy as np

from benchtool.data.formats.formats import import_bytes
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult

HEADER_1580 = (
    "Time (s),ESC signal (µs),Servo 1 (µs),Servo 2 (µs),Servo 3 (µs),AccX (g),AccY (g),AccZ (g),"
    "Torque (N·m),Thrust (gf),Voltage (V),Current (A),Motor Electrical Speed (RPM),"
    "Motor Optical Speed (RPM),Electrical Power (W),Mechanical Power (W),Motor Efficiency (%),"
    "Propeller Mech. Efficiency (gf/W),Overall Efficiency (gf/W),Vibration (g),App message,"
)
COLUMNS = HEADER_1580.split(",")


def steps_1580(rows: int = 20, **changed: np.ndarray) -> dict[str, np.ndarray]:
    """Give the columns of a step log of a good stand, some of them changed."""
    pulse = np.linspace(1000.0, 1950.0, rows)
    rpm = 12.0 * (pulse - 1000.0)
    values = {
        "Time (s)": np.arange(rows) * 0.5,
        "ESC signal (µs)": pulse,
        "Torque (N·m)": 1e-10 * rpm**2,
        "Thrust (gf)": 1.5e-6 * rpm**2,
        "Voltage (V)": np.full(rows, 11.1) - 1e-5 * rpm,
        "Current (A)": 0.1 + 1e-12 * rpm**3,
        "Motor Electrical Speed (RPM)": rpm,
        "Motor Optical Speed (RPM)": np.zeros(rows),
        "App message": np.full(rows, np.nan),
    }
    return values | changed


def log_text(columns: dict[str, np.ndarray], header: str = HEADER_1580) -> str:
    """Write columns under a header; a column that is not given is blank."""
    names = header.split(",")
    rows = len(next(iter(columns.values())))
    lines = [header]
    for row in range(rows):
        cells = [columns[name][row] if name in columns else np.nan for name in names]
        lines.append(",".join("" if np.isnan(cell) else repr(float(cell)) for cell in cells))
    return "\n".join(lines) + "\n"


def imported(text: str | bytes, where: str = "log.csv", **options: object) -> ImportResult:
    """Import text; the account must balance."""
    data = text.encode() if isinstance(text, str) else text
    read = import_bytes(data, where, ImportOptions(**options))  # type: ignore[arg-type]
    assert read.tally.is_balanced
    assert read.tally.kept == len(read.recording)
    return read


def logged(changed: dict[str, np.ndarray], rows: int = 20, **options: object) -> ImportResult:
    """Import the log of steps with some of its columns changed."""
    return imported(log_text(steps_1580(rows, **changed)), **options)


def found(read: ImportResult, what: str) -> list[Finding]:
    """Give the findings of one matter."""
    return [item for item in read.findings if item.what == what]
