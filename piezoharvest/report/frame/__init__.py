"""The frame of every page: templates, tables for narrow screens, version and environment."""
