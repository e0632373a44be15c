"""Before numpy is imported anywhere: one BLAS thread, as the program itself runs."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
