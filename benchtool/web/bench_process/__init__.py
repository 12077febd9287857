"""Separate process that owns the bench: sweeps, recordings, STOP and telemetry."""
