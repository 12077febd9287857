"""The hinged body on its bench."""
