"""Print the skipped tests of JUnit files with their reasons; fail above 2 % of all tests.

python tests/skips.py build/tests/*.xml
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

MOST = 0.02


def summary(files: Sequence[Path]) -> tuple[str, bool]:
    """Return a text that lists the skips by reason, and whether there are too many."""
    cases = [case for file in files for case in ET.parse(file).iter("testcase")]
    skips: Counter[tuple[str, str]] = Counter()
    for case in cases:
        skipped = case.find("skipped")
        if skipped is not None and skipped.get("type") != "pytest.xfail":
            skips[skipped.get("message", ""), case.get("classname", "")] += 1
    count = skips.total()
    lines = [f"{n:4d}  {where}: {reason}" for (reason, where), n in sorted(skips.items())]
    share = count / max(len(cases), 1)
    lines.append(f"{count} of {len(cases)} tests skipped: {share:.1%}, limit {MOST:.0%}")
    return "\n".join(lines), not cases or share > MOST


if __name__ == "__main__":
    text, too_many = summary([Path(name) for name in sys.argv[1:]])
    print(text)
    sys.exit(1 if too_many else 0)
