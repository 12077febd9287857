"""Devices that answer like real ones: bench, autopilot, stage, stand."""
