// Vectors of one instruction set: LW_LANES float64 or twice as many float32. Included by nearest.cpp
// once for each, inside its namespace.

typedef double Vd __attribute__((vector_size(8 * LW_LANES), may_alias));
typedef int64_t Vm __attribute__((vector_size(8 * LW_LANES), may_alias));
typedef float Vf __attribute__((vector_size(8 * LW_LANES), may_alias));
typedef float Loose __attribute__((vector_size(8 * LW_LANES), may_alias, aligned(4)));

constexpr int kLanes = LW_LANES, kFloats = 2 * kLanes;
constexpr int kVectors = kLeaf / kLanes, kHalves = kLeaf / kFloats;

constexpr int64_t kNone = INT64_MAX;
// Squared distances of a pair in float64 and in floats differ by at most this factor and the query's
// own slack: (d + s)^2 <= d^2 (1 + e) + s^2 (1 + 1 / e), s what rounding moves both points by.
constexpr float kFloatly = 1.0f + 2e-4f, kSlackly = 1.1e4f, kLeast = 1e-37f;
constexpr unsigned kEvery = (1u << kLeaf) - 1u;  // a bit for each query
constexpr unsigned kAll = (1u << kFloats) - 1u;   // a bit for each lane
constexpr float kNumbers[kLeaf] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
constexpr int kSteps = 3;  // of a walk, at most
constexpr int kFew = 5;    // queries that are asked one by one sooner than together
constexpr float kInf = std::numeric_limits<float>::infinity();
// Sixteen numbers from here on are 0 for as many points as a leaf has, then infinity.
constexpr float kBehind[2 * kLeaf] = {0,    0,    0,    0,    0,    0,    0,    0,
                                      0,    0,    0,    0,    0,    0,    0,    0,
                                      kInf, kInf, kInf, kInf, kInf, kInf, kInf, kInf,
                                      kInf, kInf, kInf, kInf, kInf, kInf, kInf, kInf};

// A bit for each lane where a <= b.
static inline unsigned within(Vf a, Vf b) {
#if defined(__x86_64__) && LW_LANES == 2
    return static_cast<unsigned>(_mm_movemask_ps((__m128)(a <= b)));
#elif defined(__x86_64__) && LW_LANES == 4
    return static_cast<unsigned>(_mm256_movemask_ps((__m256)(a <= b)));
#elif defined(__x86_64__)
    return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LE_OQ);
#else
    unsigned out = 0;
    for (int lane = 0; lane < kFloats; ++lane) out |= (a[lane] <= b[lane] ? 1u : 0u) << lane;
    return out;
#endif
}

static inline Vf larger(Vf a, Vf b) {
#if defined(__x86_64__) && LW_LANES == 2
    return (Vf)_mm_max_ps((__m128)a, (__m128)b);
#elif defined(__x86_64__) && LW_LANES == 4
    return (Vf)_mm256_max_ps((__m256)a, (__m256)b);
#elif defined(__x86_64__)
    return (Vf)_mm512_max_ps((__m512)a, (__m512)b);
#else
    return a > b ? a : b;
#endif
}

static inline Vf smaller(Vf a, Vf b) {
#if defined(__x86_64__) && LW_LANES == 2
    return (Vf)_mm_min_ps((__m128)a, (__m128)b);
#elif defined(__x86_64__) && LW_LANES == 4
    return (Vf)_mm256_min_ps((__m256)a, (__m256)b);
#elif defined(__x86_64__)
    return (Vf)_mm512_min_ps((__m512)a, (__m512)b);
#else
    return a < b ? a : b;
#endif
}

static inline Vd smaller(Vd a, Vd b) {
#if defined(__x86_64__) && LW_LANES == 2
    return (Vd)_mm_min_pd((__m128d)a, (__m128d)b);
#elif defined(__x86_64__) && LW_LANES == 4
    return (Vd)_mm256_min_pd((__m256d)a, (__m256d)b);
#elif defined(__x86_64__)
    return (Vd)_mm512_min_pd((__m512d)a, (__m512d)b);
#else
    return a < b ? a : b;
#endif
}

// The least of all lanes.
static inline float lowest(Vf v) {
#if defined(__x86_64__)
#if LW_LANES == 8
    __m256 most = _mm256_min_ps(_mm512_castps512_ps256((__m512)v),
                                _mm256_castpd_ps(_mm512_extractf64x4_pd((__m512d)v, 1)));
#elif LW_LANES == 4
    __m256 most = (__m256)v;
#endif
#if LW_LANES == 2
    __m128 few = (__m128)v;
#else
    __m128 few = _mm_min_ps(_mm256_castps256_ps128(most), _mm256_extractf128_ps(most, 1));
#endif
    few = _mm_min_ps(few, _mm_movehl_ps(few, few));
    return _mm_cvtss_f32(_mm_min_ss(few, _mm_shuffle_ps(few, few, 1)));
#else
    float out = v[0];
    for (int lane = 1; lane < kFloats; ++lane) out = v[lane] < out ? v[lane] : out;
    return out;
#endif
}

static inline Vf root(Vf v) {
#if defined(__x86_64__) && LW_LANES == 2
    return (Vf)_mm_sqrt_ps((__m128)v);
#elif defined(__x86_64__) && LW_LANES == 4
    return (Vf)_mm256_sqrt_ps((__m256)v);
#elif defined(__x86_64__)
    return (Vf)_mm512_sqrt_ps((__m512)v);
#else
    for (int lane = 0; lane < kFloats; ++lane) v[lane] = std::sqrt(v[lane]);
    return v;
#endif
}

static inline Vd root(Vd v) {
#if defined(__x86_64__) && LW_LANES == 2
    return (Vd)_mm_sqrt_pd((__m128d)v);
#elif defined(__x86_64__) && LW_LANES == 4
    return (Vd)_mm256_sqrt_pd((__m256d)v);
#elif defined(__x86_64__)
    return (Vd)_mm512_sqrt_pd((__m512d)v);
#else
    for (int lane = 0; lane < kLanes; ++lane) v[lane] = std::sqrt(v[lane]);
    return v;
#endif
}

static inline Vf splat(float v) { return Vf{} + v; }

static inline Vf loaded(const float *values) { return *reinterpret_cast<const Loose *>(values); }
