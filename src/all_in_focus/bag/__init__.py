# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""rosbags: what they hold, their brackets, reading and writing them."""
