# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read before all tests, and before any of them imports numpy."""
import os

# Its threads wait for each other by computing: on small arrays they cost more than they save, most of all beside other tests.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_addoption(parser):
    parser.addoption("--build", default="build", help="lint.py: folder with compile_commands.json")
    parser.addoption("--every-file", action="store_true", help="lint.py: clang-tidy on all files: a quarter of an hour")
