"""Worked tables of the study of the paper, with all printed digits.

PQUAD: R = 0.12 m, m = 1.4 kg, arm 0.225 m, d = 0.318 m; AMUSE: R = 0.205 m, m = 12 kg,
d = 0.60 m (thrust factors) or arm 0.45 m (moments). K_b = 2, g = 9.81 m/s2.
"""

from __future__ import annotations

# z/R, eq. (2), three rotors: corner, ends, average, eq. (3), eq. (4) b = diagonal, half diagonal
PQUAD = """
0.5 1.3333 1.3736 1.3611 1.3653 1.3818 1.4505 1.9418
1   1.0667 1.0987 1.0901 1.0930 1.1066 1.1744 1.4098
1.5 1.0286 1.0539 1.0485 1.0503 1.0615 1.1264 1.2400
2   1.0159 1.0349 1.0317 1.0328 1.0415 1.0969 1.1529
3   1.0070 1.0179 1.0168 1.0171 1.0223 1.0590 1.0754
4   1.0039 1.0107 1.0103 1.0104 1.0137 1.0381 1.0442
5   1.0025 1.0071 1.0069 1.0069 1.0092 1.0262 1.0289
"""

# z/R, then eq. (3), eq. (4) diagonal, eq. (4) half diagonal for d = 0.27, 0.36, 0.40
OTHER_SPACINGS = """
0.5 1.4089 1.5247 2.4488 1.3677 1.4144 1.7358 1.3589 1.3927 1.6214
1   1.1218 1.2254 1.5343 1.0973 1.1461 1.3335 1.0908 1.1274 1.2799
1.5 1.0697 1.1587 1.2795 1.0557 1.1056 1.2103 1.0512 1.0906 1.1859
2   1.0458 1.1157 1.1683 1.0381 1.0834 1.1401 1.0352 1.0728 1.1286
3   1.0237 1.0655 1.0791 1.0211 1.0536 1.0721 1.0200 1.0489 1.0688
4   1.0142 1.0407 1.0455 1.0132 1.0358 1.0430 1.0127 1.0336 1.0418
5   1.0094 1.0273 1.0294 1.0089 1.0251 1.0283 1.0087 1.0240 1.0278
"""

# z/R, corner, ends, average of three rotors at d = 0.36
THREE_ROTORS_036 = """
0.5 1.3620 1.3530 1.3560
1   1.0915 1.0846 1.0869
1.5 1.0498 1.0449 1.0465
2   1.0327 1.0295 1.0306
3   1.0172 1.0159 1.0164
4   1.0104 1.0099 1.0101
5   1.0069 1.0067 1.0068
"""

# z/R, eq. (2), three stations' average, (3), (4) diagonal, (4) half, flat ring of 8 without body
AMUSE = """
0.5 1.3333 1.3576 1.3701 1.4205 1.7694 1.4175
1   1.0667 1.0880 1.0990 1.1511 1.3475 1.1326
1.5 1.0286 1.0472 1.0568 1.1095 1.2161 1.0829
2   1.0159 1.0310 1.0387 1.0861 1.1427 1.0596
3   1.0070 1.0165 1.0213 1.0547 1.0728 1.0356
4   1.0039 1.0101 1.0133 1.0363 1.0433 1.0234
5   1.0025 1.0068 1.0090 1.0253 1.0285 1.0164
"""

# R, d, then the z/R where the denominators of eq. (2), (3), (4) diagonal, (4) half vanish
POLES = """
0.12  0.27  0.2500 0.2531 0.2572 0.2921
0.12  0.318 0.2500 0.2519 0.2544 0.2733
0.12  0.36  0.2500 0.2513 0.2530 0.2654
0.12  0.40  0.2500 0.2510 0.2522 0.2610
0.205 0.60  0.2500 0.2514 0.2532 0.2667
"""

WALL_X_M = (2.8, 2.9, 3.0, 3.05, 3.1, 3.15, 3.2, 3.25, 3.3, 3.4)

# z/R, K_b, then the backward pitching moment in mN m at each position of WALL_X_M (edge at 3.0)
WALL_MOMENT = """
2 2 7.7 14.8 45.5 63.7 78.6 74.4 58.4 37.0 14.0 0
2 0 7.7 12.8 19.5 23.3 26.4 23.5 17.0 9.9 3.5 0
3 2 3.4 6.7 22.5 31.7 39.0 36.8 28.8 18.1 6.8 0
3 0 3.4 5.7 9.6 11.8 13.5 12.0 8.7 5.1 1.8 0
"""

# z/R, restoring moment in mN m for T = m g/4: eq. (4) half at 2, 5, 10 deg; diagonal, rotors only,
# projected on the vertical at 5, 10 deg. Three digits differ from the notes, which rounded 29.648,
# 21.548 and 170.353 twice: 29.7, 21.6 and 170.3
RESTORING_PQUAD = """
1.0  29.6 77.6 185.6 53.8 128.2 47.8 114.4 67.9 170.4
1.25 14.6 37.4 81.3  28.6 62.2  25.4 55.4  30.8 69.3
1.5  8.5  21.5 45.0  17.8 37.1  15.8 33.2  16.9 36.3
2    3.8  9.5  19.2  8.6  17.4  7.7  15.7  7.0  14.4
3    1.2  3.1  6.1   3.0  5.9   2.8  5.5   2.1  4.3
4    0.5  1.4  2.7   1.3  2.7   1.3  2.5   0.9  1.9
5    0.3  0.7  1.4   0.7  1.4   0.7  1.4   0.5  1.0
"""

# z/R, the same by each rotor's own height at 2, 5, 10 deg, for T = m g/(4 cos(tilt)); the one digit
# that differs from the notes is 176.5 at 1.25 and 10 deg, printed there as 176
RESTORING_OWN_HEIGHT = """
1.0  48.6 124  271
1.25 33.5 85   177
1.5  23.8 60   125
2    12.8 32   66.4
3    4.6  11.6 23.8
4    2.1  5.3  10.8
5    1.1  2.8  5.7
"""

# z/R, restoring moment in mN m at 5, 10 deg, eq. (4) half, T = m g/4 of each station
RESTORING_AMUSE = """
1 1313 3458
2 167 342
3 56 113
5 14 27
"""

# z/R, eq. (4) half at 5 deg and 10 deg in percent of L m g / 2 ("-" where none is printed)
AUTHORITY_PERCENT = """
1.0  5.0 12.0
1.25 2.4 5.3
1.5  1.4 2.9
2    0.6 1.2
3    0.2 0.4
4    -   0.2
5    -   0.1
"""


def rows(table: str) -> list[list[str]]:
    """Return the cells of a table by row."""
    return [line.split() for line in table.strip().splitlines()]


def as_printed(value: float, printed: str) -> str:
    """Return the value with as many decimals as the printed one."""
    decimals = len(printed.partition(".")[2])
    return f"{value:.{decimals}f}"
