"""Cards of the tabs."""
