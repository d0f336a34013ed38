"""Start values of a fit: parameters estimated from records and resonances, and initial states of stop operators."""
