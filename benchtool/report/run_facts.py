"""Metadata of a run for a page: state, device, rig, air, calibration, versions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchtool import __version__
from benchtool.data.calibration import format_traceability
from benchtool.data.run.read import is_run
from benchtool.data.run.run import Run
from benchtool.fit.uncertainty.run_budget import run_budget
from benchtool.report.fit.budget import budget_sentence, budget_table
from benchtool.report.page import Block, Section

MISSING_VALUE = "not stated"


def run_state_table(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return start, operator, state, sample counts and seed of a run."""
    link, reason = metadata.get("link") or {}, metadata.get("reason")
    facts = {
        "started": str(metadata.get("started", MISSING_VALUE)),
        "operator": str(metadata.get("operator") or MISSING_VALUE),
        "state": str(metadata.get("state", MISSING_VALUE)) + (f": {reason}" if reason else ""),
    }
    if "samples" in link:
        lost, corrupt = link.get("lost", "?"), link.get("corrupt", "?")
        facts["samples"] = f"{link['samples']}, lost {lost}, corrupt frames {corrupt}"
    if "seed" in metadata:
        facts["seed of the order"] = str(metadata["seed"])
    return facts


def device_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return address, versions, rate, channels and reports of the device."""
    device = metadata.get("device") or {}
    device_id = metadata.get("device_id", MISSING_VALUE)
    firmware, protocol = (device.get(key, MISSING_VALUE) for key in ("firmware", "protocol"))
    facts = {
        "address": str(metadata.get("address", MISSING_VALUE)),
        "device": f"{device_id}, firmware {firmware}, protocol {protocol}",
    }
    if "rate_Hz" in device:
        facts["stream"] = f"{device['rate_Hz']:g} Hz: {', '.join(device.get('channels', {}))}"
    if "watchdog_s" in device:
        facts["watchdog"] = f"{device['watchdog_s']:g} s"
    if reported := [f"{key} = {value}" for key, value in (device.get("facts") or {}).items()]:
        facts["reported by the device"] = ", ".join(reported)
    return facts


_RIG = {  # labels and formats by table of the rig file; missing tables are skipped
    "propulsion": {
        "rotor radius": "{radius_m:g} m",
        "k of T = k ω², in the rig file": "{thrust_coefficient_N_s2:g} N/(rad/s)²",
        "pulse widths": "stop {pwm_stop_us:g} µs, start {pwm_start_us:g} µs, "
        "maximum {pwm_max_us:g} µs",
    },
    "body": {"mass, pitch inertia": "{mass_kg:g} kg, {inertia_yy_kgm2:g} kg m²"},
    "plate": {
        "plate": "{size_x_m:g} m × {size_y_m:g} m, moved by {moved_by}, {z_min_m:g} m to "
        "{z_max_m:g} m, parked at {z_park_m:g} m"
    },
}


def rig_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the rig data relevant to thrust, and the number of assumed values."""
    rig = metadata.get("rig") or {}
    if not rig:
        return {"rig": MISSING_VALUE}
    rotors = rig.get("rotors", [])
    positions = ", ".join(f"{item['name']} ({item['x_m']:g}, {item['y_m']:g}) m" for item in rotors)
    facts = {
        "rig": f"{rig.get('name', '')}: {rig.get('title', '')}",
        "rotors": f"{len(rotors)}: {positions}",
    }
    for table, rows in _RIG.items():
        if rig.get(table):
            facts |= {name: text.format(**rig[table]) for name, text in rows.items()}
    for name, sensor in rig.get("sensors", {}).items():
        text = "noise {noise:g}, quantum {quantum:g}, {rate_Hz:g} Hz"
        facts[f"sensor {name}"] = text.format(**sensor)
    n_assumed, n_sources = len(rig.get("assumed", [])), len(rig.get("sources", {}))
    return facts | {"assumed numbers of the rig": f"{n_assumed} of {n_sources}"}


