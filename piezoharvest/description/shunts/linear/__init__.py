"""Linear circuits."""
