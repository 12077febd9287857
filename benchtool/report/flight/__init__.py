"""Pages and figures of simulations."""
