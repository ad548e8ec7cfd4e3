# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_rig: a rig folder from pictures of a chessboard. check_rig: does a rig fit a scene?"""
