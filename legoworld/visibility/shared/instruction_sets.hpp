// Code that is compiled once more for AVX2 and for AVX-512, and whether this CPU runs it. Included
// by the kernels of legoworld/visibility and legoworld/evaluation: the source hash of both covers
// this folder.

#pragma once

#include <cstdint>

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>

#if defined(__clang__)
#define LW_BEGIN_AVX2 \
  _Pragma("clang attribute push(__attribute__((target(\"avx2\"))), apply_to = function)")
#define LW_END_AVX2 _Pragma("clang attribute pop")
#define LW_BEGIN_AVX512                                                                          \
  _Pragma("clang attribute push(__attribute__((target(\"avx2,avx512f,avx512dq,avx512bw,avx512vl\"))), \
          apply_to = function)")
#define LW_END_AVX512 _Pragma("clang attribute pop")
#else
#define LW_BEGIN_AVX2 _Pragma("GCC push_options") _Pragma("GCC target(\"avx2\")")
#define LW_END_AVX2 _Pragma("GCC pop_options")
#define LW_BEGIN_AVX512 \
  _Pragma("GCC push_options") _Pragma("GCC target(\"avx2,avx512f,avx512dq,avx512bw,avx512vl\")")
#define LW_END_AVX512 _Pragma("GCC pop_options")
#endif
#endif

namespace lw {

// Leaf 7 of cpuid; false where the system does not keep the vectors that `saved` stands for.
// Asked of the CPU itself: __builtin_cpu_supports does not link everywhere (zig's compiler-rt).
inline bool cpu_extensions(uint32_t saved, uint32_t& b, uint32_t& c) {
#if defined(__x86_64__)
  uint32_t a = 0, d = 0;
  if (!__get_cpuid(1, &a, &b, &c, &d) || (c & bit_OSXSAVE) == 0) return false;
  uint32_t kept = 0, high = 0;
  __asm__ volatile("xgetbv" : "=a"(kept), "=d"(high) : "c"(0));
  return (kept & saved) == saved && __get_cpuid_count(7, 0, &a, &b, &c, &d);
#else
  return static_cast<void>(saved), static_cast<void>(b), static_cast<void>(c), false;
#endif
}

inline bool has_avx2() {
  constexpr uint32_t kXmmAndYmm = 0x6, kAvx2 = 1u << 5;
  uint32_t b = 0, c = 0;
  return cpu_extensions(kXmmAndYmm, b, c) && (b & kAvx2) != 0;
}

// F, DQ, BW and VL; and VBMI2, which the first CPUs with AVX-512 lack: those lower their clock for
// wide vectors.
inline bool has_avx512() {
  constexpr uint32_t kAndZmm = 0xe6, kVbmi2 = 1u << 6;
  constexpr uint32_t kWide = 1u << 16 | 1u << 17 | 1u << 30 | 1u << 31;
  uint32_t b = 0, c = 0;
  return has_avx2() && cpu_extensions(kAndZmm, b, c) && (b & kWide) == kWide && (c & kVbmi2) != 0;
}

}  // namespace lw
