"""What a rotor near a surface does; each equation once."""

VALIDITY_Z_OVER_R = 0.5
"""Least z/R at which the formulae are trusted: twice the pole of eq. (2); a convention of ours."""
