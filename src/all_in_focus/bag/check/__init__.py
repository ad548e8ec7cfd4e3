# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Can a bag be fused, and if not, why not: before anyone blames the method."""
from all_in_focus.bag.check.checker import check
from all_in_focus.bag.check.findings import Finding, Report

__all__ = ["Finding", "Report", "check"]
