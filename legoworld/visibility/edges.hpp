// Edge functions of triangles in ray space. Included once per instruction set.
//
// With corners v0, v1, v2 in camera space and a ray p = (rx, ry, 1), p hits the triangle where
// det(p, v1, v2), det(p, v2, v0) and det(p, v0, v1) have one sign; the three values are then the
// sample's homogeneous barycentric weights. Nothing is divided, so corners may lie behind the camera.
// Orthographic: the same with w = 1 in place of z.

struct Corners {
  Vd x[3], y[3], z[3];
};

struct Edges {           // value k at a ray: a[k] * rx + (b[k] * ry + c[k])
  Vd a[3], b[3], c[3];
  Vd tiny;               // a sum of the three values below this is rounding: edge-on or no area
  Vd side;               // its sign is the sign of the three values of a hit in front of the camera
  Vm unsure;             // where `side` is within its rounding error: take both signs
  Vm flat;               // where no ray's sum can exceed `tiny`: the triangle shows nothing
};

static inline void to_camera(const Vd m[12], Vd vx, Vd vy, Vd vz, Vd& x, Vd& y, Vd& z) {
  x = ((m[0] * vx + m[1] * vy) + m[2] * vz) + m[3];
  y = ((m[4] * vx + m[5] * vy) + m[6] * vz) + m[7];
  z = ((m[8] * vx + m[9] * vy) + m[10] * vz) + m[11];
}

static inline void spread_matrix(const double* cam_from_mesh, Vd m[12]) {
  for (int i = 0; i < 12; ++i) m[i] = spread(cam_from_mesh[i]);
}

// from[lane] points at the three vertex indices of that lane's triangle.
static inline Corners gather_corners(const Vd m[12], const float* const vertices[kLanes],
                                     const int32_t* const from[kLanes]) {
  Corners out;
  for (int k = 0; k < 3; ++k) {
#define LW_AT(L) (vertices[L] + 3 * static_cast<int64_t>(from[L][k]))
    const float* const at[kLanes] = {LW_EACH(LW_AT)};
#undef LW_AT
#define LW_X(L) at[L][0]
#define LW_Y(L) at[L][1]
#define LW_Z(L) at[L][2]
    const Vf x = {LW_EACH(LW_X)}, y = {LW_EACH(LW_Y)}, z = {LW_EACH(LW_Z)};
#undef LW_X
#undef LW_Y
#undef LW_Z
    to_camera(m, widen(x), widen(y), widen(z), out.x[k], out.y[k], out.z[k]);
  }
  return out;
}

// One edge is base x (end - start), with the corner nearer the origin as base: its rounding error is
// then relative to the shorter corner times the edge's length. Both triangles of a shared edge choose
// the same base and opposite differences, so their values are each other's exact negatives.
static inline void make_edge(const Corners& t, const Vd w[3], const Vd size[3], int k, Edges& out) {
  const int i = (k + 1) % 3, j = (k + 2) % 3;
  const Vd dx = t.x[j] - t.x[i], dy = t.y[j] - t.y[i], dw = w[j] - w[i];
  const Vm first = size[i] < size[j], last = size[j] < size[i];
  const Vd x = first ? t.x[i] : (last ? t.x[j] : 0.5 * (t.x[i] + t.x[j]));
  const Vd y = first ? t.y[i] : (last ? t.y[j] : 0.5 * (t.y[i] + t.y[j]));
  const Vd u = first ? w[i] : (last ? w[j] : 0.5 * (w[i] + w[j]));
  out.a[k] = y * dw - u * dy;
  out.b[k] = u * dx - x * dw;
  out.c[k] = x * dy - y * dx;
  out.tiny += smaller(size[i], size[j]) * (magnitude(dx) + magnitude(dy) + magnitude(dw));
}

// With M the bound that `tiny` is 32 half-ulps of, each value's rounding is at most 3 half-ulps of its
// share of M, that of their sum 2 more, that of the sums of coefficients below another 2. So a computed
// sum is at most area * longest ray + 7 half-ulps: not above `tiny` where the first term is below 16.
constexpr double kLeastSum = 1e-250;  // far above underflow

static inline Edges make_edges(const Corners& t, bool orthographic, double reach) {
  Edges out;
  Vd w[3], size[3];
  for (int k = 0; k < 3; ++k) {
    w[k] = orthographic ? spread(1.0) : t.z[k];
    size[k] = magnitude(t.x[k]) + magnitude(t.y[k]) + magnitude(w[k]);
  }
  out.tiny = Vd{};
  for (int k = 0; k < 3; ++k) make_edge(t, w, size, k, out);
  out.tiny *= reach;
  out.side = out.a[0] * t.x[0] + (out.b[0] * t.y[0] + out.c[0] * w[0]);
  out.unsure = magnitude(out.side) <= out.tiny * size[0];
  const Vd area = magnitude((out.a[0] + out.a[1]) + out.a[2]) +
                  magnitude((out.b[0] + out.b[1]) + out.b[2]) +
                  magnitude((out.c[0] + out.c[1]) + out.c[2]);
  out.flat = (area * reach <= 0.5 * kRounding * out.tiny) & (out.tiny > kLeastSum);
  return out;
}

// Planar z of a sample from its weights; never outside the corners' range.
static inline Vd sample_z(Vd e0, Vd e1, Vd e2, Vd sum, Vd z0, Vd z1, Vd z2, Vd low, Vd high) {
  const Vd z = ((e0 * z0 + e1 * z1) + e2 * z2) / sum;
  return smaller(larger(z, low), high);
}
