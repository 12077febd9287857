"""Physical effects, one file each. `physics.catalogue` imports all files of this folder."""
