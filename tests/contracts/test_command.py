"""All commands: declared inputs, help and error messages.

A new command needs a row in `REFUSED` and an update of docs/reference/commands.md
(`python docs/reference/write_commands.py`).
"""

from __future__ import annotations

import ast
import re
from importlib import import_module
from pathlib import Path

import pytest

from benchtool import acquire
from benchtool.acquire.plan import Plan, plan_from_toml
from benchtool.acquire.visit_order import expected_duration_s, plan_visits
from benchtool.commands.app import COMMANDS, command_module
from benchtool.core.inputs import InputField, items
from benchtool.core.rig_file import load_rig_by_name
from tests.unit.commands.command_line import run

RUNNABLE = [name for name, (where, _) in COMMANDS.items() if where]

REFUSED: dict[str, list[tuple[str, str]]] = {  # arguments, part of the error message
    "demo": [("--seed -1", "--seed is -1, allowed is")],
    "sweep": [("sim:pquad --dry-run --tilt 900", "--tilt names 900 deg, allowed is -89 to 89 deg")],
    "record": [
        ("sim:pquad?mode=pitch --limit-deg 100", "--limit-deg is 100 deg, allowed is"),
        (
            "sim:pquad?mode=pitch&schedule=zz --rig pquad --dry-run",
            "unknown schedule or file 'zz'",
        ),
        ("sim:pquad?mode=pitch&controller=pdi --rig pquad --dry-run", "did you mean 'pid'"),
        ("sim:pquad?mode=pitch&gains=s4 --rig pquad --dry-run", "'s4'"),
        ("tcp:here --rig pquad --dry-run", "needs host and port"),
    ],
    "runs list": [("--z-over-r 1", "--z-over-r is '1'; give 2 numbers separated by commas")],
    "runs search": [("x --folder nowhere", "there is no folder nowhere")],
    "runs query": [("DROP --folder nowhere", "there is no folder nowhere")],
    "runs show": [("nowhere", "nowhere: it is not in the runs folder")],
    "runs compare": [("nowhere", "only one run, nowhere; give two or more")],
    "runs tag": [("nowhere a", "nowhere: there is no such folder")],
    "runs note": [("nowhere b", "nowhere: there is no such folder")],
    "runs verify": [("nowhere", "nowhere: it is not in the runs folder")],
    "runs export": [("nowhere x.mcap", "nowhere: there is no such run")],
    "runs merge": [
        ("nowhere --out x", "only one run, nowhere; give two or more"),
        ("nowhere other --out x", "nowhere: this is not a run folder"),
    ],
    "runs close": [("nowhere", "nowhere")],
    "calibrate": [
        ("--gravity 1", "--gravity is 1 m/s2, allowed is 9.76 to 9.84 m/s2"),
        ("--apply nowhere", "nowhere"),
        ("sim:pquad --apply nowhere", "--apply excludes ADDRESS; remove one of them"),
        ("--apply nowhere --mass-u 0.1 --add x", "--apply excludes --mass-u, --add; remove"),
        ("sim:pquad --masses 0,1 --other-device", "--other-device need a run; add --apply RUN"),
    ],
    "import": [("a.csv --near-m -1", "--near-m is -1 m, allowed is 0 to 100,000 m")],
    "export": [
        ("single --to unity", "unknown --to 'unity'; known: all, ardupilot"),
        ("nowhere --to c", "unknown model or file 'nowhere'"),
    ],
    "fit": [("a.csv --model quad --loss hubre", "unknown --loss 'hubre'; did you mean 'huber'?")],
    "explain": [("a.csv --draws 3", "--draws is 3, allowed is 20 to 100,000")],
    "report": [("a.csv --motors 0,1", "--motors names 0, allowed is 1 or more")],
    "simulate pitch": [
        ("--seeds 0", "--seeds is 0, allowed is 1 or more"),
        ("--controllers pdi", "unknown controller"),
        ("--controllers ,", "--controllers is empty"),
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
        ("--set motor_lag.tau_s=1e-300", "tau_s is 1e-300 s; allowed: from 2e-05 s, or 0"),
        ("--set bench.inertia_kgm2=1e300", "inertia_kgm2 is 1e+300; allowed: 1e-06 to 10000"),
        ("--set inertia_kgm2=1e-12", "inertia_kgm2 is 1e-12; allowed: 1e-06 to 10000"),
        ("--set bench.stop_rad=-1", "bench.stop_rad is -1; allowed: 0.001 to 1.5"),
        ("--set bench.pwm_quantum_us=-1", "bench.pwm_quantum_us is -1; allowed: 0 to 1000"),
        ("--set gains.control_rate_Hz=1e9", "control_rate_Hz is 1e+09; allowed: 1 to 100000"),
        ("--set gains.control_rate_Hz=1e-9", "control_rate_Hz is 1e-09; allowed: 1 to 100000"),
        ("--set gains.control_rate_Hz=333", "the controller at 333 Hz"),
        ("--set bench.plant_rate_Hz=100", "the plant runs at 100 Hz"),
        ("--set feedforward.strength=-1", "feedforward.strength is -1; allowed: 0 to 10"),
        ("--set feedforward.height_error_m=1e9", "height_error_m is 1e+09; allowed: -10 to 10"),
        ("--set feedforward.late_s=1e300", "late_s is 1e+300; allowed: -3600 to 3600"),
        ("--set feedforward.dropout=2", "known: height_error_m, late_s, strength"),
        ("--vary K_b=1:2:1000000000", "are 1000000000 runs; allowed: up to 10000000"),
        ("--vary K_b=1:inf:3", "write NAME=FROM:TO:COUNT"),
        ("--vary K_b=1:2:3", "add --out FOLDER"),
        ("--vary K_b=1:2:3 --vary K_b=1:2:3 --out x", "occurs twice in --vary"),
        ("--vary Kb=1:2:3 --out x", "unknown number to set or vary"),
        ("--vary K_b=1:2:3 --measure rms --out x", "did you mean 'rms_deg'"),
        ("--vary K_b=1:2:3 --seeds 0 --out x", "--seeds is 0, allowed is 1 or more"),
        ("--vary K_b=2:1:3 --out x", "range of K_b is invalid"),
        ("--seeds 3", "--seeds needs a campaign; add --vary"),
        ("--gains s3 --gains stiff", "2 gain sets (s3, stiff) need a campaign"),
        ("--gains s3,s3 --vary K_b=1:2:3 --out x", "--gains is s3, s3; name each once"),
        ("--vary gains.control_rate_Hz=250:500:2 --out x", "control_rate_Hz cannot be varied"),
        ("--duration-s 1e9", "at most 3,600 s"),
        ("--set gain.attitude=2", "did you mean 'gains.attitude'"),
        ("--set bench.plant_rate_Hz=1e9", "bench.plant_rate_Hz is 1e+09; allowed: up to 100000"),
        ("--schedule steps --set plate.z_over_R=2", "schedule 'steps' has no plate"),
        ("--set plate.z_over_R=0", "plate.z_over_R is 0; allowed: above 0, up to 100"),
        ("--set plate.z_over_R=101", "is 101; allowed: above 0, up to 100"),
        ("--vary plate.z_over_R=1:2:3 --out x", "plate.z_over_R cannot be varied"),
    ],
    "simulate flight": [
        ("--lag-s -1", "--lag-s is -1 s, allowed is 0 to 10 s"),
        ("--case ovr", "did you mean 'over'"),
        ("--controllers pdi", "unknown controller (and not of the form module:Class) 'pdi'"),
        ("--controllers ,", "--controllers is empty"),
        ("--layout x", "known: cross, plus"),
        ("--map-offset-m 1,2", "give 3 numbers"),
        ("--map-offset-m nan,0,0", "--map-offset-m names nan m"),
        ("--goal-m inf,0", "--goal-m names inf m"),
        ("--z-over-r nan", "--z-over-r is nan, allowed is above 0"),
        ("--speed-m-s -1", "--speed-m-s is -1 m/s, allowed is 0.001 to 50 m/s"),
        ("--gyro-noise-rad-s inf", "--gyro-noise-rad-s is inf rad/s"),
        ("--rig pquad_single", "four rotors or more"),
        ("--lag-s 0.001", "add --set step_s=0.0004"),
        ("--lag-s 1e-9", "lag_s is 1e-09; allowed: from 2e-06 s"),
        ("--set step_s=0", "step_s is 0; allowed: 1e-06 to 0.004"),
        ("--set gains.control_rate_Hz=1e9", "control_rate_Hz is 1e+09; allowed: 1 to 100000"),
        ("--set gains.control_rate_Hz=1e-9", "control_rate_Hz is 1e-09; allowed: 1 to 100000"),
        ("--controllers PID", "did you mean 'pid'"),
        ("--vary sped=0.2:1:3 --out x", "did you mean 'speed_m_s'? known: K_b, drag"),
        ("--vary gains.atitude=1:2:3 --out x", "did you mean 'attitude'? known: alti"),
        ("--vary speed=1:0.2:3 --out x", "values; allowed: FROM below TO"),
        ("--vary speed=nan:1:3 --out x", "write NAME=FROM:TO:COUNT"),
        ("--vary speed=0.2:1:3 --seeds 0 --out x", "--seeds is 0, allowed is 1 or more"),
        ("--vary speed=0.2:1:3 --samples -1 --out x", "--samples is -1, allowed is 0 or more"),
        ("--vary speed=0:1:3 --out x", "goal speed_m_s is 0"),
        ("--vary speed=0.01:1:3 --out x", "too long for a flight of"),
        ("--vary speed=0.2:1:3", "add --out FOLDER"),
        ("--vary speed=0.2:1:3 --vary speed_m_s=1:2:3 --out x", "twice"),
        ("--vary K_b=1:2:3 --measure arive --out x", "did you mean 'arrives'"),
        ("--vary K_b=1:2:3 --controllers ogi --out x", "feedforward, observer, oge"),
        ("--vary K_b=1:2:3 --controllers pid,pid --out x", "name each once"),
        ("--vary K_b=1:2:3 --gains s4 --out x", "known: s1a, s3, stiff"),
        ("--vary K_b=1:2:3 --seeds 3 --gyro-noise-rad-s 0 --out x", "identical flights"),
        ("--samples 3", "--samples needs a campaign"),
        ("--measure struck", "--measure needs a campaign"),
        ("--gains s3 --gains stiff", "2 gain sets (s3, stiff) need a campaign"),
        ("--controllers oge", "unknown controller (and not of the form module:Class) 'oge'"),
        ("--set K_b=nan", "write NAME=NUMBER"),
        ("--vary K_b=1:2:3 --out taken.js", "taken.js exists already"),
    ],
    "stop": [("--adress x", "--adress"), ("", "no bench of this user runs on this machine")],
    "web": [("--port 99999", "--port is 99999, allowed is 0 to 65,535")],
    "bench check": [("usb:1", "unknown address scheme 'usb'")],
    "bench map": [("sim:pquad --motors 1,x", "--motors is '1,x'; give whole numbers")],
    "bench serve": [("--system 0", "--system is 0, allowed is 1 to 250")],
    "firmware": [
        ("--out a --board due", "unknown board 'due'"),
        ("--board mega --out bench", "unknown board 'mega'; known: nano, uno"),
        ("--rig pquad --out bench", "has 4 motors"),
        ("--out taken", "taken exists already and was not changed"),
        ("--out taken/file/bench", "cannot be written"),
        ("", "Missing option '--out'"),
    ],
    "ports": [
        ("--baud 0", "--baud is 0, allowed is 1 to 100,000,000"),
        ("--udevrule", "--udevrule"),
        ("serial:/dev/x --probe", "are for the list of all ports; remove them or PORT"),
        ("sim:pquad", "has no port to check"),
    ],
    "pool": [
        ("", "0 fits given; minimum for pooling: 2"),
        ("a b --seed -1", "--seed is -1, allowed is 0 or more"),
        ("nowhere elsewhere", "nowhere contains no fit; give folders of benchtool fit --out"),
    ],
    "motor": [
        ("steps --mass-kg 0", "--mass-kg is 0 kg, allowed is above 0, at most 1,000 kg"),
        ("", "no input; give run folders without a plate, or test stand logs"),
        ("nowhere.csv", "nowhere.csv: there is no such file or run folder; check the path"),
    ],
    "library rigs": [("pqad", "did you mean 'pquad'")],
    "library rigs new": [("mine --radius -1", "--radius is -1 m, allowed is above 0")],
    "library propellers": [("apc_10x7s", "did you mean 'apc_10x7sf'")],
    "library models": [("sngle", "did you mean 'single'")],
    "library effects": [("body_lft", "did you mean 'body_lift'")],
}


