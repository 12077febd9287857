"""Hardware and its equals: one Protocol, several drivers, a guard around any of them."""
