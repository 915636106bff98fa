"""The command line: parse, call one function, convert the outcome to an exit code."""

import os
import sys

# ancf2d distributes elements over threads itself; additional OpenBLAS threads would wait in busy loops. OpenBLAS reads
# this only when it is loaded with NumPy
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

try:
    from .app import app as main
except KeyboardInterrupt:  # the command, which handles it, has not begun
    sys.stderr.write("interrupted\n")
    sys.exit(130)

__all__ = ["main"]
