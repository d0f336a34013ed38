"""How fast the engine is, and how right, beside what an engineer would otherwise use: `make bench`.

`studies` says what is simulated. The alternatives are `ngspice`, `events_ivp` (scipy's solve_ivp with terminal events)
and `exact_numpy` (matrix exponentials); the last two integrate `equations` and `sshi`, written out by hand. `engine`
runs piezoharvest. All are measured against `reference`, the integration by DOP853 that the tests trust.
"""

# Read by numpy's BLAS when it is loaded: threads cost matrices of this size a hundred times what they gain.
BLAS_THREADS = "OPENBLAS_NUM_THREADS"
