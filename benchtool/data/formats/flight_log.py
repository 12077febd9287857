"""Pitch recordings from the streams of a flight log, with findings for missing channels."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchtool.core.errors import FileFormatError
from benchtool.core.text import pluralize
from benchtool.data.formats.messages import MessageLog, Messages, Stream, merge_streams
from benchtool.data.repairs.import_result import Finding, ImportCount, ImportResult

MIN_GAP_S = 1.0  # dropout of the attitude, which every log has at 4 Hz or more; assumed
MAX_LOG_US = 7 * 86400e6  # messages farther from the median time are corrupt; assumed

_NEEDS: tuple[tuple[str, str, str], ...] = (
    ("attitude", r"theta_rad", "no attitude in the log, so it is not a pitch recording"),
    ("rates", r"gyro_rad_s", "no rates in the log; only differences of the attitude are available"),
    ("reference", r"theta_ref_rad", "no pitch setpoint in the log"),
    ("outputs", r"pwm\d+_us|motor\d+_share", "no motor outputs in the log"),
    ("rpm", r"rpm\d+", "no speeds of ESC or tachometer; they can only be modelled from outputs"),
    ("distance", r"distance_m", "no distance sensor in the log; --over sets the surface windows"),
)
"""Contents of a pitch recording, pattern of their channels, message if they are missing."""


def import_flight_log(
    log: MessageLog,
    streams: Sequence[Stream],
    format_name: str,
    where: str,
    provenance: Mapping[str, str],
) -> ImportResult:
    """Return a flight log as a pitch recording.

    Raises:
        FileFormatError: the log has no message of a recording's channels.
    """
    findings = list(log.findings)
    streams, strange = _clean(streams, findings)
    total, broken = log.total - strange, log.broken + strange
    if not streams:
        reasons = "; ".join(finding.words for finding in findings if finding.kind == "refused")
        raise FileFormatError(
            where,
            f"{pluralize(total, 'message')} could be read, and none is attitude, rates, outputs, "
            f"rpm or distance{': ' + reasons if reasons else ''}; use a log of a flight",
        )
    recording, disordered = merge_streams(streams)
    if disordered:
        text = f"{pluralize(disordered, 'message')} stamped before an earlier one; sorted by time"
        findings.append(Finding("repaired", "time goes backwards", text, "time_s", disordered))
    if "theta_rad" in recording or "gyro_rad_s" in recording:
        text = "theta and gyro are nose down positive, as in benchtool; logs are nose up positive"
        findings.append(Finding("read as", "sign", text, "theta_rad"))
    for what, pattern, text in _NEEDS:
        if not any(re.fullmatch(pattern, name) for name in recording.names):
            findings.append(Finding("lacks", what, text))
    findings += _gaps(streams)
    retained = sum(stream.time_us.size for stream in streams)
    sources = {
        name: f"{stream.source}.{stream.fields[name]}"
        for stream in streams
        for name in stream.columns
    }
    return ImportResult(
        recording=replace(recording, provenance={**provenance, "rows": str(len(recording))}),
        format=format_name,
        findings=tuple(findings),
        tally=ImportCount(
            unit="message",
            total=total + broken,
            kept=retained,
            refused=broken,
            not_needed=total - retained,
        ),
        sources=sources,
    )


def _clean(streams: Sequence[Stream], findings: list[Finding]) -> tuple[list[Stream], int]:
    """Return the streams without messages of impossible times, infinite numbers blanked."""
    streams = [stream for stream in streams if stream.time_us.size and stream.columns]
    if not streams:
        return [], 0
    middle_us = float(np.median(np.concatenate([stream.time_us for stream in streams])))
    retained, n_strange, n_infinite = [], 0, 0
    for stream in streams:
        is_good = np.abs(stream.time_us.astype(float) - middle_us) < MAX_LOG_US
        is_good &= (stream.time_us >= 0) & (stream.time_us < 1 << 53)
        n_strange += int(np.count_nonzero(~is_good))
        columns = {name: values[is_good] for name, values in stream.columns.items()}
        for values in columns.values():
            is_infinite = np.isinf(values)
            n_infinite += int(np.count_nonzero(is_infinite))
            values[is_infinite] = np.nan
        if is_good.any():
            retained.append(replace(stream, time_us=stream.time_us[is_good], columns=columns))
    retained = [_drop_blank(stream, findings) for stream in retained]
    retained = [stream for stream in retained if stream.columns]
    if n_strange:
        text = f"{pluralize(n_strange, 'message')} stamped days away from the others"
        findings.append(Finding("refused", "stray time", text, "time_s", n_strange))
    if n_infinite:
        text = f"{pluralize(n_infinite, 'infinite value')} blanked"
        findings.append(Finding("repaired", "infinite numbers", text, count=n_infinite))
    return retained, n_strange


def _drop_blank(stream: Stream, findings: list[Finding]) -> Stream:
    blank = [name for name, values in stream.columns.items() if np.isnan(values).all()]
    if not blank:
        return stream
    text = f"{stream.source} has no number for it"
    findings += [Finding("lacks", "blank channel", text, name) for name in blank]
    columns = {name: values for name, values in stream.columns.items() if name not in blank}
    return replace(stream, columns=columns)


def _gaps(streams: Sequence[Stream]) -> list[Finding]:
    for stream in streams:
        if "theta_rad" in stream.columns and stream.time_us.size > 1:
            steps_s = 1e-6 * np.diff(np.sort(stream.time_us)).astype(float)
            n_gaps = int(np.count_nonzero(steps_s > MIN_GAP_S))
            if n_gaps:
                text = (
                    f"{pluralize(n_gaps, 'gap')} of more than {MIN_GAP_S:g} s in the attitude, the "
                    f"longest {steps_s.max():.4g} s"
                )
                return [Finding("doubt", "gaps", text, "theta_rad", n_gaps)]
    return []


# SRV_Channel.h: 33..40 Motor1..8, 82..85 Motor9..12, 70 throttle, 73 and 74 left and right.
_ARDUPILOT: dict[int, int] = (
    {33 + i: 1 + i for i in range(8)} | {82 + i: 9 + i for i in range(4)} | {70: 1, 73: 1, 74: 2}
)


def ardupilot_motors(parameters: Messages, name: str, value: str) -> dict[int, int]:
    """Return motor number by output channel (from 1), from messages with parameters."""
    if not parameters.has(name, value):
        return {}
    pairs = zip(parameters.texts(name), parameters.numbers(value).tolist(), strict=True)
    return parse_motor_map(dict(pairs), r"SERVO(\d+)_FUNCTION", _ARDUPILOT)


def parse_motor_map(
    parameters: Mapping[str, float], pattern: str, functions: Mapping[int, int]
) -> dict[int, int]:
    """Return motor number by output channel (from 1), in the order of the motors.

    Args:
        pattern: of parameters that set a channel's function; its group is the channel.
        functions: motor number by function.
    """
    motor_map: dict[int, int] = {}
    for name, number in parameters.items():
        match = re.fullmatch(pattern, name)
        if match and number == number and abs(number) < 1e6 and int(number) in functions:
            motor = functions[int(number)]
            if motor not in motor_map.values():
                motor_map[int(match[1])] = motor
    return dict(sorted(motor_map.items(), key=lambda pair: pair[1]))


def select_motor_channels(
    motors: Mapping[int, int], logged: Collection[int], parameter: str, findings: list[Finding]
) -> dict[int, int]:
    """Return motor number by logged output channel, with a finding about the assignment.

    Args:
        motors: motor number by channel from parameters; if empty, motor n is channel n.
        logged: channels with pulse widths.
        parameter: name of the parameter, for the finding.
    """
    if not motors:
        text = (
            f"no {parameter} assigns channels to motors; pwm1 is channel 1, and a channel may "
            f"drive a servo"
        )
        findings.append(Finding("doubt", "motor channels", text))
        return {channel: channel for channel in logged}
    pairs = ", ".join(f"motor {motor} on channel {channel}" for channel, motor in motors.items())
    text = f"{pairs}; rotors have the autopilot's motor numbers, not a rig's"
    findings.append(Finding("read as", "motor channels", text))
    for channel, motor in motors.items():
        if channel not in logged:
            text = f"motor {motor} is on channel {channel}, which has no pulse width in the log"
            findings.append(Finding("lacks", "outputs", text, f"pwm{motor}_us"))
    return {channel: motor for channel, motor in motors.items() if channel in logged}
