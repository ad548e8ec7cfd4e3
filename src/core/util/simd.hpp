// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Compiles a function for AVX2 as well, and takes the one that the processor has at run time. For free
/// functions with plain loops over one row; lambdas inside them count only where they are inlined. Without
/// FMA: both must give the same bits.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define ALL_IN_FOCUS_SIMD __attribute__((target_clones("avx2", "default")))
#else
#define ALL_IN_FOCUS_SIMD
#endif
