// Whether alpha leaves a surface there: an image's, times what the corners hold. Texel centres lie at
// (i + 0.5) / N, v runs upwards.
#pragma once
#include <cmath>

#include "scene.hpp"

namespace lw {

// The texel an index means under a wrap rule; -1 is outside a clipped image.
inline int64_t wrapped(double index, int64_t size, int32_t wrap) {
  const double n = static_cast<double>(size);
  switch (wrap) {
    case 0: return static_cast<int64_t>(index - n * std::floor(index / n)) % size;
    case 1: return index < 0 ? 0 : (index >= n ? size - 1 : static_cast<int64_t>(index));
    case 2: return index < 0 || index >= n ? -1 : static_cast<int64_t>(index);
    default: {
      const auto at = static_cast<int64_t>(index - 2 * n * std::floor(index / (2 * n))) % (2 * size);
      return at < size ? at : 2 * size - 1 - at;
    }
  }
}

inline double texel(const LwAlpha& image, int64_t column, int64_t row_from_bottom) {
  if (column < 0 || row_from_bottom < 0) return 0.0;
  const int64_t row = image.height - 1 - row_from_bottom;
  return image.texels[row * image.width + column];
}

// Alpha in 0..255.
inline double alpha_at(const LwAlpha& image, double u, double v) {
  if (image.wrap == 2 && (u < 0 || u > 1 || v < 0 || v > 1)) return 0.0;
  const double x = u * image.width - (image.linear ? 0.5 : 0.0);
  const double y = v * image.height - (image.linear ? 0.5 : 0.0);
  const double column = std::floor(x), row = std::floor(y);
  const int64_t c0 = wrapped(column, image.width, image.wrap);
  const int64_t r0 = wrapped(row, image.height, image.wrap);
  if (!image.linear) return texel(image, c0, r0);
  const int64_t c1 = wrapped(column + 1, image.width, image.wrap);
  const int64_t r1 = wrapped(row + 1, image.height, image.wrap);
  const double tx = x - column, ty = y - row;
  const double lower = texel(image, c0, r0) + tx * (texel(image, c1, r0) - texel(image, c0, r0));
  const double upper = texel(image, c0, r1) + tx * (texel(image, c1, r1) - texel(image, c0, r1));
  return lower + ty * (upper - lower);
}

// e are the homogeneous barycentric weights of the sample (not normalised, of one sign).
inline bool cut_away(const LwSurfaces& surfaces, int64_t triangle, const double e[3]) {
  const LwAlpha& image = surfaces.alphas[surfaces.triangle_cutout[triangle]];
  const float* uv = surfaces.corner_uv + 6 * triangle;
  const double sum = (e[0] + e[1]) + e[2];
  const double u = (e[0] * uv[0] + e[1] * uv[2] + e[2] * uv[4]) / sum;
  const double v = (e[0] * uv[1] + e[1] * uv[3] + e[2] * uv[5]) / sum;
  const double alpha = alpha_at(image, u, v) / 255.0;
  if (surfaces.corner_alpha == nullptr) return alpha < surfaces.threshold;
  const float* at = surfaces.corner_alpha + 3 * triangle;
  return alpha * ((e[0] * at[0] + e[1] * at[1] + e[2] * at[2]) / sum) < surfaces.threshold;
}

// Determinant of a (3,4) matrix's linear part: below 0 where it mirrors.
inline double volume_of(const double* m) {
  return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
         m[2] * (m[4] * m[9] - m[5] * m[8]);
}

// Whether a cut-out triangle is not there from the side it is seen from. winding: the sign of the edge
// functions of a hit, positive where the corners' normal points away from the eye.
inline bool turned_away(const LwSurfaces& surfaces, int64_t triangle, const double* cam_from_mesh,
                        double winding) {
  const int32_t sides = surfaces.alphas[surfaces.triangle_cutout[triangle]].sides;
  if (sides == 0) return false;
  const bool front = (winding > 0) == (volume_of(cam_from_mesh) < 0);
  return front != (sides == 1);
}

}  // namespace lw
