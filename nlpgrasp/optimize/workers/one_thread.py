"""Single-threaded linear algebra: rounding independent of the number of cores, one thread per worker."""

from __future__ import annotations

import casadi as ca
from threadpoolctl import OpenBLASController, register, threadpool_limits

# the OpenBLAS that CasADi brings for IPOPT, which threadpoolctl does not know by its name
CasadiOpenBLAS = type("CasadiOpenBLAS", (OpenBLASController,), {"filename_prefixes": ("libcasadi-tp-openblas",)})
register(CasadiOpenBLAS)


def one_thread() -> threadpool_limits:
    """Return a context in which numpy, scipy and IPOPT compute on one thread."""
    ca.has_nlpsol("ipopt")  # loads it: a library that is loaded later would not be limited
    return threadpool_limits(1)
