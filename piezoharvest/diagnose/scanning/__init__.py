"""Effects whose strength has no derivative: which events there are changes with it, and between such values nothing."""
