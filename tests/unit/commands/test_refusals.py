"""Words that a command refuses: one sentence, exit code 2, and nothing is left behind."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from benchtool.commands.app import main

REFUSED = {
    "bench bridge": [
        ("--out taken.js", "taken.js exists already and was left as it is"),
        ("--out bridge", "is no name of a script; end it in .js"),
        ("--out nowhere/bridge.js", "cannot be written"),
        ("--out x.js --rig pquad", "has 4 rotors"),
        ("--out x.js --host lab", "is no IPv4 address"),
        ("", "Missing option '--out'"),
    ],
    "firmware": [
        ("--board mega --out bench", "unknown board 'mega'; known: nano, uno"),
        ("--rig pquad --out bench", "has 4 motors"),
        ("--out taken", "taken exists already and was left as it is"),
        ("--out taken/file/bench", "cannot be written"),
        ("", "Missing option '--out'"),
    ],
    "simulate flight": [
        ("--case ovr", "did you mean 'over'"),
        ("--controllers pdi", "unknown controller of a flight 'pdi'"),
        ("--controllers ,", "--controllers names nothing"),
        ("--layout x", "known: cross, plus"),
        ("--map-offset-m 1,2", "give 3 numbers"),
        ("--map-offset-m nan,0,0", "--map-offset-m names nan m"),
        ("--goal-m inf,0", "--goal-m names inf m"),
        ("--z-over-r nan", "--z-over-r is nan, allowed is above 0"),
        ("--speed-m-s -1", "--speed-m-s is -1 m/s, allowed is 0.001 to 50 m/s"),
        ("--gyro-noise-rad-s inf", "--gyro-noise-rad-s is inf rad/s"),
        ("--rig pquad_single", "four rotors or more"),
        ("--lag-s 0.001", "add --set step_s=0.0004"),
        ("--lag-s 1e-9", "lag_s is 1e-09; give at least 2e-06 s"),
        ("--set step_s=0", "step_s is 0; give 1e-06 to 0.004"),
        ("--set gains.control_rate_Hz=1e9", "control_rate_Hz is 1e+09; give 1 to 100000"),
        ("--set gains.control_rate_Hz=1e-9", "control_rate_Hz is 1e-09; give 1 to 100000"),
        ("--controllers PID", "did you mean 'pid'"),
        ("--vary sped=0.2:1:3 --out x", "did you mean 'speed_m_s'? known: K_b, drag"),
        ("--vary gains.atitude=1:2:3 --out x", "did you mean 'attitude'? known: alti"),
        ("--vary speed=1:0.2:3 --out x", "is no range; give FROM below TO"),
        ("--vary speed=nan:1:3 --out x", "write NAME=FROM:TO:COUNT"),
        ("--vary speed=0.2:1:3 --seeds 0 --out x", "--seeds is 0, allowed is 1 or more"),
        ("--vary speed=0.2:1:3 --samples -1 --out x", "--samples is -1, allowed is 0 or more"),
        ("--vary speed=0:1:3 --out x", "goal speed_m_s is 0"),
        ("--vary speed=0.01:1:3 --out x", "hardly any could arrive"),
        ("--vary speed=0.2:1:3", "add --out FOLDER"),
        ("--vary speed=0.2:1:3 --vary speed_m_s=1:2:3 --out x", "twice"),
        ("--vary K_b=1:2:3 --measure arive --out x", "did you mean 'arrives'"),
        ("--vary K_b=1:2:3 --controllers ogi --out x", "feedforward, observer, oge"),
        ("--vary K_b=1:2:3 --controllers pid,pid --out x", "name each once"),
        ("--vary K_b=1:2:3 --gains s4 --out x", "known: s1a, s3, stiff"),
        ("--vary K_b=1:2:3 --seeds 3 --gyro-noise-rad-s 0 --out x", "all would be alike"),
        ("--samples 3", "--samples is for a campaign"),
        ("--measure struck", "--measure is for a campaign"),
        ("--gains s3 --gains stiff", "2 gain sets (s3, stiff) are for a campaign"),
        ("--controllers oge", "unknown controller of a flight 'oge'"),
        ("--set K_b=nan", "write NAME=NUMBER"),
        ("--vary K_b=1:2:3 --out taken.js", "taken.js exists already"),
    ],
    "simulate pitch": [
        ("--controllers pdi", "unknown controller"),
        ("--controllers ,", "--controllers names nothing"),
        ("--controllers no_such_module_here:Law", "No module named"),
        ("--controllers math:Law", "has no class Law with a method step"),
        ("--gains s4", "unknown gain set"),
        ("--schedule plat", "did you mean 'plate'"),
        ("--set K_b", "write NAME=NUMBER"),
        ("--set K_b=nan", "write NAME=NUMBER"),
        ("--set Kb=2", "unknown number to set or vary 'Kb'"),
        ("--set stiffness_Nm_per_rad=2", "hinge_spring.stiffness"),
        ("--set coulomb_friction.torque_Nm=-1", "outside its bounds"),
        ("--set motor_lag.tau_s=0.0001", "raise plant_rate_Hz to 20000"),
        ("--set bench.inertia_kgm2=0", "inertia_kgm2 is 0"),
        ("--set bench.mass=1", "known: inertia_kgm2"),
        ("--set gains.attitude.kq=1", "known: k_i_q_per_s2"),
        ("--duration-s -1", "--duration-s is -1 s, allowed is above 0"),
        ("--controllers PID", "did you mean 'pid'"),
        ("--controllers obs", "did you mean 'observer'"),
        ("--gains S3", "did you mean 's3'"),
        ("--set motor_lag.tau_s=1e-300", "tau_s is 1e-300 s; give at least 2e-05 s, or 0"),
        ("--set bench.inertia_kgm2=1e300", "inertia_kgm2 is 1e+300; give 1e-06 to 10000"),
        ("--set inertia_kgm2=1e-12", "inertia_kgm2 is 1e-12; give 1e-06 to 10000"),
        ("--set bench.stop_rad=-1", "bench.stop_rad is -1; give 0.001 to 1.5"),
        ("--set bench.pwm_quantum_us=-1", "bench.pwm_quantum_us is -1; give 0 to 1000"),
        ("--set gains.control_rate_Hz=1e9", "control_rate_Hz is 1e+09; give 1 to 100000"),
        ("--set gains.control_rate_Hz=1e-9", "control_rate_Hz is 1e-09; give 1 to 100000"),
        ("--set gains.control_rate_Hz=333", "the controller at 333 Hz"),
        ("--set bench.plant_rate_Hz=100", "the plant runs at 100 Hz"),
        ("--set feedforward.strength=-1", "feedforward.strength is -1; give 0 to 10"),
        ("--set feedforward.height_error_m=1e9", "height_error_m is 1e+09; give -10 to 10"),
        ("--set feedforward.late_s=1e300", "late_s is 1e+300; give -3600 to 3600"),
        ("--set feedforward.dropout=2", "known: height_error_m, late_s, strength"),
        ("--vary K_b=1:2:1000000000", "are 1000000000 runs; give at most 10000000"),
        ("--vary K_b=1:inf:3", "write NAME=FROM:TO:COUNT"),
        ("--vary K_b=1:2:3", "add --out FOLDER"),
        ("--vary K_b=1:2:3 --vary K_b=1:2:3 --out x", "one number twice"),
        ("--vary Kb=1:2:3 --out x", "unknown number to set or vary"),
        ("--vary K_b=1:2:3 --measure rms --out x", "did you mean 'rms_deg'"),
        ("--vary K_b=1:2:3 --seeds 0 --out x", "--seeds is 0, allowed is 1 or more"),
        ("--vary K_b=2:1:3 --out x", "is no range"),
        ("--seeds 3", "--seeds is for a campaign; add --vary"),
        ("--gains s3 --gains stiff", "2 gain sets (s3, stiff) are for a campaign"),
        ("--gains s3,s3 --vary K_b=1:2:3 --out x", "--gains is s3, s3; name each once"),
        ("--vary gains.control_rate_Hz=250:500:2 --out x", "cannot vary control_rate"),
    ],
}


@pytest.mark.parametrize(
    ("command", "words", "sentence"),
    [(command, *case) for command, cases in REFUSED.items() for case in cases],
)
def test_it_is_refused_in_one_sentence_and_leaves_nothing(
    command: str,
    words: str,
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken.js").write_text("mine")
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "file").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SystemExit) as leaving:
        main([*command.split(), *shlex.split(words)])
    error = capsys.readouterr().err
    assert leaving.value.code == 2
    assert sentence in error
    sentences = [line for line in error.splitlines() if not line.startswith("runs Python code of")]
    assert len(sentences) == 1
    assert sorted(tmp_path.rglob("*")) == before
