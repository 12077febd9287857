"""Laws of thrust against distance: one file a law; a model has one of them."""
