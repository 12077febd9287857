"""Simulate tab."""
