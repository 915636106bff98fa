"""The modules that use internals of numba (``numba.core``, llvmlite); all other kernels use its public interface.

* ``jit``, ``cache``: compile kernels, and store them between processes with a checksum, so that a warm start does not
  import the compiler; functions called only by kernels become machine code only as parts of these.
* ``records``: pass the arrays of a model by one address and call kernels by address, so that a case compiles only the
  functions that it adds.
* ``blas``: small matrix products by SciPy's BLAS, without Python objects.
* ``blocks``, ``vectors``: eliminate bands in blocks of four rows and columns, in vector instructions.
* ``arrays``: small arrays without the allocator, and copies that compile fast.

No class of numba's compiler, code library or cache is derived from. docs/architecture.md lists what each piece saves.
"""
