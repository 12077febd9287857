"""Uncertainty budget of a fit, by propagation and by Monte Carlo."""
