"""Pages and figures of a fit."""
