"""Choice of the cases of parametrised tests that `make test` runs; all others are left to `make slow`."""

import pytest


def with_slow(cases, slow):
    """Cases of a parametrised test, some of them with the marker `slow`.

    Parameters
    ----------
    cases : iterable
        One value, or a tuple of values, for each case.
    slow : callable
        Takes the values of a case and tells whether it is marked.

    Returns
    -------
    list of ParameterSet
        In the order given.
    """
    values = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*case, marks=pytest.mark.slow if slow(*case) else ()) for case in values]
