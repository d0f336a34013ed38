"""The one place where a description becomes equations."""
