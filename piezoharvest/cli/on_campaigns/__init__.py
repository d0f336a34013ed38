"""Commands on campaigns: `identify`, `diagnose`, `plan`."""
