# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How the network of baselines/dcnn.onnx was trained."""
