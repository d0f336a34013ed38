"""The story of designs/simulator-disagrees with the figures of a run: `python -m reports.disagreement`."""
