"""RCbenchmark stands."""