def command_items(name: str) -> tuple[InputField, ...]:
    function = getattr(import_module(command_module(name)), COMMANDS[name][0].partition(":")[2])
    return items(function.inputs)


def test_every_command_has_a_case():
    assert set(REFUSED) == set(RUNNABLE)


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [(name, *case) for name, cases in REFUSED.items() for case in cases],
)
def test_invalid_arguments_give_one_error_line_and_no_file(
    name, arguments, message, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken.js").write_text("mine")
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "file").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    assert run(*name.split(), *arguments.split()) == 2
    error = capsys.readouterr().err
    assert message in error
    lines = [line for line in error.splitlines() if not line.startswith("running user code: ")]
    assert len(lines) == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("name", RUNNABLE)
def test_every_option_has_help_unit_and_range(name):
    fields = command_items(name)
    assert len({item.option for item in fields}) == len(fields)
    for item in fields:
        assert item.metadata.help.strip(), item.key
        assert item.metadata.help[-1] == ".", item.key
        unit = re.search(r"_(us|m|s|deg|m_s|rad_s|kg)$", item.key.rpartition(".")[2])
        if unit is not None:
            assert item.metadata.unit.replace("/", "_") == unit[1], item.key
        if item.kind in (int, float) and not item.count:
            assert item.range, f"{item.key} takes any number; give it a range"


