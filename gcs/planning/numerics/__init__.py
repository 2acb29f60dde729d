"""Tools that know nothing of flying: compiled kernels, threads, heaps, polynomials and quadratic programs."""
