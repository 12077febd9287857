"""Estimation: one problem, two estimators, and what can be said of their answers."""
