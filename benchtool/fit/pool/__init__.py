"""Joint estimates of several rigs: common values and differences."""
