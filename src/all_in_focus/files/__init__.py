# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stacks, rigs, YAML, and whole files and folders written at once."""
