"""Every figure of the paper: python docs/examples/paper/figures.py [FOLDER]"""

from __future__ import annotations

import attitude
import drawings
import flights
import ratios
import wake
from look import save

FIGURES = {
    name: draw
    for script in (ratios, wake, attitude, drawings, flights)
    for name, draw in script.FIGURES.items()
}

if __name__ == "__main__":
    save(FIGURES)
