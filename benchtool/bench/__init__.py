"""Drivers of real benches behind one Protocol, and the guard around any of them."""