def air_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the air data of the bench."""
    air = metadata.get("air") or {}
    if not air:
        return {"air": MISSING_VALUE}
    source = "measured" if air.get("measured") else "not measured: standard atmosphere"
    return {
        "air": source,
        "temperature": f"{air['temperature_degC']:g} °C",
        "pressure": f"{air['pressure_Pa'] / 100.0:.2f} hPa",
        "relative humidity": f"{100.0 * air['humidity']:.0f} %",
        "density": f"{air['density_kg_m3']:.4f} kg/m³ ({air.get('formula', MISSING_VALUE)})",
    }


def calibration_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the calibration of the load cell, or a remark if there is none."""
    cell = metadata.get("calibration")
    if not cell:
        return {"calibration": "none attached: thrust_N is the device value"}
    slope_sd = cell["relative_sd"] * abs(cell["slope_N_per_count"])
    facts = {
        "calibration": f"{cell['id']} of {cell['date']}, device {cell['device_id']}",
        "slope": f"({cell['slope_N_per_count']:.6g} ± {slope_sd:.1g}) N per count",
        "relative standard error": f"{100.0 * cell['relative_sd']:.3g} %, common to every thrust",
        "traceable": format_traceability(cell),
        "nonlinearity": f"{100.0 * cell['straightness']:.3g} % of full scale",
        "masses": f"{len(cell['masses_kg'])}, up to {max(cell['masses_kg']):g} kg, local gravity "
        f"{cell['gravity_m_s2']:g} m/s²",
    }
    if cell.get("hysteresis") is not None:
        facts["hysteresis"] = f"{100.0 * cell['hysteresis']:.3g} % of full scale"
    for part in cell.get("components", ()):
        dof = "" if part["dof"] is None else f", {part['dof']:g} degrees of freedom"
        percent = f"{100.0 * part['relative_sd']:.2g} %"
        facts[f"component: {part['name']}"] = f"{percent}, type {part['kind']}{dof}"
    if metadata.get("calibration_of_other_device"):
        facts["caution"] = "calibration of another device"
    return facts


def version_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the software that recorded the run."""
    versions = metadata.get("versions") or {}
    listed = ", ".join(f"{name} {version}" for name, version in versions.items())
    return {"recorded with": listed or MISSING_VALUE}


def bench_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the rig and the device of a run."""
    return rig_facts(metadata) | device_facts(metadata)


def condition_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return state, air and calibration of a run."""
    state, air = run_state_table(metadata), air_facts(metadata)
    return state | air | calibration_facts(metadata)


def data_facts(
    metadata: Mapping[str, Any], sha256: str, file_hashes: Mapping[str, str]
) -> dict[str, str]:
    """Return the software of a run and its page, and the hashes of its data."""
    reported = {
        "reported with": f"benchtool {__version__}",
        "sha256 of the run's data (points and samples)": sha256,
    }
    hashes = {f"sha256 of {name}": digest for name, digest in file_hashes.items()}
    return version_facts(metadata) | reported | hashes


def simple_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return a short list: rig, device, state, air density, calibration, versions."""
    rig, air = rig_facts(metadata), air_facts(metadata)
    facts: dict[str, str] = {key: rig[key] for key in ("rig", "rotor radius") if key in rig}
    facts["device"] = device_facts(metadata)["device"]
    facts |= run_state_table(metadata)
    facts["air"] = f"{air['density']}, {air['air']}" if "density" in air else MISSING_VALUE
    facts |= calibration_facts(metadata)
    return facts | version_facts(metadata)


def run_sections(paths: Iterable[str]) -> list[Section]:
    """Return one section per run folder: rig, air, calibration and uncertainty budget."""
    sections = []
    for path in (Path(path) for path in paths if is_run(path)):
        blocks: list[Block] = [simple_facts(Run.open(path).metadata)]
        if (budget := run_budget(path)) is not None:
            blocks += [budget_table(budget), budget_sentence(budget)]
        sections.append(Section(f"The run {path.resolve().name}", blocks))
    return sections
