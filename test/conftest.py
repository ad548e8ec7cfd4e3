# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read before all tests, and before any of them imports numpy."""
import os

# Its threads wait for each other by computing: on small arrays they cost more than they save, most of all beside other tests.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
