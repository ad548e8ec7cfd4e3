# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""rviz on a screen without a display: its configuration and pictures of its panels."""
