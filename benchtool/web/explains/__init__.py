"""The Explain tab: where recordings and a model disagree, which effect is missing, accept it."""
