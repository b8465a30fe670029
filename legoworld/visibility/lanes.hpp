// Vectors of LW_LANES doubles. Included once per instruction set, inside that set's namespace.
typedef double Vd __attribute__((vector_size(8 * LW_LANES)));
typedef int64_t Vm __attribute__((vector_size(8 * LW_LANES)));
typedef uint64_t Vu __attribute__((vector_size(8 * LW_LANES)));
typedef int16_t Vh __attribute__((vector_size(8 * LW_LANES)));
typedef float Vf __attribute__((vector_size(4 * LW_LANES)));
typedef int32_t Vi __attribute__((vector_size(4 * LW_LANES)));

constexpr int kLanes = LW_LANES;

#if LW_LANES == 2
#define LW_EACH(F) F(0), F(1)
#elif LW_LANES == 4
#define LW_EACH(F) F(0), F(1), F(2), F(3)
#else
#define LW_EACH(F) F(0), F(1), F(2), F(3), F(4), F(5), F(6), F(7)
#endif

static inline Vd spread(double x) { return x - Vd{}; }

static inline Vd magnitude(Vd x) { return (Vd)((Vm)x & INT64_MAX); }

static inline Vd smaller(Vd x, Vd y) { return x < y ? x : y; }

static inline Vd larger(Vd x, Vd y) { return x > y ? x : y; }

static inline Vd root(Vd x) {
#if defined(__x86_64__) && LW_LANES == 2
  return (Vd)_mm_sqrt_pd((__m128d)x);
#elif defined(__x86_64__) && LW_LANES == 4
  return (Vd)_mm256_sqrt_pd((__m256d)x);
#elif defined(__x86_64__) && LW_LANES == 8
  return (Vd)_mm512_sqrt_pd((__m512d)x);
#else
  for (int lane = 0; lane < kLanes; ++lane) x[lane] = std::sqrt(x[lane]);
  return x;
#endif
}

template <class Vector, class Element>
static inline Vector load(const Element* from) {
  Vector out;
  __builtin_memcpy(&out, from, sizeof out);
  return out;
}

template <class Vector, class Element>
static inline void store(Element* to, Vector value) {
  __builtin_memcpy(to, &value, sizeof value);
}

static inline Vd widen(Vf x) { return __builtin_convertvector(x, Vd); }

static inline Vf narrow(Vd x) { return __builtin_convertvector(x, Vf); }

// Bit i is set where lane i is negative (a true comparison is).
static inline unsigned bits(Vm mask) {
#if defined(__x86_64__) && LW_LANES == 2
  return static_cast<unsigned>(_mm_movemask_pd((__m128d)mask));
#elif defined(__x86_64__) && LW_LANES == 4
  return static_cast<unsigned>(_mm256_movemask_pd((__m256d)mask));
#elif defined(__x86_64__) && LW_LANES == 8
  return static_cast<unsigned>(_mm512_movepi64_mask((__m512i)mask));
#else
  unsigned out = 0;
  for (int lane = 0; lane < kLanes; ++lane) out |= static_cast<unsigned>(mask[lane] < 0) << lane;
  return out;
#endif
}

// One element per row of a block.
typedef float Row __attribute__((vector_size(4 * kBlock)));
typedef int32_t RowMask __attribute__((vector_size(4 * kBlock)));

static inline Row spread_row(float x) { return x - Row{}; }

// Bit i is set where element i is negative (a true comparison is).
static inline unsigned row_bits(RowMask mask) {
#if defined(__x86_64__) && LW_LANES >= 4
  return static_cast<unsigned>(_mm256_movemask_ps((__m256)mask));
#elif defined(__x86_64__)
  __m128 half[2];
  __builtin_memcpy(half, &mask, sizeof half);
  return static_cast<unsigned>(_mm_movemask_ps(half[0]) | _mm_movemask_ps(half[1]) << 4);
#else
  unsigned out = 0;
  for (int i = 0; i < kBlock; ++i) out |= static_cast<unsigned>(mask[i] < 0) << i;
  return out;
#endif
}
