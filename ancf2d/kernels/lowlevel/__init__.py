"""What needs the inner parts of numba (``numba.core``, llvmlite), gathered; all other kernels use its public doors.

* ``jit``, ``cache``: how kernels are compiled, and kept between processes with a checksum, without importing what
  compiling needs; functions that only kernels call become machine code in their callers alone.
* ``records``: arrays of a model by one address, kernels called by address: what a scene adds compiles alone.
* ``blas``: small products of matrices by SciPy's BLAS without the way through Python objects.
* ``blocks``, ``vectors``: bands eliminated in blocks of four rows and columns, in vector instructions.
* ``arrays``: small arrays without the allocator, copies that compile fast.

No class of numba's compiler, code library or cache is derived from. docs/architecture.md has what each piece earns.
"""
