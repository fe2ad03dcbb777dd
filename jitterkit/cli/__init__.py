"""The command line: a thin shell; each command imports what it needs when it runs."""

import os

# Read when NumPy is first imported.  Frames share the processors: where others work beside them, threads that
# wait for one another took 16 ms for the eigenvalues of 32 rows, and one thread takes 0.1 ms.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
