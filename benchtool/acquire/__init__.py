"""Acquisition: plan, order, tare, settle, sweep, calibrate."""
