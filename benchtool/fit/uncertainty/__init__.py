"""Where the uncertainty of a fit comes from: its budget, by propagation and by Monte Carlo."""
