"""Random numbers inside a compiled loop: one small generator per lane, seeded by the caller.

Every lane has its own stream, so that a run gets the same numbers alone, in a batch of any size
and on any number of cores. Numbers are drawn whether a noise is enabled or not: two runs with
the same seed that differ in one noise share all others.

The generator is a multiply-with-carry of Marsaglia (1994), x' = A (x mod 2^32) + floor(x / 2^32),
with its two halves combined as in Thomas' MWC64X. A is the largest odd number below 2^31 for which
A 2^32 - 1 and A 2^31 - 1 are prime, so that all arithmetic stays within signed 64 bits.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.expression import Quantity, expression

MULTIPLIER = 2147483085
LOW_32 = 4294967295
LOW_16 = 65535


@expression
def next_state(state: Quantity) -> Quantity:
    """Return the generator's next state: an integer below 2^63."""
    return MULTIPLIER * (state & LOW_32) + (state >> 32)


@expression
def later_state(state: Quantity, steps: int) -> Quantity:
    """Return the generator's state after some steps."""
    for _ in range(steps):
        state = next_state(state)
    return state


@expression
def bits(state: Quantity) -> Quantity:
    """Return 32 random bits of a state."""
    return (state & LOW_32) ^ (state >> 32)


@expression
def normal(first: Quantity, second: Quantity) -> Quantity:
    """Return a standard normal number from two successive states.

    The sum of four 16-bit numbers, mapped by an odd polynomial to the normal distribution: error
    of the distribution function 3e-5, of the standard deviation 1e-4; maximum magnitude 6.5.
    Method: Thomas 2014 (corrected central limit); coefficients by least squares on the quantiles.
    """
    bits_a, bits_b = bits(first), bits(second)
    total = (bits_a & LOW_16) + (bits_a >> 16) + (bits_b & LOW_16) + (bits_b >> 16)
    u = (total - 131070) * 2.6428997921303014e-05  # to unit variance: 4 (2^32 - 1) / 12
    v = u * u
    poly = 0.0010130362284591046 + v * (-9.814505991365575e-05 + v * 3.7063071330431952e-06)
    poly = 0.011557281417119848 + v * (-0.004871159259054379 + v * poly)
    return u * (0.964411898034138 + v * (0.0006142831514005867 + v * poly))


def lane_states(seed: int, runs: Iterable[int]) -> NDArray[np.int64]:
    """Return the initial state of each run of a seed (n_runs,), a function of seed and run."""
    return np.array([_initial_state(seed, run) for run in runs], np.int64)


@lru_cache(maxsize=4096)
def _initial_state(seed: int, run: int) -> int:
    low, high = np.random.SeedSequence([seed, run]).generate_state(2, np.uint32)
    return (int(high) % (MULTIPLIER - 2) + 1) * 2**32 + int(low)
