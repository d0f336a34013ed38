"""From the files and tables of a campaign to records in SI units."""
