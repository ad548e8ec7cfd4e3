# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From pictures of a chessboard to a rig folder (calibrate_rig), and whether a rig fits a scene (check_rig)."""


class CalibrationError(ValueError):
    """What keeps a calibration from being made; the message is one line and says what to do."""
