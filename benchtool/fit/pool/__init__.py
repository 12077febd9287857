"""Fits of several rigs together: what they share, and whether they differ."""