@pytest.mark.parametrize("name", RUNNABLE)
def test_docstring_and_help_agree(name):
    function = getattr(import_module(command_module(name)), COMMANDS[name][0].partition(":")[2])
    assert function.__doc__.splitlines()[0].rstrip(".") == COMMANDS[name][1].rstrip(".")


@pytest.mark.parametrize("key", [item.key for item in items(Plan) if item.key.endswith("_s")])
def test_every_time_of_a_plan_counts_in_its_duration(key):
    rig = load_rig_by_name("pquad")
    plans = [plan_from_toml(f"{key} = {time_s}", "plan").resolved(rig) for time_s in (1.0, 2.0)]
    first_s, second_s = (expected_duration_s(p, rig, plan_visits(p, rig)) for p in plans)
    assert second_s > first_s, f"count {key} in benchtool/acquire/visit_order.py"


def test_every_key_of_a_plan_is_used():
    """Apart from the duration; `Plan.resolved` replaces two keys by others."""
    used = {"distances_over_R", "percent"}
    durations = {"visit_s", "min_duration_s", "expected_duration_s"}
    for path in Path(acquire.__path__[0]).glob("*.py"):
        if path.stem != "plan":
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if getattr(node, "name", "") not in durations:
                    used |= {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}
    unused = [item.key for item in items(Plan) if item.key.rpartition(".")[2] not in used]
    assert not unused, f"make {unused} act in benchtool/acquire/sweep.py"
