// Runs of equal ids of a finished picture, or of the layers of one: areas, extents, and masks as COCO
// writes them.

namespace lw {

constexpr int32_t kStep = 16;  // pixels that are compared at once

// Visible area of each instance, and its half-open extent x0, y0, x1, y1; zeros where area is 0.
static int32_t extents(const int32_t* instance, int32_t width, int32_t height, int64_t instances,
                       int64_t* area, int64_t* extent) {
  for (int64_t i = 0; i < instances; ++i) {
    const int64_t none[4] = {width, height, 0, 0};
    area[i] = 0;
    std::memcpy(extent + 4 * i, none, sizeof none);
  }
  for (int32_t y = 0; y < height; ++y) {
    const int32_t* row = instance + static_cast<int64_t>(y) * width;
    for (int32_t first = 0, x; first < width; first = x) {
      const int32_t id = row[first];
      x = first + 1;
      for (; x + kStep <= width; x += kStep) {
        int32_t other = 0;
        for (int32_t i = 0; i < kStep; ++i) other |= row[x + i] ^ id;
        if (other != 0) break;
      }
      while (x < width && row[x] == id) ++x;
      if (id < 0) continue;
      if (id >= instances) return kIndexOutOfRange;
      int64_t* e = extent + 4 * static_cast<int64_t>(id);
      area[id] += x - first;
      e[0] = first < e[0] ? first : e[0];
      e[1] = y < e[1] ? y : e[1];
      e[2] = x > e[2] ? x : e[2];
      e[3] = y + 1;
    }
  }
  for (int64_t i = 0; i < instances; ++i) {
    if (area[i] == 0) std::memset(extent + 4 * i, 0, 4 * sizeof *extent);
  }
  return kOk;
}

struct Run {
  int32_t id, first, end;  // half-open, in the order of columns
};

// Runs down the columns; a run may continue in the next column.
static std::vector<Run> column_runs(const int32_t* instance, int32_t width, int32_t height) {
  constexpr int32_t kStrip = 16;  // columns: one cache line of each row
  std::vector<Run> runs;
  std::vector<int32_t> strip(static_cast<size_t>(kStrip) * height);
  int32_t last = INT32_MIN;
  for (int32_t left = 0; left < width; left += kStrip) {
    const int32_t columns = width - left < kStrip ? width - left : kStrip;
    for (int32_t y = 0; y < height; ++y) {
      const int32_t* row = instance + static_cast<int64_t>(y) * width + left;
      for (int32_t c = 0; c < columns; ++c) strip[static_cast<size_t>(c) * height + y] = row[c];
    }
    for (int32_t c = 0; c < columns; ++c) {
      const int32_t* column = strip.data() + static_cast<size_t>(c) * height;
      for (int32_t y = 0; y < height;) {
        if (y + kStep <= height) {
          int32_t other = 0;
          for (int32_t k = 0; k < kStep; ++k) other |= column[y + k] ^ last;
          if (other == 0) {
            y += kStep;
            continue;
          }
        }
        const int32_t end = y + kStep < height ? y + kStep : height;
        for (; y < end; ++y) {
          if (column[y] == last) continue;
          last = column[y];
          const int32_t first = (left + c) * height + y;
          if (!runs.empty()) runs.back().end = first;
          runs.push_back(Run{last, first, width * height});
        }
      }
    }
  }
  return runs;
}

// Runs down the columns of every instance, which may overlap. start, instance: as LwLayers has them.
static std::vector<Run> layer_runs(const int64_t* start, const int32_t* instance, int32_t width,
                                   int32_t height, int64_t instances) {
  std::vector<Run> runs;
  std::vector<int64_t> newest(static_cast<size_t>(instances), -1);
  for (int32_t x = 0; x < width; ++x) {
    for (int32_t y = 0; y < height; ++y) {
      const int64_t pixel = static_cast<int64_t>(y) * width + x;
      const int32_t at = x * height + y;
      for (int64_t k = start[pixel]; k < start[pixel + 1]; ++k) {
        const int32_t id = instance[k];
        if (id < 0 || id >= instances) continue;
        int64_t& mine = newest[static_cast<size_t>(id)];
        if (mine >= 0 && runs[static_cast<size_t>(mine)].end == at) {
          ++runs[static_cast<size_t>(mine)].end;
        } else {
          mine = static_cast<int64_t>(runs.size());
          runs.push_back(Run{id, at, at + 1});
        }
      }
    }
  }
  return runs;
}

// Text of run lengths, as pycocotools' rleToString writes them: five bits a character, each length
// from the fourth on as its difference to the one two before. Where the space ends, characters are
// counted and not written.
struct Text {
  char* at;
  int64_t space, used = 0;
  int64_t before[2] = {0, 0};
  int count = 0;

  void begin() { count = 0; }

  void add(int64_t length) {
    int64_t x = count > 2 ? length - before[0] : length;
    before[0] = before[1];
    before[1] = length;
    ++count;
    for (bool more = true; more;) {
      int64_t bits = x & 0x1f;
      x >>= 5;
      more = (bits & 0x10) != 0 ? x != -1 : x != 0;
      if (more) bits |= 0x20;
      if (used < space) at[used] = static_cast<char>(bits + 48);
      ++used;
    }
  }
};

// The compressed run lengths of the instances 0..instances - 1, one text after another; ends: where
// each of them ends. Returns how many characters they take, also where the space is not enough.
static int64_t masks(const std::vector<Run>& runs, int64_t pixels, int64_t instances, char* text,
                     int64_t space, int64_t* ends) {
  std::vector<int64_t> begin(static_cast<size_t>(instances) + 1);
  for (const Run& run : runs) {
    if (run.id >= 0 && run.id < instances) ++begin[static_cast<size_t>(run.id) + 1];
  }
  for (int64_t i = 0; i < instances; ++i) begin[i + 1] += begin[i];
  std::vector<size_t> order(static_cast<size_t>(begin[instances]));
  std::vector<int64_t> next(begin);
  for (size_t r = 0; r < runs.size(); ++r) {
    if (runs[r].id >= 0 && runs[r].id < instances) order[next[runs[r].id]++] = r;
  }
  Text out{text, space};
  for (int64_t i = 0; i < instances; ++i) {
    int64_t reached = 0;
    out.begin();
    for (int64_t k = begin[i]; k < begin[i + 1]; ++k) {
      const Run& run = runs[order[k]];
      out.add(run.first - reached);
      out.add(run.end - run.first);
      reached = run.end;
    }
    if (reached < pixels) out.add(pixels - reached);
    ends[i] = out.used;
  }
  return out.used;
}

}  // namespace lw
