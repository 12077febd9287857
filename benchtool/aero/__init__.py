"""Ground-effect physics, written once: branch-free expressions for NumPy and compiled loops."""
