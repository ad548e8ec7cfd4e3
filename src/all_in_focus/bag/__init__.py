# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reads, checks and writes rosbags, and finds the brackets in them."""
