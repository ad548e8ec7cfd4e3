// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Compiles a function twice, for AVX2 and for the baseline, and chooses by the processor at run time. For
/// free functions with plain loops over a row; a lambda gains only where it is inlined. FMA is left out, so
/// that both give the same bits.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define ALL_IN_FOCUS_SIMD __attribute__((target_clones("avx2", "default")))
#else
#define ALL_IN_FOCUS_SIMD
#endif
