"""Laws of thrust against distance; a model has one of them."""
