# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Many methods on many scenes, measured, scored and put into one report: the library behind `evaluate`.

scenes, bags: what is fused; methods: who fuses; tasks: one method on one scene; engine: where tasks run; runner: runs all
and keeps the results; tables, page, output_files: what is made of them; versions: what they depend on. segmentation: for
compare_segmentation.
"""
