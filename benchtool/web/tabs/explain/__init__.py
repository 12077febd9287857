"""Explain tab."""
