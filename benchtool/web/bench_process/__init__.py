"""The bench's own process: it holds the bench, runs sweeps, stops, and publishes what happens."""
