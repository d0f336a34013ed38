"""Prediction of measured records: the model driven by the imposed channel, with derivatives to its parameters."""
