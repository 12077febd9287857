"""Fuzz one target, guided by the lines of benchtool that an input reaches; run.py starts this."""

from __future__ import annotations

import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["benchtool"]):
    from tests.proof.fuzz.engine import fault_of
    from tests.proof.fuzz.run import keep
    from tests.proof.fuzz.targets import Files, targets


def main(name: str, words: list[str]) -> None:
    """Fuzz until libFuzzer's own limits end the process.

    Args:
        words: for libFuzzer; the last is the folder of inputs that reached something new.
    """
    target = targets(Files())[name]
    for number, seed in enumerate(target.seeds):
        Path(words[-1], f"seed-{number}").write_bytes(seed)

    def judge(data: bytes) -> None:
        if fault := fault_of(target, data):
            print(f"{name}: {fault} {keep(name, data)}", file=sys.stderr, flush=True)

    atheris.Setup([sys.argv[0], *words], judge)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
