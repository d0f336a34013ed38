"""Figures of the page, in the style of the package's reports."""
