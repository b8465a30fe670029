// Code that is compiled once more for AVX2, and whether this CPU runs it. Included by the kernels of
// legoworld/visibility and legoworld/evaluation: the hash of either's sources covers this folder.

#pragma once

#include <cstdint>

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>

#if defined(__clang__)
#define LW_BEGIN_AVX2 \
  _Pragma("clang attribute push(__attribute__((target(\"avx2\"))), apply_to = function)")
#define LW_END_AVX2 _Pragma("clang attribute pop")
#else
#define LW_BEGIN_AVX2 _Pragma("GCC push_options") _Pragma("GCC target(\"avx2\")")
#define LW_END_AVX2 _Pragma("GCC pop_options")
#endif
#endif

namespace lw {

// Asked of the CPU itself: __builtin_cpu_supports does not link everywhere (zig's compiler-rt).
inline bool has_avx2() {
#if defined(__x86_64__)
  constexpr uint32_t kXmmAndYmmSaved = 6;
  uint32_t a = 0, b = 0, c = 0, d = 0;
  if (!__get_cpuid(1, &a, &b, &c, &d) || (c & bit_OSXSAVE) == 0) return false;
  uint32_t saved = 0, high = 0;
  __asm__ volatile("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
  if ((saved & kXmmAndYmmSaved) != kXmmAndYmmSaved) return false;
  return __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & bit_AVX2) != 0;
#else
  return false;
#endif
}

}  // namespace lw
