"""Bench tab."""
