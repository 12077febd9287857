"""Physics of rotors near a surface. Each equation is implemented once."""

VALIDITY_Z_OVER_R = 0.5  # least z/R of the formulae: twice the pole of eq. (2); assumed
