"""The Fit tab: choose runs and a model, fit with progress, look at what came out."""
