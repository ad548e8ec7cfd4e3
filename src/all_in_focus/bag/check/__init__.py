# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Checks whether a bag can be fused, and says why not."""
from all_in_focus.bag.check.checker import check
from all_in_focus.bag.check.findings import BagReport, Finding

__all__ = ["BagReport", "Finding", "check"]
