"""Physical effects, one file each. The catalogue reads this folder."""
