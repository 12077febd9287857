"""Find where simulation and measurement disagree and name the missing effect."""
