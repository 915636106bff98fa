"""The command line: parse, call one function, map what happens to exit codes."""

import os
import sys

# elements are shared out to threads here; those of OpenBLAS, which would come on top, wait for work by spinning. It
# looks for this once, when it is loaded with NumPy
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

try:
    from .app import app as main
except KeyboardInterrupt:  # the command, which handles it, has not begun
    sys.stderr.write("interrupted\n")
    sys.exit(130)

__all__ = ["main"]
