"""The paper's claims about control near surfaces, each held against simulations of it.

What the paper says, and the words of each outcome, are in `library/paper/claims.toml`; here is how
the numbers are found and when a claim comes out. The bench's absolute degrees follow
from assumed inertia, friction and gains: what distinguishes the controllers is held against the
paper, never its figures' degrees.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass, field, replace
from functools import cache
from importlib import resources
from textwrap import wrap
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchtool.core.counted import counted
from benchtool.core.parsed_text import parse_toml
from benchtool.core.rig import Rig
from benchtool.core.rig_file import rig_named
from benchtool.fit.run_recipe import FitOutput
from benchtool.report.flight.pitch_study import pitch_study, visit_numbers
from benchtool.report.paper.curves import level_moment_Nm
from benchtool.simulate.flight.cases import GYRO_NOISE_RAD_S, PLATE_S, flight_case
from benchtool.simulate.flight.flight import Flight
from benchtool.simulate.flight.measures import Measures
from benchtool.simulate.flight.study import Flown, fly_and_measure
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import Gains, gains_named
from benchtool.simulate.pitch.attitude import READINGS, hover_authority_Nm, restoring_moment_Nm
from benchtool.simulate.pitch.setup import changed, pitch_setup

HOLDS = "comes out"
FAILS = "does not come out"
UNCLEAR = "not distinguishable"
CONSTRUCTED = "by construction"
VERDICTS = (HOLDS, FAILS, UNCLEAR, CONSTRUCTED)
"""Every verdict on a claim; the last two are no confirmations."""

NOISE_SEEDS = (1, 2, 3, 4)
"""Four seeds, as in the notes' table."""

SAME_WIDTH = 0.05
"""A change of the oscillation's width by less than this share, either way, is no amplification."""

BENCH_SEED = 1
"""Of the pitch bench's noise."""

SLOW_INTEGRAL = {"gains.attitude.k_i_theta_per_s2": 0.5}
"""S3 with a slow integral of the attitude, as the notes tried."""

FREE_HINGE = {"coulomb_friction.torque_Nm": 0.0, "wake_torque.sd_Nm": 0.0}
"""Neither friction nor random torque, so that a controller's own residual shows."""

SCATTER, SETS = 0.10, 9
"""Joint random change of the seven gains, either way, in so many sets (as in the notes' study)."""

