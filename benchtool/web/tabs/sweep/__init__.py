"""Sweep tab."""
