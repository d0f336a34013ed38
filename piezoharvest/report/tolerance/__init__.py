"""What a report shows of tolerances."""
