// Which columns a triangle may cover in each row of a tile. Included once per instruction set.
//
// In a row an edge's value is a * rx + (b * ry + c): negative left (or right) of a column that moves
// by the same step from row to row. Spans are found from that line in float32, eight rows at once, with
// all rounding on the outer side (slack): what a span leaves out cannot hit, what it holds is asked.

struct Single {  // one triangle, ready to be drawn into a tile
  double a[3], b[3], c[3];
  double tiny, z[3], low, high;
  int64_t cut;  // the triangle's global index when its alpha decides, else -1
  int32_t id;
  float nearest;
  int32_t origin;  // its number among the tile's origins, where they are asked for
};

constexpr double kLeastSlope = 1e-290;  // below, products may underflow: the edge bounds nothing

// Of kLanes triangles: in row y of the tile no hit lies left of first_column[k] + y * first_step[k]
// or right of the same of `last`.
struct Sides {
  Vf first_column[3], first_step[3], last_column[3], last_step[3];
};

// Slack: float32 rounds four values below |column| + kTile * |step|, each by 2^-24 of itself; float64
// rounds b * ry + c by at most 2^-51 of |b * ry| + |c|; the rest is far below 0.001 while |cx| < 1e9.
// sign: 1 or -1, what makes the edges' values positive inside.
static inline Sides find_sides(const Frame& frame, const Edges& e, Vd sign, int32_t left, int32_t top) {
  const LwView& view = frame.view;
  const double ry = frame.ray_y.data()[top], shift = view.cx - 0.5 - left, per_row = 1 / view.fy;
  Sides out;
  for (int k = 0; k < 3; ++k) {
    const Vd scale = -view.fx / e.a[k];
    const Vd column = scale * (e.b[k] * ry + e.c[k]) + shift;
    const Vd step = scale * e.b[k] * per_row;
    const Vd slack = 1e-3 + 0x1p-21 * (magnitude(column) + double{kTile} * magnitude(step)) +
                     0x1p-49 * magnitude(scale) * (magnitude(e.b[k]) * frame.longest + magnitude(e.c[k]));
    const Vm from = e.a[k] * sign > kLeastSlope, until = e.a[k] * sign < -kLeastSlope;
    out.first_column[k] = narrow(from ? column - slack : spread(-INFINITY));
    out.first_step[k] = narrow(from ? step : Vd{});
    out.last_column[k] = narrow(until ? column + slack : spread(INFINITY));
    out.last_step[k] = narrow(until ? step : Vd{});
  }
  return out;
}

struct Spans {  // of one row of blocks
  int32_t first[kBlock], last[kBlock];
};

// The rows of block row `by`, bit by bit, that have a column left inside the box.
static inline unsigned find_spans(const Sides& sides, int lane, const Candidate& box, int by,
                                  Spans& out) {
  const int top = by * kBlock;
  const Row y = Row{0, 1, 2, 3, 4, 5, 6, 7} + static_cast<float>(top);
  const Row x0 = spread_row(box.x0), x1 = spread_row(box.x1);
  Row first = x0, last = x1;
  for (int k = 0; k < 3; ++k) {
    const Row from = y * sides.first_step[k][lane] + sides.first_column[k][lane];
    const Row until = y * sides.last_step[k][lane] + sides.last_column[k][lane];
    first = from > first ? from : first;  // NaN bounds nothing
    last = until < last ? until : last;
  }
  const Row beyond = x1 + 1.0f, before = x0 - 1.0f;
  first = (first < beyond ? first : beyond) + (1.0f - 0x1p-10f);  // truncated: the next column
  last = last > before ? last : before;
  const RowMask whole_first = __builtin_convertvector(first, RowMask);
  const RowMask whole_last = __builtin_convertvector(last, RowMask);
  store(out.first, whole_first);
  store(out.last, whole_last);
  const int y0 = box.y0 > top ? box.y0 - top : 0, y1 = box.y1 - top < kBlock ? box.y1 - top : kBlock - 1;
  return row_bits(whole_first <= whole_last) & (0xffu << y0) & (0xffu >> (kBlock - 1 - y1));
}
