"""The experiment that tells most: planned records within the limits of a bench, ranked by what they would tell."""
