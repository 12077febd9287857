"""What a rotor near a surface does; each equation once."""
