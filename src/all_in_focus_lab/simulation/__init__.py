# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rendered scenes: lens, depth sensor, surfaces, and the presets of make_scene."""
