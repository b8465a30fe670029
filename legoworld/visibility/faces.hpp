// Triangles a few at a time: corners, edges, which way they face; and which of them a tile's samples are of.
// Included once per instruction set.

struct Several {  // kLanes candidates, set up at once
  Corners t;
  Edges e;  // by set_up
  Vd low, high;
  int64_t triangle[kLanes];  // global indices
  const double* matrix[kLanes];  // cam_from_mesh of each
};

static inline Several gather(const Frame& frame, const Candidate* boxes, int used) {
  const LwSurfaces& all = frame.surfaces;
  const float* vertices[kLanes];
  const int32_t* from[kLanes];
  Several out;
  for (int lane = 0; lane < kLanes; ++lane) {
    const Candidate& box = boxes[lane < used ? lane : 0];
    const int64_t mesh = all.placement_mesh[box.placement];
    out.triangle[lane] = all.triangle_start[mesh] + box.triangle;
    vertices[lane] = all.vertices + 3 * all.vertex_start[mesh];
    from[lane] = all.triangles + 3 * out.triangle[lane];
    out.matrix[lane] = all.cam_from_mesh + 12 * static_cast<int64_t>(box.placement);
  }
  Vd m[12];
  for (int i = 0; i < 12; ++i) {
#define LW_ENTRY(L) out.matrix[L][i]
    m[i] = Vd{LW_EACH(LW_ENTRY)};
#undef LW_ENTRY
  }
  out.t = gather_corners(m, vertices, from);
  return out;
}

static inline Several set_up(const Frame& frame, const Candidate* boxes, int used) {
  Several out = gather(frame, boxes, used);
  out.e = make_edges(out.t, frame.orthographic, frame.reach);
  out.low = smaller(smaller(out.t.z[0], out.t.z[1]), out.t.z[2]);
  out.high = larger(larger(out.t.z[0], out.t.z[1]), out.t.z[2]);
  return out;
}

struct Turns {  // of the normals so far
  uint32_t placement = UINT32_MAX;  // the last one's
  double side = 1;                  // -1 where it mirrors
  int64_t flipped = 0;              // turned towards the camera

  double side_of(uint32_t next, const double* cam_from_mesh) {
    if (next != placement) side = volume_of(cam_from_mesh) < 0 ? -1.0 : 1.0;
    placement = next;
    return side;
  }
};

struct Normal {
  float again[kBlock + 2];  // x, y, z, x, y, ...: a vector load finds each place of a row of normals
};

struct Facing {  // unit normals of kLanes triangles, turned towards the camera at a box's first pixel
  Vf x, y, z;
  Vd across, rest;  // normal . ray before it was turned, at a column: across * ray_x + rest, in the box's first row
  unsigned turned;  // bit by bit those that were
  unsigned mixed;   // those that other pixels of the box may see from their other side

  Normal normal(int lane) const {
    const float a = x[lane], b = y[lane], c = z[lane];
    return {{a, b, c, a, b, c, a, b, c, a}};
  }
};

static inline Facing facing_of(const Frame& frame, const Tile& tile, const Several& of,
                               const Candidate* boxes, int used, Turns& turns) {
  const Corners& t = of.t;
  const Vd ux = t.x[1] - t.x[0], uy = t.y[1] - t.y[0], uz = t.z[1] - t.z[0];
  const Vd wx = t.x[2] - t.x[0], wy = t.y[2] - t.y[0], wz = t.z[2] - t.z[0];
  // The product of two moved edges is the moved normal times the determinant: so is its sign.
  Vd nx = uy * wz - uz * wy, ny = uz * wx - ux * wz, nz = ux * wy - uy * wx;
  const double* ray_x = frame.ray_x.data() + tile.left;
  const double* ray_y = frame.ray_y.data() + tile.top;
#define LW_BOX(L) boxes[L < used ? L : 0]
#define LW_SIDE(L) turns.side_of(LW_BOX(L).placement, of.matrix[L])
#define LW_LEFT(L) ray_x[LW_BOX(L).x0]
#define LW_RIGHT(L) ray_x[LW_BOX(L).x1]
#define LW_TOP(L) ray_y[LW_BOX(L).y0]
#define LW_BOTTOM(L) ray_y[LW_BOX(L).y1]
  const Vd side = {LW_EACH(LW_SIDE)}, left = {LW_EACH(LW_LEFT)}, right = {LW_EACH(LW_RIGHT)};
  const Vd top = {LW_EACH(LW_TOP)}, bottom = {LW_EACH(LW_BOTTOM)};
#undef LW_BOTTOM
#undef LW_TOP
#undef LW_RIGHT
#undef LW_LEFT
#undef LW_SIDE
#undef LW_BOX
  const Vd scale = side / root((nx * nx + ny * ny) + nz * nz);
  nx *= scale;
  ny *= scale;
  nz *= scale;
  Facing out;
  out.across = frame.orthographic ? Vd{} : nx;
  out.rest = frame.orthographic ? nz : ny * top + nz;
  const Vd low = frame.orthographic ? nz : ny * bottom + nz;
  // The value is monotone along rows and columns, also as it is rounded: equal corners, equal all.
  const Vm away = out.across * left + out.rest > 0;
  out.turned = bits(away);
  out.mixed = bits(away ^ (out.across * right + out.rest > 0)) | bits(away ^ (out.across * left + low > 0)) |
              bits(away ^ (out.across * right + low > 0));
  out.x = narrow((away ? -nx : nx) + 0.0);
  out.y = narrow((away ? -ny : ny) + 0.0);
  out.z = narrow((away ? -nz : nz) + 0.0);
  return out;
}

struct Origin {    // a triangle that samples of the tile are of
  int64_t source;  // see source_of
  Normal normal;   // where `turned` says so
  int32_t turned;  // 1 where the tile sees its back, 0 its front; -1: `normal` is unknown, or differs
};

struct Origins {
  int32_t at[kTile * kStride];  // of each stored sample; without one, any
  std::vector<Origin> known;
  int32_t count;  // of those in use
  bool normals;   // whether triangles of the second pass keep their normals
  Turns turns;

  explicit Origins(const LwHits& hits)
      : at{}, known(1024), count(0),
        normals(hits.normal != nullptr && hits.barycentric == nullptr && hits.corner_normal == nullptr) {}

  int64_t source(int32_t origin) const { return known[static_cast<size_t>(origin)].source; }

  Origin* more(int used) {
    if (static_cast<size_t>(count + used) > known.size()) known.resize(2 * known.size());
    count += used;
    return known.data() + (count - used);
  }

  int32_t add(int64_t source) {
    Origin& origin = *more(1);
    origin.source = source;
    origin.turned = -1;
    return count - 1;
  }

  // The first `used` of kLanes candidates. Returns the first one's.
  int32_t add(const Frame& frame, const Tile& tile, const Several& of, const Candidate* boxes, int used) {
    Origin* to = more(used);
    for (int lane = 0; lane < used; ++lane) {
      to[lane].source = source_of(boxes[lane].placement, boxes[lane].triangle);
      to[lane].turned = -1;
    }
    if (!normals) return count - used;
    const Facing facing = facing_of(frame, tile, of, boxes, used, turns);
    for (int lane = 0; lane < used; ++lane) {
      to[lane].normal = facing.normal(lane);
      if ((facing.mixed >> lane & 1) == 0) to[lane].turned = facing.turned >> lane & 1;
    }
    return count - used;
  }
};
