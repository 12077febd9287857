"""Search, weigh and judge hypotheses."""
