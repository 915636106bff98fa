"""What makes and checks the measured and generated parts of the documents; run as ``python -m scripts.NAME``."""

import os

# as on the command line: more threads wait in busy loops, which counts as processor time. Read when NumPy is imported
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
