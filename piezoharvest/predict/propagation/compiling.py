from functools import partial

from numba import njit

fast = partial(njit, nogil=True, error_model="numpy", fastmath={"contract", "nsz"}, _nrt=False)
compiled, inlined = fast(), fast(forceinline=True)
