"""What a run says of itself, as facts for a page: state, device, rig, air, calibration, versions.

The metadata of a run folder come in as they stand in its JSON; what an older or foreign run does
not state is left out or said to be missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchtool.data.run.read import is_run
from benchtool.data.run.run import Run
from benchtool.report.page import Facts, Section

MISSING = "not stated"


def state_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return when, by whom and how it ended."""
    link = metadata.get("link") or {}
    ended = str(metadata.get("state", MISSING))
    if reason := metadata.get("reason"):
        ended += f": {reason}"
    facts = {
        "started": str(metadata.get("started", MISSING)),
        "operator": str(metadata.get("operator") or MISSING),
        "state": ended,
    }
    if "samples" in link:
        facts["samples"] = (
            f"{link['samples']}, lost {link.get('lost', '?')}, "
            f"corrupt frames {link.get('corrupt', '?')}"
        )
    if "seed" in metadata:
        facts["seed of the order"] = str(metadata["seed"])
    return facts


def device_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return who measured, and what it says of itself."""
    device = metadata.get("device") or {}
    facts = {
        "address": str(metadata.get("address", MISSING)),
        "device": f"{metadata.get('device_id', MISSING)}, firmware "
        f"{device.get('firmware', MISSING)}, protocol {device.get('protocol', MISSING)}",
    }
    if "rate_Hz" in device:
        facts["stream"] = f"{device['rate_Hz']:g} Hz: {', '.join(device.get('channels', {}))}"
    if "watchdog_s" in device:
        facts["watchdog"] = f"{device['watchdog_s']:g} s"
    reported = {key: str(value) for key, value in (device.get("facts") or {}).items()}
    if reported:
        facts["it says"] = ", ".join(f"{key} = {value}" for key, value in reported.items())
    return facts


def rig_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the rig's numbers that a reader of thrust needs, and how many are assumed."""
    rig = metadata.get("rig") or {}
    if not rig:
        return {"rig": MISSING}
    p, plate, body = rig.get("propulsion", {}), rig.get("plate", {}), rig.get("body", {})
    facts = {"rig": f"{rig.get('name', '')}: {rig.get('title', '')}"}
    rotors = rig.get("rotors", [])
    facts["rotors"] = f"{len(rotors)}: " + ", ".join(
        f"{item['name']} ({item['x_m']:g}, {item['y_m']:g}) m" for item in rotors
    )
    if p:
        facts["rotor radius"] = f"{p['radius_m']:g} m"
        facts["k of T = k ω², in its file"] = f"{p['thrust_coefficient_N_s2']:g} N/(rad/s)²"
        facts["pulses"] = (
            f"stop {p['pwm_stop_us']:g} µs, start {p['pwm_start_us']:g} µs, "
            f"most {p['pwm_max_us']:g} µs"
        )
    if body:
        facts["mass, pitch inertia"] = f"{body['mass_kg']:g} kg, {body['inertia_yy_kgm2']:g} kg m²"
    if plate:
        facts["plate"] = (
            f"{plate['size_x_m']:g} m × {plate['size_y_m']:g} m, moved by {plate['moved_by']}, "
            f"{plate['z_min_m']:g} m to {plate['z_max_m']:g} m, parked at {plate['z_park_m']:g} m"
        )
    for name, sensor in rig.get("sensors", {}).items():
        facts[f"sensor {name}"] = (
            f"noise {sensor['noise']:g}, quantum {sensor['quantum']:g}, {sensor['rate_Hz']:g} Hz"
        )
    facts["assumed numbers of the rig"] = (
        f"{len(rig.get('assumed', []))} of {len(rig.get('sources', {}))}"
    )
    return facts


def air_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the air around the bench."""
    air = metadata.get("air") or {}
    if not air:
        return {"air": MISSING}
    said = "measured" if air.get("measured") else "nobody measured it: standard values stand in"
    return {
        "air": said,
        "temperature": f"{air['temperature_degC']:g} °C",
        "pressure": f"{air['pressure_Pa'] / 100.0:.2f} hPa",
        "relative humidity": f"{100.0 * air['humidity']:.0f} %",
        "density": f"{air['density_kg_m3']:.4f} kg/m³ ({air.get('formula', MISSING)})",
    }


def calibration_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the load cell's calibration, or that there is none."""
    known = metadata.get("calibration")
    if not known:
        return {"calibration": "none attached: thrust_N is what the device sends"}
    slope_sd = known["covariance"][0][0] ** 0.5
    facts = {
        "calibration": f"{known['id']} of {known['date']}, device {known['device_id']}",
        "slope": f"({known['slope_N_per_count']:.6g} ± {slope_sd:.1g}) N per count",
        "relative standard error": f"{100.0 * known['relative_sd']:.3g} %, common to every thrust",
        "straightness": f"{100.0 * known['straightness']:.3g} % of full scale",
        "masses": f"{len(known['masses_kg'])}, up to {max(known['masses_kg']):g} kg, local gravity "
        f"{known['gravity_m_s2']:g} m/s²",
    }
    if known.get("hysteresis") is not None:
        facts["hysteresis"] = f"{100.0 * known['hysteresis']:.3g} % of full scale"
    if metadata.get("calibration_of_other_device"):
        facts["mind"] = "it was made on another device"
    return facts


def version_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the software that recorded it."""
    versions = metadata.get("versions") or {}
    listed = ", ".join(f"{name} {version}" for name, version in versions.items())
    return {"recorded with": listed or MISSING}


def simple_facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return who measured what, when, in which air, with which calibration: all in short."""
    rig, air = rig_facts(metadata), air_facts(metadata)
    facts: dict[str, str] = {key: rig[key] for key in ("rig", "rotor radius") if key in rig}
    facts["device"] = device_facts(metadata)["device"]
    facts |= state_facts(metadata)
    facts["air"] = air.get("density", MISSING) + ("" if "density" not in air else f", {air['air']}")
    facts |= calibration_facts(metadata)
    return facts | version_facts(metadata)


def run_sections(paths: Iterable[str]) -> list[Section]:
    """Return for each path that is a run: the rig, the air and the calibration."""
    return [
        Section(
            f"The run {Path(path).resolve().name}",
            [Facts(simple_facts(Run.open(Path(path)).metadata))],
        )
        for path in paths
        if is_run(path)
    ]
