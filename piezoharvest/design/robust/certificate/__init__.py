"""A figure that no point of a box is worse than, for linear circuits: branch and bound with first-order forms."""
