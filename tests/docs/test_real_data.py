"""The page on real data shows what its commands print; its numbers agree with published ones."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import exp, hypot, pi
from pathlib import Path

import pytest

from tests.docs.page import Block, blocks_of, run_line

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/explanation/real-data.md"
GRAVITY_M_S2 = 9.80665
RAD_S_PER_RPM = 2.0 * pi / 60.0


@dataclass(frozen=True)
class Shown:
    """One command of the page, the exit code it names and the lines that are shown below it."""

    command: str
    exit_code: int
    lines: tuple[str, ...]


def shown_in(block: Block) -> list[Shown]:
    """Return the commands of a console block."""
    found: list[tuple[str, list[str]]] = []
    for line in block.body.replace("\\\n", " ").splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(" ".join(line.split()))
    code = re.compile(r"#\s*exit (\d+)\s*$")
    return [
        Shown(code.sub("", text), int(end[1]) if (end := code.search(text)) else 0, tuple(lines))
        for text, lines in found
    ]


def run(command: str, folder: Path, data: Path) -> tuple[int, str]:
    """Return the exit code of a command and what it prints, blanks squeezed."""
    machines = str(data.parent / "machines")
    ended = run_line(command, folder, COLUMNS="120", DATA=str(data), MACHINES=machines)
    return ended.returncode, " ".join((ended.stdout + ended.stderr).split())


NUMBER = r"-?\d+(?:\.\d+)?"


def stands_in(line: str, printed: str) -> bool:
    """Return whether a line is printed, its numbers within 2 % and a unit of the last digit."""
    shown = re.findall(NUMBER, line)
    pattern = re.escape(re.sub(NUMBER, "\0", line)).replace(re.escape("\0"), f"({NUMBER})")
    for found in re.finditer(pattern, printed):
        pairs = zip(shown, found.groups(), strict=True)
        if all(
            abs(float(ours) - float(theirs))
            <= 0.02 * abs(float(ours)) + 10.0 ** -len(ours.partition(".")[2])
            for ours, theirs in pairs
        ):
            return True
    return False


def section(title: str) -> str:
    """Return the text of the page's section whose heading begins so."""
    parts = re.split(r"(?m)^## ", PAGE.read_text(encoding="utf-8"))
    return next(part for part in parts if part.startswith(title))


SECTIONS = re.findall(r"(?m)^## (.+)$", PAGE.read_text(encoding="utf-8"))


@pytest.mark.slow
@pytest.mark.parametrize("title", SECTIONS)
def test_commands_print_what_the_page_shows(title, reference_data, tmp_path):
    if "$MACHINES" in section(title) and not (reference_data.parent / "machines").is_dir():
        pytest.skip("no recordings of real machines beside the reference data")
    (tmp_path / "datasets").symlink_to(ROOT / "datasets")
    count = 0
    for block in blocks_of(section(title)):
        if block.mark == "file":
            (tmp_path / block.note).write_text(block.body, encoding="utf-8")
        for shown in shown_in(block) if block.language == "console" else ():
            code, printed = run(shown.command, tmp_path, reference_data)
            assert code == shown.exit_code, f"{shown.command}\n{printed}"
            missing = [line for line in shown.lines if not stands_in(line, printed)]
            assert not missing, f"{shown.command}\n{printed}"
            count += 1
    assert count


def numbers_after(words: str, title: str) -> list[float]:
    """Return the number behind each occurrence of the words in a section."""
    return [
        float(text.replace("−", "-"))
        for text in re.findall(re.escape(words) + r" ([-−]?[\d.]+)", section(title))
    ]


def test_the_coplanar_pair_agrees_with_an_independent_fit():
    """An independent fit of T0/(1 - c (R/4z)^2): c 1.13, T0 20.41 N, chi2/dof 35."""
    pair = section("A pair of rotors")
    (ratio,) = numbers_after("R_over_rotor_radius –", "A pair of rotors")
    k = float(re.findall(r"k = ([\d.e-]+) N", pair)[0])
    assert ratio**2 == pytest.approx(1.13, abs=0.005)
    assert k * (6300.0 * RAD_S_PER_RPM) ** 2 == pytest.approx(20.41, abs=0.005)
    assert numbers_after("rotor_images refused –", "A pair of rotors")[0] == pytest.approx(
        35.0, abs=0.6
    )


def test_crazyflie_coefficients_are_the_published_ones():
    """IMRCLab's kf: 2.26e-8, 2.13e-8 and (eckart1) 2.26e-8 g/rpm^2."""
    gram_rpm2 = RAD_S_PER_RPM**2 / (GRAVITY_M_S2 * 1e-3)
    k = numbers_after("k =", "Crazyflie")
    assert [value * gram_rpm2 for value in k[:3]] == pytest.approx([2.26, 2.13, 2.26], abs=0.005)


def test_the_slow_flyers_coefficient_rises_as_its_file_says(reference_data):
    """C_T of the 10x7 rises by 14 % from 2283 to 5987 rpm; the fitted power agrees within 2 %."""
    rows = (reference_data / "uiuc/apcsf_10x7_static_kt0827.txt").read_text().split("\n")[1:]
    table = [[float(cell) for cell in row.split()] for row in rows if row.strip()]
    (low, c_low, _), (high, c_high, _) = table[0], table[-1]
    excess = numbers_after("thrust_exponent.excess –", "Propellers")[0]
    assert (low, high) == (2283.0, 5987.0)
    assert (high / low) ** excess == pytest.approx(c_high / c_low, abs=0.02)


def test_the_floor_acts_on_the_hovering_quadrotor_as_published():
    """Published: 0.11413538 exp(-5.38792044 z) + 1.0275278, stand 1.1765514e-7 N/rpm^2, 1.5 kg."""
    title, published_a, published_b = "A quadrotor", 0.11413538 / 1.0275278, 5.38792044 * 0.12
    (ca,), (cb,) = (numbers_after(f"exponential_law.{name} –", title) for name in ("Ca", "Cb"))
    errors = re.findall(r"exponential_law.C[ab] – [\d.]+ ± ([\d.]+)", section(title))
    assert abs(ca - published_a) < float(errors[0])
    assert abs(cb - published_b) < float(errors[1])
    (k,) = numbers_after("k 10⁻⁶ N/(rad/s)²", title)
    stand = 1.1765514e-7 / RAD_S_PER_RPM**2
    assert k * 1e-6 / stand == pytest.approx(14.7 / 17.8, abs=0.01)


def test_the_floor_acts_on_the_small_quadrotor_as_its_authors_law_says():
    """Measured with the published thrust law: 9 g of 67 g at 7 to 8 cm, 4.5 g at 10 to 12 cm."""
    title = "A small quadrotor"
    (ca,), (cb,) = (numbers_after(f"exponential_law.{name} –", title) for name in ("Ca", "Cb"))
    found = [ca * exp(-cb * z_m / 0.033) for z_m in (0.075, 0.11)]
    assert found == pytest.approx([9.0 / 67.0, 4.5 / 67.0], rel=0.25)


def test_flights_with_compensators_take_the_same_command_once_steady():
    """Integral action: four flights agree within two standard errors, and with no compensator."""
    text = section("Flights with and without")
    rows = re.findall(r"Ca – ([\d.]+) ± ([\d.]+)", text)[:4]
    (plain, error), *others = [(float(value), float(sd)) for value, sd in rows]
    assert all(abs(value - plain) < 2.0 * hypot(sd, error) for value, sd in others)
