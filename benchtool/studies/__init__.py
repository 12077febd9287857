"""Whole studies: simulate, tabulate, draw and write what belongs together."""
