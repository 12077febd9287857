"""`benchtool bench check`: is this bench safe to sweep?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from benchtool.commands.declared import declared
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckInputs(Inputs):
    """What `benchtool bench check` takes."""

    address: Annotated[str, Input("The bench: serial:PORT, tcp:HOST:PORT.", argument="ADDRESS")]
    rig: Annotated[str | None, Input("Rig by name, or a rig file.")] = None
    yes: Annotated[bool, Input("No typed confirmation; simulated benches only.")] = False


def check(inputs: CheckInputs) -> None:
    """Check standstill, ESC arming, channel map, thrust sign and rpm at low throttle."""
    from datetime import datetime

    from benchtool.acquire.arming import CONFIRMATION, remember_check
    from benchtool.acquire.bench_check import check_bench, low_throttle_us
    from benchtool.acquire.inputs import rig_for
    from benchtool.bench.drivers import open_bench
    from benchtool.bench.guard import GuardedBench
    from benchtool.commands.terminal.announce_code import announce_code
    from benchtool.commands.terminal.sweep_operator import confirm_arming, say_of_bench, say_of_end
    from benchtool.core.errors import BenchError, InputError

    stands = rig_for(inputs.address, inputs.rig)
    findings = []
    with GuardedBench(open_bench(inputs.address, announce_code), stands) as bench:
        identity = bench.identity
        say_of_bench(identity, stands)
        text = (
            f"rotors 1 to {stands.n_rotors} of rig {stands.name} will turn one after another at "
            f"{low_throttle_us(stands):g} us"
        )
        if not inputs.yes:
            confirm_arming(text, CONFIRMATION, bench)
        elif not identity.simulated:
            raise InputError(
                "--yes is for simulated benches only: this is the check; leave it out and type the "
                "confirmation"
            )
        for finding in check_bench(bench, stands):
            findings.append(finding)
            print(f"{'ok  ' if finding.passed else 'FAIL'} {finding.name}: {finding.text}")
    say_of_end(bench)
    failed = [finding for finding in findings if not finding.passed]
    if failed:
        raise BenchError(
            f"{len(failed)} of {len(findings)} checks failed, first {failed[0].name}: "
            f"{failed[0].text}; mend it and check again"
        )
    today = datetime.now().astimezone().date()
    remember_check(identity, stands, [finding.text for finding in findings], today)
    print(f"all {len(findings)} checks passed on {identity.device_id}; noted for today")


command = declared(CheckInputs, check)
