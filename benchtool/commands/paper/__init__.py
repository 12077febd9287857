"""The paper's claims, simulated."""
