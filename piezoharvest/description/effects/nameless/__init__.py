"""Laws without a name: a free function of one input, added at a place of the model."""
