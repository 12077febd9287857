"""From the command line through a virtual autopilot: a map of motors, and a pitch recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchtool.bench.mavlink.settings import read_motor_map
from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_pitch
from benchtool.data.run.run import Run
from tests.system.served import free_port, run, serving

pytestmark = pytest.mark.real_time(deadline_s=0.1)


def test_a_map_is_learnt_and_the_checked_bench_uses_it(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    out = tmp_path / "pquad.motors.toml"
    link = f"mavlink:udpin:127.0.0.1:{free_port()}"
    with serving(link, environment, "--rig", "pquad", "--speed", "10") as address:
        words = ["bench", "map", address, "--rig", "pquad", "--yes", "--out", str(out)]
        guessed = run(words, environment)
        assert guessed.returncode == 2
        assert "nobody to say which rotor a motor turns; give --motors" in guessed.stderr
        words += ["--motors", "1,4,3,2"]
        autopilot = run(words, environment)
        assert autopilot.returncode == 0, autopilot.stderr
        found = read_motor_map(out)
        assert found.motors == (1, 4, 3, 2)
        assert found.outputs == found.escs == (3, 2, 4, 1)
        again = run(words, environment)
        assert again.returncode == 2
        assert "exists already" in again.stderr
        both = run(
            ["bench", "check", f"{address}&map={out}", "--rig", "pquad", "--yes"], environment
        )
        assert both.returncode == 0, both.stderr
        assert "all 14 checks passed on mavlink-" in both.stdout
        together = ["--pwm", "1400", "--z-over-r", "1", "--yes", "--out", str(tmp_path / "all")]
        refused = run(["sweep", f"{address}&map={out}", "--rig", "pquad", *together], environment)
        assert refused.returncode == 2
        assert "motor test turns 1 at a time; name one with --rotors 1" in refused.stderr


def test_orders_are_signed_with_the_key_of_a_file(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    key = tmp_path / "key.txt"
    key.write_text("a pass phrase")
    link = f"mavlink:udpout:127.0.0.1:{free_port()}"
    served = ["--rig", "pquad_single", "--speed", "10", "--key", str(key)]
    check = ["--rig", "pquad_single", "--yes"]
    with serving(link, environment, *served) as address:
        assert address.endswith(f"?rotors=1&key={key}")
        signed = run(["bench", "check", address, *check], environment)
        assert signed.returncode == 0, signed.stderr
        unsigned = run(["bench", "check", address.partition("&key")[0], *check], environment)
        assert unsigned.returncode == 3
        assert "signs its frames and takes no order without a signature" in unsigned.stderr


def test_a_pitch_experiment_is_recorded(tmp_path: Path, environment: dict[str, str]) -> None:
    link = f"mavlink:udpout:127.0.0.1:{free_port()}"
    pitch = ["--rig", "pquad", "--speed", "5", "--mode", "pitch"]
    folder = tmp_path / "pitch"
    with serving(link, environment, *pitch) as address:
        assert address.endswith("?rotors=4&mode=pitch&arm=host")
        # At five times real time 250 Hz are more than a busy machine reads.
        words = ["record", f"{address}&rate=50", "--rig", "pquad", "--seconds", "15", "--yes"]
        recorded = run([*words, "--out", str(folder)], environment)
        assert recorded.returncode == 0, recorded.stderr
        assert "warning: the address has no map=, so rotor 1" in recorded.stdout
        unarmed = address.replace("&arm=host", "")
        alone = run(
            ["record", unarmed, "--rig", "pquad", "--seconds", "5", "--yes", "--out", f"{folder}2"],
            environment,
        )
        assert alone.returncode == 3
        assert "it is not armed; arm it with its transmitter first" in alone.stderr
    recording = read_pitch(folder)
    needed = {"theta_rad", "gyro_rad_s", "theta_ref_rad", "plate_z_m", "pwm1_us", "rpm4"}
    assert needed <= set(recording.names)
    theta = recording.column("theta_rad")
    assert np.isfinite(theta).sum() > 500
    assert 0.0 < np.nanmax(np.abs(theta)) < 0.2
    assert np.nanmin(recording.column("plate_z_m")) < 0.5
    # Those of the loop on board, not the constant pulse that the host asked for.
    pulses = [recording.column(f"pwm{rotor}_us") for rotor in (1, 2, 3, 4)]
    assert min(np.nanmin(one) for one in pulses) > 1100.0
    assert max(len(np.unique(one[np.isfinite(one)])) for one in pulses) > 3
    assert Run.open(folder).metadata["device"]["facts"]["mode"] == "pitch"
    told = [event.text for event in read_events(folder / "events.jsonl")]
    assert "collective 1599 us" in told
