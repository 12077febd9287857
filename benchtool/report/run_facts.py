"""Facts of a run for a page: state, device, rig, air, calibration, versions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchtool.data.calibration import traceability
from benchtool.data.run.read import is_run
from benchtool.data.run.run import Run
from benchtool.fit.uncertainty.run_budget import run_budget
from benchtool.report.fit.budget import budget_sentence, budget_table
from benchtool.report.page import Block, FactTable, Paragraph, Section

MISSING_VALUE = "not stated"


def run_state_table(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return when, by whom and how it ended."""
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
    """Return who measured, and what it says of itself."""
    device = metadata.get("device") or {}
    facts = {
        "address": str(metadata.get("address", MISSING_VALUE)),
        "device": f"{metadata.get('device_id', MISSING_VALUE)}, firmware "
        f"{device.get('firmware', MISSING_VALUE)}, protocol "
        f"{device.get('protocol', MISSING_VALUE)}",
    }
    if "rate_Hz" in device:
        facts["stream"] = f"{device['rate_Hz']:g} Hz: {', '.join(device.get('channels', {}))}"
    if "watchdog_s" in device:
        facts["watchdog"] = f"{device['watchdog_s']:g} s"
    if reported := device.get("facts"):
        facts["it says"] = ", ".join(f"{key} = {value}" for key, value in reported.items())
    return facts


_RIG = {  # facts by table; a run without the table has none of them
    "propulsion": {
        "rotor radius": "{radius_m:g} m",
        "k of T = k ω², in its file": "{thrust_coefficient_N_s2:g} N/(rad/s)²",
        "pulses": "stop {pwm_stop_us:g} µs, start {pwm_start_us:g} µs, most {pwm_max_us:g} µs",
    },
    "body": {"mass, pitch inertia": "{mass_kg:g} kg, {inertia_yy_kgm2:g} kg m²"},
    "plate": {
        "plate": "{size_x_m:g} m × {size_y_m:g} m, moved by {moved_by}, {z_min_m:g} m to "
        "{z_max_m:g} m, parked at {z_park_m:g} m"
    },
}


def rig_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the rig's numbers that a reader of thrust needs, and how many are assumed."""
    rig = metadata.get("rig") or {}
    if not rig:
        return {"rig": MISSING_VALUE}
    rotors = rig.get("rotors", [])
    places = ", ".join(f"{item['name']} ({item['x_m']:g}, {item['y_m']:g}) m" for item in rotors)
    facts = {
        "rig": f"{rig.get('name', '')}: {rig.get('title', '')}",
        "rotors": f"{len(rotors)}: {places}",
    }
    for table, rows in _RIG.items():
        if rig.get(table):
            facts |= {name: text.format(**rig[table]) for name, text in rows.items()}
    for name, sensor in rig.get("sensors", {}).items():
        text = "noise {noise:g}, quantum {quantum:g}, {rate_Hz:g} Hz"
        facts[f"sensor {name}"] = text.format(**sensor)
    assumed, stated = len(rig.get("assumed", [])), len(rig.get("sources", {}))
    return facts | {"assumed numbers of the rig": f"{assumed} of {stated}"}


def air_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the air around the bench."""
    air = metadata.get("air") or {}
    if not air:
        return {"air": MISSING_VALUE}
    source = "measured" if air.get("measured") else "nobody measured it: standard values stand in"
    return {
        "air": source,
        "temperature": f"{air['temperature_degC']:g} °C",
        "pressure": f"{air['pressure_Pa'] / 100.0:.2f} hPa",
        "relative humidity": f"{100.0 * air['humidity']:.0f} %",
        "density": f"{air['density_kg_m3']:.4f} kg/m³ ({air.get('formula', MISSING_VALUE)})",
    }


def calibration_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the load cell's calibration, or that there is none."""
    known = metadata.get("calibration")
    if not known:
        return {"calibration": "none attached: thrust_N is what the device sends"}
    slope_sd = known["relative_sd"] * abs(known["slope_N_per_count"])
    facts = {
        "calibration": f"{known['id']} of {known['date']}, device {known['device_id']}",
        "slope": f"({known['slope_N_per_count']:.6g} ± {slope_sd:.1g}) N per count",
        "relative standard error": f"{100.0 * known['relative_sd']:.3g} %, common to every thrust",
        "traceable": traceability(known),
        "straightness": f"{100.0 * known['straightness']:.3g} % of full scale",
        "masses": f"{len(known['masses_kg'])}, up to {max(known['masses_kg']):g} kg, local gravity "
        f"{known['gravity_m_s2']:g} m/s²",
    }
    if known.get("hysteresis") is not None:
        facts["hysteresis"] = f"{100.0 * known['hysteresis']:.3g} % of full scale"
    for part in known.get("components", ()):
        dof = "" if part["dof"] is None else f", {part['dof']:g} degrees of freedom"
        facts[f"part of it: {part['name']}"] = (
            f"{100.0 * part['relative_sd']:.2g} %, type {part['kind']}{dof}"
        )
    if metadata.get("calibration_of_other_device"):
        facts["mind"] = "it was made on another device"
    return facts


def version_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the software that recorded it."""
    versions = metadata.get("versions") or {}
    listed = ", ".join(f"{name} {version}" for name, version in versions.items())
    return {"recorded with": listed or MISSING_VALUE}


def simple_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return who measured what, when, in which air, with which calibration: all in short."""
    rig, air = rig_facts(metadata), air_facts(metadata)
    facts: dict[str, str] = {key: rig[key] for key in ("rig", "rotor radius") if key in rig}
    facts["device"] = device_facts(metadata)["device"]
    facts |= run_state_table(metadata)
    facts["air"] = air.get("density", MISSING_VALUE) + (
        "" if "density" not in air else f", {air['air']}"
    )
    facts |= calibration_facts(metadata)
    return facts | version_facts(metadata)


def run_sections(paths: Iterable[str]) -> list[Section]:
    """Return for each path that is a run: the rig, the air, the calibration and its budget."""
    sections = []
    for path in (Path(path) for path in paths if is_run(path)):
        blocks: list[Block] = [FactTable(simple_facts(Run.open(path).metadata))]
        if (budget := run_budget(path)) is not None:
            blocks += [budget_table(budget), Paragraph(budget_sentence(budget))]
        sections.append(Section(f"The run {path.resolve().name}", blocks))
    return sections
