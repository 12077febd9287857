"""Simulations: control laws, pitch bench, flight, campaigns; no port, no clock."""
