"""Start values of a fit: parameters read off records and resonances, and where stop operators begin."""
