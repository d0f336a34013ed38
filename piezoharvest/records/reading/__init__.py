"""Reading of the files and tables of a campaign into records in SI units."""
