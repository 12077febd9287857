"""Checks and repairs of imported columns."""
