# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The laboratory: scenes of known truth, fusion methods of others, measures of quality, and the benchmark over all of them."""
