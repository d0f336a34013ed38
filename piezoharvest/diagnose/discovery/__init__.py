"""Laws without a name: a free function at a place of the model, sought where no known effect explains a record.

`places` are those that the records show, `knots` their corners, `scores` one linearisation of each, `law_fits` full
fits with the smoothness by marginal likelihood, `formulas` readable forms, `search` puts them together, `result` is
what is found.
"""
