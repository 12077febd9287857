"""Runs tab."""
