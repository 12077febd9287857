"""Virtual devices: rotor bench, pitch bench and autopilot."""