SEVEN = (
    "position.k_x_per_s", "position.k_v_per_s", "position.k_iv_per_s2",
    "position.integral_limit_m_s2", "attitude.k_theta_per_s", "attitude.k_q_per_s",
    "observer.rate_per_s",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """Hold one claim and what became of it.

    Attributes:
        by: who says it: the paper, or the planar study that this simulator is held to.
        gains: the gain set, or what was changed in it.
    """

    where: str
    by: str = "paper"
    says: str
    found: str
    gains: str = "s3"
    verdict: str


@dataclass(frozen=True, slots=True)
class Flights:
    """Fly cases for the claims, each once: what flies, the flights by their inputs, and fits of the
    user's own recipes, for the figures.
    """

    rig: Rig = field(default_factory=lambda: rig_named("pquad"))
    flown: dict[Any, Flown] = field(default_factory=dict)
    fits: dict[str, FitOutput] = field(default_factory=dict)

    def fly(
        self,
        name: str,
        control: str = "pid",
        z_over_R: float | None = 2.0,
        speed_m_s: float = 0.2,
        gains: Gains | str = "s3",
        vehicle: FlightVehicle | None = None,
        **changes: Any,
    ) -> Flown:
        craft = vehicle or FlightVehicle.of_rig(self.rig)
        known = gains_named(gains) if isinstance(gains, str) else gains
        case = flight_case(
            name, craft, known, z_over_R=z_over_R, speed_m_s=speed_m_s, control=control, **changes
        )
        plain = {key: value for key, value in changes.items() if key != "below"}
        below = repr(case.below.blocks)
        craft_key = repr(craft.identity)
        key = (name, control, z_over_R, speed_m_s, repr(known), craft_key, repr(plain), below)
        if key not in self.flown:
            self.flown[key] = fly_and_measure(case)
        return self.flown[key]

    def measure(self, name: str, *words: Any, **changes: Any) -> Measures:
        return self.fly(name, *words, **changes).measures


def paper_claims(flights: Flights) -> list[Claim]:
    """Return what comes out of each claim of sections 2.4, 3.2 to 3.5 and 4."""
    texts = _texts()
    numbers = {
        **{name: _flight_numbers(flights, **how) for name, how in texts["flights"].items()},
        "noise": _noise_numbers(flights),
        "plate": _plate_numbers(flights.fly("plate").flight),
        "tilt": _tilt_numbers(rig_named("pquad")),
        "bench": _bench_numbers("pquad", "s3"),
        "bench_slow": _bench_numbers("pquad", "s3", SLOW_INTEGRAL),
        "bench_free": _bench_numbers("pquad", "s3", FREE_HINGE),
        "bench_amuse": _bench_numbers("amuse", "s3"),
        "bench_stiff": _bench_numbers("pquad", "stiff"),
    }
    more_m = numbers["early_5"].max_x_m - numbers["edge_free"].max_x_m
    numbers["map_5"] = SimpleNamespace(more_cm=100 * more_m)
    claims = []
    for entry in texts["claim"]:
        text = {key: value for key, value in entry.items() if key != "id"}
        text["found"] = text["found"].format(**numbers)
        found = COMES_OUT[entry["id"]](SimpleNamespace(**numbers))
        claims.append(Claim(verdict=found if isinstance(found, str) else _verdict(found), **text))
    return claims


COMES_OUT: dict[str, Callable[[Any], Any]] = {
    "wall": lambda n: not n.low.arrives and n.low.push_backs > 5,
    "wall_stiff": lambda n: not n.stiff.arrives,
    "weaker": lambda n: n.high.arrives and n.high.push_backs < n.low.push_backs,
    "crosses_fast": lambda n: (
        n.fast.arrives and np.ptp(n.fast.edge_pitch_deg) > 5.0 * np.ptp(n.calm.edge_pitch_deg)
    ),
    "oscillates": lambda n: not n.edge.arrives and n.edge.swing_m > 0.1,
    "oscillates_fast": lambda n: not n.edge_fast.arrives and n.edge_fast.swing_m > 0.1,
    "noise": lambda n: True if n.noise.least_percent > 100 * SAME_WIDTH else UNCLEAR,
    "observer": lambda n: n.observer_high.push_backs == 0 and n.observer.arrives,
    "observer_faster": lambda n: n.observer_high.arrives_s < n.high.arrives_s,
    "observer_edge": lambda n: n.observer_edge.arrives and n.observer_edge.swing_m < 0.01,
    "forward": lambda n: (
        CONSTRUCTED if n.forward.rms_pitch_deg < n.observer.rms_pitch_deg else FAILS
    ),
    "map_5": lambda n: n.early_5.arrives and n.map_5.more_cm > 0.0,
    "map_15": lambda n: n.early_15.ending == "struck" or n.early_15.swing_m > n.edge.swing_m,
    "map_15_soft": lambda n: n.soft_15.ending != "flown" or n.soft_15.swing_m > n.soft_edge.swing_m,
    "map_15_stiff": lambda n: n.stiff_15.ending != "flown" or not n.stiff_15.arrives,
    "free_hover": lambda n: (
        n.plate.comes_deg * n.plate.goes_deg < 0.0
        and abs(n.plate.goes_deg) > 0.3 * abs(n.plate.comes_deg)
    ),
    "stabilizing": lambda n: n.tilt.stabilizing,
    "not_considerable": lambda n: n.tilt.percent[2, 1] < 5.0 and n.tilt.percent[0, 1] > 8.0,
    "against_partial": lambda n: n.tilt.images_mNm < 0.5 * n.tilt.wall_mNm,
    "bench_pid": lambda n: abs(n.bench.pid.residual_deg) > 0.5,
    "alike": lambda n: UNCLEAR,
    "bench_forward": lambda n: abs(n.bench.feedforward.peak_deg) < 0.3 * abs(n.bench.pid.peak_deg),
    "bench_observer": lambda n: (
        abs(n.bench.observer.peak_deg) < 0.3 * abs(n.bench.pid.peak_deg)
        and abs(n.bench.observer.residual_deg) < 0.3 * abs(n.bench.observer.peak_deg)
    ),
    "which_is_better": lambda n: UNCLEAR,
    "rebound": lambda n: n.bench_slow.pid.rebound_deg > 0.5 and n.bench.pid.rebound_deg < 0.1,
}
"""When each claim comes out, or the verdict where that is another."""


@cache
def _texts() -> dict[str, Any]:
    name = "paper/claims.toml"
    return parse_toml((resources.files("benchtool") / "library" / name).read_text("utf-8"), name)


def _verdict(comes_out: bool) -> str:
    return HOLDS if comes_out else FAILS


def _flight_numbers(flights: Flights, oge: bool = False, **how: Any) -> SimpleNamespace:
    """Return the measures of a flight with what the texts say of them; `oge`: over nothing."""
    flown = flights.fly(**how | ({"z_over_R": None} if oge else {}))
    found, x_m = flown.measures, flown.flight["x_m"]
    arrival = f"never, x {found.range_m[0]:.2f} to {found.range_m[1]:.2f} m"
    if found.ending == "struck":
        arrival = "strikes the obstacle"
    elif found.arrives:
        arrival = f"{found.arrives_s:.1f} s"
    pitch_deg = np.degrees(flown.flight["pitch_rad"])[(x_m > 2.5) & (x_m < 4.5)]
    return SimpleNamespace(
        **{name: getattr(found, name) for name in Measures.__slots__},
        arrives=found.arrives,
        swing_m=found.swing_m,
        swing_mm=1e3 * found.swing_m,
        arrival=arrival,
        edge_pitch_deg=(np.min(pitch_deg, initial=np.inf), np.max(pitch_deg, initial=-np.inf)),
    )


def _noise_numbers(flights: Flights) -> SimpleNamespace:
    """Return what gyro noise does to the width of the oscillation (Fig. 15)."""
    quiet_m = flights.measure("edge", speed_m_s=1.0).swing_m
    noise = {"speed_m_s": 1.0, "gyro_noise_rad_s": GYRO_NOISE_RAD_S}
    widths = [flights.measure("edge", **noise, seed=seed).swing_m for seed in NOISE_SEEDS]
    least, most = min(widths), max(widths)
    return SimpleNamespace(
        seeds=len(widths),
        least_m=least,
        most_m=most,
        least_percent=100 * (least / quiet_m - 1.0),
        most_percent=100 * (most / quiet_m - 1.0),
    )


def _plate_numbers(flight: Flight) -> SimpleNamespace:
    """Return the first bump of the pitch when a plate comes and when it goes (Fig. 30)."""
    came, _, left, _ = PLATE_S
    return SimpleNamespace(
        comes_deg=first_bump_deg(flight, came), goes_deg=first_bump_deg(flight, left)
    )


def first_bump_deg(flight: Flight, begin_s: float) -> float:
    """Return the first extreme of the pitch beyond a quarter degree after a time: deg."""
    pitch = np.degrees(flight["pitch_rad"][flight["time_s"] >= begin_s])
    pitch = pitch - pitch[0]
    start = int(np.argmax(np.abs(pitch) > 0.25))
    turns = np.flatnonzero(np.diff(np.abs(pitch[start:])) < 0.0)
    return float(pitch[start + (int(turns[0]) if turns.size else 0)])


def _tilt_numbers(rig: Rig) -> SimpleNamespace:
    """Return restoring moments of a tilt over ground (section 2.4) under each reading."""
    heights, tilts = np.array([1.0, 1.5, 2.0, 3.0, 5.0]), np.radians([5.0, 10.0])
    moments = {name: restoring_moment_Nm(rig, heights, tilts, name) for name in READINGS}
    return SimpleNamespace(
        percent=100.0 * moments["images"] / hover_authority_Nm(rig),
        stabilizing=all(bool(np.all(each > 0.0)) for each in moments.values()),
        half_mNm=1e3 * moments["images"][2, 0],
        **{f"{name}_mNm": 1e3 * each[2, 1] for name, each in moments.items()},
        one_mNm=1e3 * level_moment_Nm(rig, 1),
        wall_mNm=1e3 * level_moment_Nm(rig, 3),
    )


def _bench_numbers(
    rig: str, gains: str, settings: dict[str, float] | None = None
) -> SimpleNamespace:
    """Return peak, residual and rebound (deg) on the pitch bench under each controller."""
    names = ("pid", "feedforward", "observer")
    setup = pitch_setup(rig=rig, gains=gains, controllers=names)
    setup = changed(setup, settings) if settings else setup
    study = pitch_study(setup, BENCH_SEED)
    visit, shown = setup.schedule.plate[0], SimpleNamespace()
    for name, run in zip(names, study.runs, strict=True):
        found = visit_numbers(run, visit, setup.schedule.duration_s)
        degrees = {
            f"{key}_deg": float(np.degrees(getattr(found, f"{key}_rad")))
            for key in ("peak", "residual", "rebound")
        }
        setattr(shown, name, SimpleNamespace(**degrees))
    return shown


STILL_THERE = "still pushed back, and carried over by the observer"


def sensitivity_claims(flights: Flights) -> list[Claim]:
    """Return one row per change of S3: is the wall still there, does the observer still cross?"""
    base = gains_named("s3")
    rows = [_changed_claim(flights, base, **change) for change in _texts()["change"]]
    return [*rows, _joint_claim(flights, base)]


def _changed_claim(
    flights: Flights,
    base: Gains,
    name: str,
    wall: bool = True,
    expects: str = "",
    factors: dict[str, float] | None = None,
    values: dict[str, float] | None = None,
    vehicle: dict[str, Any] | None = None,
    case: dict[str, Any] | None = None,
    arm_m: float = 0.0,
) -> Claim:
    numbers = {key: _gain(base, key) * factor for key, factor in (factors or {}).items()}
    rig = _with_arm(flights.rig, arm_m) if arm_m else flights.rig
    how: dict[str, Any] = {
        "gains": base.with_values(**numbers, **(values or {})),
        "vehicle": FlightVehicle.of_rig(rig, **(vehicle or {})),
        **(case or {}),
    }
    over, edge = flights.measure("over", **how), flights.measure("edge", **how)
    helped = flights.measure("over", "observer", **how)
    there = not over.arrives
    found = (
        f"PID {'never crosses' if there else f'crosses in {over.arrives_s:.1f} s'} "
        f"({over.push_backs} push-backs), swings {edge.swing_m:.2f} m at the edge; observer "
        f"{f'crosses in {helped.arrives_s:.1f} s' if helped.arrives else 'does not cross'}"
    )
    return Claim(
        where="sensitivity",
        by="study",
        says=f"{name}: {expects or (STILL_THERE if wall else 'PID crosses')}",
        found=found,
        gains="s3, changed",
        verdict=_verdict(there == wall and (helped.arrives or not wall)),
    )


def _gain(gains: Gains, key: str) -> float:
    table, _, name = key.partition(".")
    return float(getattr(getattr(gains, table), name))


def _with_arm(rig: Rig, arm_m: float) -> Rig:
    factor = arm_m / max(abs(rotor.x_m) for rotor in rig.rotors)
    rotors = (replace(each, x_m=factor * each.x_m, y_m=factor * each.y_m) for each in rig.rotors)
    return replace(rig, rotors=tuple(rotors))


def _joint_claim(flights: Flights, base: Gains) -> Claim:
    """Return how many random gain sets near S3 still show wall, oscillation and rescue."""
    rng = np.random.default_rng(17)
    same = 0
    for _ in range(SETS):
        factors = rng.uniform(1.0 - SCATTER, 1.0 + SCATTER, len(SEVEN))
        numbers = {key: _gain(base, key) * f for key, f in zip(SEVEN, factors, strict=True)}
        gains = base.with_values(**numbers)
        same += bool(
            not flights.measure("over", gains=gains).arrives
            and flights.measure("over", speed_m_s=1.0, gains=gains).arrives
            and flights.measure("edge", gains=gains).swing_m > 0.1
            and flights.measure("over", "observer", gains=gains).arrives
            and flights.measure("edge", "observer", gains=gains).swing_m < 0.02
        )
    return Claim(
        where="sensitivity",
        by="study",
        says="all seven gains at once by up to 10 %: 8 of 9 sets keep everything",
        found=f"{same} of {SETS} random sets keep the wall, its crossing at 1 m/s, the oscillation "
        f"and the observer's rescue of both",
        gains="s3 +-10 %",
        verdict=_verdict(same >= 6),
    )


def claim_lines(claims: Sequence[Claim], width: int = 110) -> Iterator[str]:
    """Give the table as lines of plain text: one block per claim."""
    for number, claim in enumerate(claims, 1):
        yield f"{number:>2}  {claim.verdict.upper():<20} [{claim.where}; gains {claim.gains}]"
        for word, text in ((claim.by, claim.says), ("here", claim.found)):
            lines = wrap(text, width - 11)
            yield f"    {word:>5}: {lines[0]}"
            yield from (f"           {line}" for line in lines[1:])
    counts = ", ".join(
        f"{sum(claim.verdict == verdict for claim in claims)} {verdict}" for verdict in VERDICTS
    )
    yield f"{counted(len(claims), 'row')}: {counts}"


def claim_csv(claims: Sequence[Claim]) -> str:
    """Return the table as CSV text."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["where", "by", "says", "comes_out", "gains", "verdict"])
    writer.writerows(astuple(claim) for claim in claims)
    return buffer.getvalue()
