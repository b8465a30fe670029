// One look at all arrays before they are trusted: finite vertices, indices in range, each mesh's box.
// Included once per instruction set.

constexpr int64_t kValidated = 65536;  // vertices or triangles in one portion
constexpr int kPeriod = 24;           // floats, a multiple of 3 and of the vector width

static void prepare_validation(Frame& frame) {
  const LwSurfaces& all = frame.surfaces;
  for (int64_t mesh = 0; mesh < all.meshes; ++mesh) {
    const Shape shape(all, mesh);
    int64_t begin = 0;
    do {
      const int64_t end = begin + kValidated;
      frame.portions.push_back(Portion{mesh, begin < shape.vertex_count ? begin : shape.vertex_count,
                                       end < shape.vertex_count ? end : shape.vertex_count,
                                       begin < shape.triangle_count ? begin : shape.triangle_count,
                                       end < shape.triangle_count ? end : shape.triangle_count});
      begin = end;
    } while (begin < shape.vertex_count || begin < shape.triangle_count);
  }
  frame.portion_boxes.at_least(frame.portions.size());
  frame.boxes.at_least(static_cast<size_t>(all.meshes));
  frame.validation_queue.reset(static_cast<int64_t>(frame.portions.size()),
                           frame.portions.size() > 4096 ? 32 : 1);
}

static void join(Box& box, const Box& other) {
  for (int k = 0; k < 3; ++k) {
    box.low[k] = other.low[k] < box.low[k] ? other.low[k] : box.low[k];
    box.high[k] = other.high[k] > box.high[k] ? other.high[k] : box.high[k];
  }
}

static const Box kEmptyBox = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

// Box of `count` vertices; false when one is not finite.
static bool box_of(const float* vertices, int64_t count, Box& box) {
  float low[kPeriod], high[kPeriod];
  int32_t largest[kPeriod] = {};  // as bit patterns: above 0x7f7fffff are infinities and NaN
  for (int j = 0; j < kPeriod; ++j) {
    low[j] = INFINITY;
    high[j] = -INFINITY;
  }
  const int64_t values = 3 * count;
  for (int64_t i = 0; i < values; i += kPeriod) {
    float copy[kPeriod];
    const int64_t left = values - i;
    if (left >= kPeriod) {
      std::memcpy(copy, vertices + i, sizeof copy);
    } else {
      for (int j = 0; j < kPeriod; ++j) copy[j] = vertices[i + (j < left ? j : j % 3)];
    }
    int32_t pattern[kPeriod];
    std::memcpy(pattern, copy, sizeof copy);
    for (int j = 0; j < kPeriod; ++j) {
      low[j] = copy[j] < low[j] ? copy[j] : low[j];
      high[j] = copy[j] > high[j] ? copy[j] : high[j];
      const int32_t size = pattern[j] & 0x7fffffff;
      largest[j] = size > largest[j] ? size : largest[j];
    }
  }
  box = kEmptyBox;
  bool finite = true;
  for (int j = 0; j < kPeriod; ++j) {
    Box one = kEmptyBox;
    one.low[j % 3] = low[j];
    one.high[j % 3] = high[j];
    join(box, one);
    finite &= largest[j] <= 0x7f7fffff;
  }
  return finite;
}

static bool indices_below(const int32_t* indices, int64_t count, int64_t limit) {
  uint32_t largest = 0;  // a negative index is a large unsigned one
  for (int64_t i = 0; i < count; ++i) {
    const auto index = static_cast<uint32_t>(indices[i]);
    largest = index > largest ? index : largest;
  }
  return count == 0 || static_cast<int64_t>(largest) < limit;
}

static void validate_and_bound(Frame& frame, Team& team, int index) {
  team.phase([&] {
    for (int64_t begin, end; frame.validation_queue.take(begin, end);) {
      for (int64_t i = begin; i < end; ++i) {
        const Portion& part = frame.portions[static_cast<size_t>(i)];
        const Shape shape(frame.surfaces, part.mesh);
        if (!box_of(shape.vertices + 3 * part.vertex_begin, part.vertex_end - part.vertex_begin,
                    frame.portion_boxes.data()[i])) {
          frame.status = kVertexNotFinite;
        }
        if (!indices_below(shape.triangles + 3 * part.triangle_begin,
                           3 * (part.triangle_end - part.triangle_begin), shape.vertex_count)) {
          frame.status = kIndexOutOfRange;
        }
      }
    }
  });
  team.phase([&] {
    if (index != 0) return;
    for (int64_t mesh = 0; mesh < frame.surfaces.meshes; ++mesh) frame.boxes.data()[mesh] = kEmptyBox;
    for (size_t i = 0; i < frame.portions.size(); ++i) {
      join(frame.boxes.data()[frame.portions[i].mesh], frame.portion_boxes.data()[i]);
    }
  });
}
