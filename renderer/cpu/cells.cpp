#include "renderer/cpu/cells.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <numeric>
#include <utility>

#include "base/interruption.h"
#include "renderer/cpu/cell_frame.h"
#include "renderer/cpu/samples.h"
#include "scene/tile_grid.h"

namespace splatvol {

using namespace tiles;

namespace {

constexpr double largest_u = 1e28;
constexpr float farthest = 1e30F;  // d, in size

/// The box round what is in a chunk, in view coordinates.
Box box_in_view(const View& view, const Box& box) {
  Box result;
  for (int i = 0; i < 8; ++i)
    result.include(view.to_view({(i & 1) != 0 ? box.high.x : box.low.x, (i & 2) != 0 ? box.high.y : box.low.y,
                                 (i & 4) != 0 ? box.high.z : box.low.z}));
  // Rounded outwards.
  const dvec3 margin = 1e-12 * glm::max(glm::abs(result.low), glm::abs(result.high));
  result.low -= margin, result.high += margin;
  return result;
}

/// A chunk that may be drawn.
struct Chunk {
  CellSource::Chunk source;
  Box box;                 // in view coordinates
  PixelRectangle tiles{};  // that it may cover
};

/// A chunk in a tile.
struct InTile {
  std::uint32_t chunk;  // its number in the order
  float first_key;      // no segment of it has a lower key here
  float later_key;      // nor has any of the chunks behind it
};

/// A tile between batches.
struct Tile {
  CellTileLight light;
  std::vector<CellSegment> waiting;  // pixel by pixel
  std::vector<SegmentShade> shades;  // of these
  std::vector<std::int32_t> counts;  // [pixel]; empty: none wait
  std::vector<InTile> chunks;
  std::size_t next = 0;  // of these
  bool is_open = true;

  void clear() {
    for (auto& channel : light.color) channel.fill(0);
    light.transmittance.fill(1);
    waiting.clear();
    shades.clear();
    counts.clear();
    chunks.clear();
    next = 0;
    is_open = true;
  }
};

struct SetupScratch {
  DrawnCells cells;
  CellSetup setup;
};

}  // namespace

/// What pictures share: its memory.
struct tiles::CellWorkspace {
  std::vector<Tile> tiles;             // of a band
  std::vector<CellsOnScreen> screens;  // of a batch
  tbb::enumerable_thread_specific<SetupScratch> scratches;
  tbb::enumerable_thread_specific<TileSegments> segments;
};

namespace {

/// The picture of cells in a band of tiles.
class CellSweep {
 public:
  CellSweep(const CellSource& source, const CellDrawing& drawing, const View& view, CellWorkspace& workspace)
      : source_(source),
        drawing_(drawing),
        view_(view),
        function_(drawing.transfer.function, 1),
        across_((view.width + cell_tile_side - 1) / cell_tile_side),
        up_((view.height + cell_tile_side - 1) / cell_tile_side),
        workspace_(workspace) {
    const TransferFunction& function = drawing.transfer.function;
    frame_.view = &view_;
    frame_.function = &function_;
    frame_.low = function.lo;
    frame_.inverse_domain = 1 / (function.hi - function.lo);
    frame_.middle_x = 0.5 * view.width - 0.5;
    frame_.middle_y = 0.5 * view.height - 0.5;
    const auto side = static_cast<float>(std::max(view.width, view.height));
    frame_.widest = std::max(1024.0F, 2 * side);
    if (drawing.lighting) frame_.lighting = &*drawing.lighting;
    frame_.surfaces = drawing.surfaces;
    if (const TransferFunction* opacity = drawing.transfer.opacity) {
      opacity_.emplace(*opacity, 1);
      frame_.opacity = &*opacity_;
      frame_.opacity_low = opacity->lo;
      frame_.opacity_inverse = 1 / (opacity->hi - opacity->lo);
    }
    frame_.slack = std::max(0.002F, 4e-6F * side);
    order_chunks();
  }

  Result<CellPicture> draw() {
    picture_.image.width = view_.width;
    picture_.image.height = view_.height;
    picture_.image.pixels.assign(static_cast<std::size_t>(view_.width) * static_cast<std::size_t>(view_.height),
                                 vec4(0));
    // Bands of rows that are left, the next one last: a band is halved if too much waits in it.
    std::vector<std::pair<int, int>> bands = {{0, up_}};
    while (!bands.empty()) {
      const auto [begin, end] = bands.back();
      bands.pop_back();
      SPLATVOL_TRY_ASSIGN(is_drawn, draw_band(begin, end));
      if (is_drawn) continue;
      const int half = (begin + end) / 2;
      bands.emplace_back(half, end);
      bands.emplace_back(begin, half);
    }
    picture_.segments = drawn_segments_;
    return std::move(picture_);
  }

 private:
  void order_chunks();
  [[nodiscard]] PixelRectangle tiles_of(const Box& box) const;
  [[nodiscard]] double nearest_depth(const Box& box, int column, int row) const;
  [[nodiscard]] float first_key(double depth) const;
  Result<bool> draw_band(int begin, int end);
  [[nodiscard]] bool shows(const Chunk& chunk, int begin, int end) const;
  Status read(const Chunk& chunk, CellsOnScreen& screen);
  void place_values(const DrawnCells& cells, CellSetup& setup) const;
  void place_points(const Chunk& chunk, const DrawnCells& cells, CellSetup& setup, CellsOnScreen& screen) const;
  void shade(const DrawnCells& cells, const CellSetup& setup, CellsOnScreen& screen) const;
  [[nodiscard]] std::array<double, 2> visible_depths(int x, int y) const;
  using TileDepths = std::array<std::array<double, 2>, cell_tile_pixels>;
  void set_limits(const CellsOnScreen& screen, const TileDepths& depths, TileSegments& segments) const;
  static void sort_into_tiles(CellSetup& setup, CellsOnScreen& screen);
  bool draw_tile(int column, int row, std::uint32_t first, std::span<const CellsOnScreen> screens, Tile& tile);
  [[nodiscard]] float nearest_d(const CellsOnScreen& screen, float key) const;
  void finish_tile(int column, int row, const Tile& tile);
  [[nodiscard]] Tile& tile_at(int column, int row) {
    return workspace_.tiles[static_cast<std::size_t>(row - band_begin_) * static_cast<std::size_t>(across_) +
                            static_cast<std::size_t>(column)];
  }
  [[nodiscard]] const Tile& tile_at(int column, int row) const {
    return const_cast<CellSweep*>(this)->tile_at(column, row);
  }

  const CellSource& source_;
  const CellDrawing& drawing_;
  View view_;
  FunctionPieces function_;
  std::optional<FunctionPieces> opacity_;
  CellFrame frame_;
  int across_, up_;            // tiles
  std::vector<Chunk> chunks_;  // by their nearest depth
  int band_begin_ = 0;
  CellWorkspace& workspace_;
  std::atomic<std::uint64_t> drawn_segments_ = 0;
  CellPicture picture_;
};

void CellSweep::order_chunks() {
  double reach = 0;
  for (const CellSource::Chunk& chunk : source_.chunks()) {
    chunks_.push_back({chunk, box_in_view(view_, chunk.box)});
    reach = std::max(reach, chunks_.back().box.high.z);
  }
  frame_.nearest = view_.orthographic ? 0 : 1e-7 * reach;
  frame_.farthest_w = view_.orthographic ? reach : 1 / std::max(reach, std::numeric_limits<double>::min());
  std::erase_if(chunks_, [&](Chunk& chunk) {
    if (chunk.box.high.z <= frame_.nearest) return true;
    chunk.tiles = tiles_of(chunk.box);
    return chunk.tiles.is_empty();
  });
  std::ranges::sort(chunks_, {}, [](const Chunk& chunk) { return std::pair(chunk.box.low.z, chunk.source.number); });
}

PixelRectangle CellSweep::tiles_of(const Box& box) const {
  const bool is_round_eye = !view_.orthographic && box.low.z <= frame_.nearest;
  const auto range = [&](double low, double high, double middle, int pixels) {
    if (is_round_eye) {
      if (low > 0 || high < 0) {  // beside the axis: beyond what the farthest point shows
        const double at = view_.focal * (low > 0 ? low : high) / box.high.z;
        low = low > 0 ? at : -1e9, high = high < 0 ? at : 1e9;
      } else {
        low = -1e9, high = 1e9;
      }
    } else {
      const double low_scale = view_.orthographic ? view_.focal : view_.focal / (low < 0 ? box.low.z : box.high.z);
      const double high_scale = view_.orthographic ? view_.focal : view_.focal / (high < 0 ? box.high.z : box.low.z);
      low *= low_scale, high *= high_scale;
    }
    const double slack = frame_.slack;
    return std::pair(static_cast<int>(std::clamp(std::ceil(low + middle - slack), 0.0, static_cast<double>(pixels))),
                     static_cast<int>(std::clamp(std::floor(high + middle + slack), -1.0, pixels - 1.0)));
  };
  const auto [left, right] = range(box.low.x, box.high.x, frame_.middle_x, view_.width);
  const auto [bottom, top] = range(box.low.y, box.high.y, frame_.middle_y, view_.height);
  if (left > right || bottom > top) return {0, -1, 0, -1};
  return {left / cell_tile_side, right / cell_tile_side, bottom / cell_tile_side, top / cell_tile_side};
}

// A depth that no ray of the tile reaches before it is in the box.
double CellSweep::nearest_depth(const Box& box, int column, int row) const {
  double depth = std::max(box.low.z, 0.0);
  if (view_.orthographic) return depth;
  const auto bound = [&](double low, double high, int tile, double middle) {
    const double first = (tile * cell_tile_side - middle) / view_.focal;
    const double last = first + (cell_tile_side - 1) / view_.focal;
    if (low > 0 && last > 0) depth = std::max(depth, low / last);
    if (high < 0 && first < 0) depth = std::max(depth, high / first);
  };
  bound(box.low.x, box.high.x, column, frame_.middle_x);
  bound(box.low.y, box.high.y, row, frame_.middle_y);
  return depth * (1 - 1e-6);
}

// A key that no segment has that begins at this depth or behind it.
float CellSweep::first_key(double depth) const {
  const double d =
      view_.orthographic ? frame_.farthest_w - depth : 1 / std::max(depth, frame_.nearest) - frame_.farthest_w;
  return std::nextafter(static_cast<float>(-d), -farthest);
}

// The largest d whose key is not below `key`.
float CellSweep::nearest_d(const CellsOnScreen& screen, float key) const {
  float d = -key - screen.key_offset;
  while (-(d + screen.key_offset) < key) d = std::nextafter(d, -farthest);
  return d;
}

// Returns false if more segments wait than fit into memory.
Result<bool> CellSweep::draw_band(int begin, int end) {
  band_begin_ = begin;
  std::vector<Tile>& tiles = workspace_.tiles;
  tiles.resize(static_cast<std::size_t>(across_) * static_cast<std::size_t>(end - begin));
  for (Tile& tile : tiles) tile.clear();
  for (std::uint32_t number = 0; number < chunks_.size(); ++number) {
    const Chunk& chunk = chunks_[number];
    for (int row = std::max(chunk.tiles.y0, begin); row <= std::min(chunk.tiles.y1, end - 1); ++row)
      for (int column = chunk.tiles.x0; column <= chunk.tiles.x1; ++column)
        tile_at(column, row).chunks.push_back({number, first_key(nearest_depth(chunk.box, column, row)), farthest});
  }
  for (Tile& tile : tiles)
    for (std::size_t i = tile.chunks.size(); i-- > 1;)
      tile.chunks[i - 1].later_key = std::min(tile.chunks[i].first_key, tile.chunks[i].later_key);

  constexpr std::uint64_t bytes_of_cell = sizeof(CellOnScreen) + 2 * sizeof(std::uint32_t);
  const std::uint64_t most = std::min<std::uint64_t>(drawing_.memory / 4, std::uint64_t{64} << 20);
  std::vector<std::uint32_t> batch;
  for (std::uint32_t first = 0; first < chunks_.size();) {
    SPLATVOL_TRY(check_interruption());
    batch.clear();
    std::uint32_t next = first;
    for (std::uint64_t bytes = 0; next < chunks_.size() && (bytes < most || batch.empty()); ++next) {
      if (!shows(chunks_[next], begin, end)) continue;
      batch.push_back(next);
      bytes += chunks_[next].source.tetrahedra * bytes_of_cell;
    }
    // What an earlier batch had stays for its memory.
    if (workspace_.screens.size() < next - first) workspace_.screens.resize(next - first);
    const std::span<CellsOnScreen> screens = std::span(workspace_.screens).first(next - first);
    for (CellsOnScreen& screen : screens) screen.clear();
    // Threads of the loops know nothing of the stop of this one.
    const std::stop_token stop = stop_of_thread();
    std::mutex mutex;
    Status status;
    tbb::parallel_for(std::size_t{0}, batch.size(), [&](std::size_t i) {
      const Interruptible heeds_stop(stop);
      if (is_interrupted()) return;
      Status read_one = read(chunks_[batch[i]], screens[batch[i] - first]);
      const std::scoped_lock lock(mutex);
      if (!read_one && status) status = std::move(read_one);
    });
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY(status);
    std::atomic<std::uint64_t> waiting = 0;
    std::atomic<bool> is_full = false;
    tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
      if (stop.stop_requested()) return;
      const int row = begin + static_cast<int>(i) / across_, column = static_cast<int>(i) % across_;
      if (!draw_tile(column, row, first, screens, tiles[i])) is_full = true;
      waiting += (tiles[i].waiting.capacity() + tiles[i].shades.capacity()) * sizeof(CellSegment);
    });
    SPLATVOL_TRY(check_interruption());
    if (is_full)
      return fail(ErrorCode::out_of_budget, "more than {} cells overlap at a place: draw splats instead",
                  TileSegments::most_room);
    if (waiting > drawing_.memory / 2 && end - begin > 1) return false;
    first = next;
    if (drawing_.progress && !chunks_.empty())
      drawing_.progress((begin + (end - begin) * static_cast<double>(first) / static_cast<double>(chunks_.size())) /
                        up_);
  }
  for (std::size_t i = 0; i < tiles.size(); ++i)
    finish_tile(static_cast<int>(i) % across_, begin + static_cast<int>(i) / across_, tiles[i]);
  return true;
}

bool CellSweep::shows(const Chunk& chunk, int begin, int end) const {
  for (int row = std::max(chunk.tiles.y0, begin); row <= std::min(chunk.tiles.y1, end - 1); ++row)
    for (int column = chunk.tiles.x0; column <= chunk.tiles.x1; ++column)
      if (tile_at(column, row).is_open) return true;
  return false;
}

Status CellSweep::read(const Chunk& chunk, CellsOnScreen& screen) {
  auto& [memory, setup] = workspace_.scratches.local();
  SPLATVOL_TRY_ASSIGN(held, source_.read(chunk.source, memory));
  const DrawnCells& cells = *held;
  if (cells.tetrahedra.empty()) return {};
  place_values(cells, setup);
  list_seen_cells(frame_, cells, setup);
  if (setup.seen.empty()) return {};
  place_points(chunk, cells, setup, screen);
  set_up_cells(frame_, cells, setup, screen);
  if (frame_.has_shades()) shade(cells, setup, screen);
  sort_into_tiles(setup, screen);
  return {};
}

void CellSweep::place_values(const DrawnCells& cells, CellSetup& setup) const {
  const auto to_u = [](const std::vector<double>& values, double low, double inverse, std::vector<float>& all) {
    all.resize(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double u = (values[i] - low) * inverse;
      all[i] = static_cast<float>(std::isnan(u) ? u : std::clamp(u, -largest_u, largest_u));
    }
  };
  std::vector<float>& u = setup.points.u;
  to_u(cells.values, frame_.low, frame_.inverse_domain, u);
  if (!frame_.opacity) return;
  to_u(cells.opacity_values, frame_.opacity_low, frame_.opacity_inverse, setup.opacities);
  for (std::size_t i = 0; i < u.size(); ++i)
    if (std::isnan(setup.opacities[i])) u[i] = setup.opacities[i];
}

// Only points of cells that are seen: often they are few.
void CellSweep::place_points(const Chunk& chunk, const DrawnCells& cells, CellSetup& setup,
                             CellsOnScreen& screen) const {
  const std::size_t count = cells.points.size();
  const bool orthographic = view_.orthographic;
  const double middle = 0.5 * (std::max(chunk.box.low.z, 0.0) + chunk.box.high.z);
  const double w = static_cast<float>(orthographic ? middle : 1 / middle);
  screen.w = static_cast<float>(w);
  screen.key_offset = static_cast<float>(orthographic ? frame_.farthest_w - w : w - frame_.farthest_w);
  screen.eye_d = static_cast<float>(orthographic ? w : 1 / frame_.nearest - w);
  screen.farthest_d = orthographic ? -farthest : -screen.w;
  setup.is_used.assign(count, 0);
  for (const std::int32_t cell : setup.seen)
    for (const std::uint32_t point : cells.tetrahedra[static_cast<std::size_t>(cell)]) setup.is_used[point] = 1;
  PointsOnScreen& points = setup.points;
  setup.in_view.resize(count);
  for (auto* numbers : {&points.x, &points.y, &points.d, &points.w}) numbers->resize(count);
  points.is_far_out.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    if (setup.is_used[i] == 0) continue;
    const dvec3 p = setup.in_view[i] = view_.to_view(cells.points[i]);
    const double inverse = 1 / p.z, scale = orthographic ? view_.focal : view_.focal * inverse;
    points.x[i] = static_cast<float>(p.x * scale);
    points.y[i] = static_cast<float>(p.y * scale);
    points.d[i] = static_cast<float>(orthographic ? w - p.z : inverse - w);
    points.w[i] = static_cast<float>(orthographic ? 1 : inverse);
    const bool is_near = std::abs(points.x[i]) <= frame_.widest && std::abs(points.y[i]) <= frame_.widest;
    points.is_far_out[i] = is_near && p.z > frame_.nearest ? 0 : 1;
  }
}

// In double precision, as everything cancels where the eye is far away.
void CellSweep::shade(const DrawnCells& cells, const CellSetup& setup, CellsOnScreen& screen) const {
  const double focal = view_.focal;
  screen.shadings.resize(screen.cells.size());
  for (std::size_t i = 0; i < screen.cells.size(); ++i) {
    const auto number = static_cast<std::size_t>(setup.numbers[i]);
    const std::array<std::uint32_t, 4>& corners = cells.tetrahedra[number];
    std::array<dvec3, 4> p;
    for (std::size_t k = 0; k < 4; ++k) p[k] = setup.in_view[corners[k]];
    const dvec3 q = p[1] - p[0], r = p[2] - p[0], s = p[3] - p[0];
    const std::array<dvec3, 3> normals = {glm::cross(r, s), glm::cross(s, q), glm::cross(q, r)};
    const auto at = [&](const auto& all, std::size_t k) { return double{all[cells.constant ? number : corners[k]]}; };
    const auto sum = [&](const auto& all) {
      dvec3 result(0);
      for (std::size_t k = 0; k < 3; ++k) result += (at(all, k + 1) - at(all, 0)) * normals[k];
      return result;
    };

    // The reference is a corner in the picture, or else the middle of the picture.
    CellShading& shading = screen.shadings[i];
    shading = {};
    const dvec3& farthest_corner = *std::ranges::max_element(p, {}, [](const dvec3& corner) { return corner.z; });
    const double scale = view_.orthographic ? focal : focal / farthest_corner.z;
    const dvec2 place = dvec2(farthest_corner) * scale;
    const bool is_inside = std::abs(place.x) <= frame_.widest && std::abs(place.y) <= frame_.widest;
    const double w = screen.w;
    dvec3 reference(0);  // in view coordinates, on the line of sight if it is no corner
    if (is_inside) {
      shading.x = static_cast<float>(place.x), shading.y = static_cast<float>(place.y);
      reference = farthest_corner;
      shading.d = static_cast<float>(view_.orthographic ? w - reference.z : 1 / reference.z - w);
    }
    if (frame_.lighting && !cells.constant) {
      const dvec3 gradient = sum(cells.values);
      const double length = glm::length(gradient);
      if (length > 0) {
        const dvec3 g = gradient / length;
        shading.has_gradient = true;
        if (view_.orthographic) {
          shading.l0 = static_cast<float>(g.z);
        } else {
          const double depth = is_inside ? reference.z : 1;
          shading.lx = static_cast<float>(g.x / focal), shading.ly = static_cast<float>(g.y / focal);
          shading.l0 = static_cast<float>(is_inside ? glm::dot(g, reference) / depth : g.z);
        }
      }
    }
    if (!frame_.opacity) continue;
    const double volume = glm::dot(q, normals[0]);
    const dvec3 slope = volume == 0 ? dvec3(0) : sum(setup.opacities) / volume;
    const double o0 = at(setup.opacities, 0);
    const auto value = [&](const dvec3& place_in_view) { return o0 + glm::dot(slope, place_in_view - p[0]); };
    std::array<double, 4> all{};
    for (std::size_t k = 0; k < 4; ++k) all[k] = at(setup.opacities, k);
    shading.low = static_cast<float>(std::ranges::min(all)), shading.high = static_cast<float>(std::ranges::max(all));
    shading.o = nearest_float(value(reference));
    shading.ox = nearest_float(slope.x / focal), shading.oy = nearest_float(slope.y / focal);
    if (view_.orthographic) {
      shading.od = nearest_float(-slope.z);
      if (!is_inside) shading.oc = nearest_float(slope.z * w);
    } else if (is_inside) {
      shading.od = nearest_float(-glm::dot(slope, reference));
    } else {
      shading.oc = nearest_float(slope.z);
    }
  }
}

// Between which depths a pixel's ray shows something.
std::array<double, 2> CellSweep::visible_depths(int x, int y) const {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  double from = 0, to = infinity;
  if (frame_.surfaces) {
    const double depth =
        frame_.surfaces->depths[static_cast<std::size_t>(view_.height - 1 - y) * static_cast<std::size_t>(view_.width) +
                                static_cast<std::size_t>(x)];
    if (!std::isnan(depth)) to = depth;
  }
  const dvec3 aside =
      (x - frame_.middle_x) / view_.focal * view_.right + (y - frame_.middle_y) / view_.focal * view_.up;
  const dvec3 origin = view_.orthographic ? view_.eye + aside : view_.eye;
  const dvec3 along = view_.orthographic ? view_.forward : view_.forward + aside;
  for (const Plane& plane : view_.clip.planes) {
    const double distance = plane.distance(origin), rise = glm::dot(plane.normal, along);
    if (rise > 0)
      from = std::max(from, -distance / rise);
    else if (rise < 0)
      to = std::min(to, -distance / rise);
    else if (distance < 0)
      to = 0;
  }
  for (int axis = 0; axis < 3 && view_.clip.box; ++axis) {
    const double low = view_.clip.box->low[axis] - origin[axis], high = view_.clip.box->high[axis] - origin[axis];
    if (along[axis] == 0) {
      if (low > 0 || high < 0) to = 0;
      continue;
    }
    const auto [first, last] = std::minmax({low / along[axis], high / along[axis]});
    from = std::max(from, first);
    to = std::min(to, last);
  }
  return {from, to};
}

void CellSweep::set_limits(const CellsOnScreen& screen, const TileDepths& depths, TileSegments& segments) const {
  const auto d_of = [&](double depth) {
    if (depth <= 0) return farthest;
    if (depth == std::numeric_limits<double>::infinity()) return -farthest;
    return static_cast<float>(view_.orthographic ? screen.w - depth : 1 / depth - screen.w);
  };
  for (std::size_t pixel = 0; pixel < cell_tile_pixels; ++pixel) {
    segments.near_limits[pixel] = d_of(depths[pixel][0]);
    segments.far_limits[pixel] = d_of(depths[pixel][1]);
  }
}

// Sorts by the upper halves: by 11 bits of them, three times.
void sort_keys(std::vector<std::uint64_t>& keys, std::vector<std::uint64_t>& scratch) {
  scratch.resize(keys.size());
  for (int shift = 32; shift < 64; shift += 11) {
    const auto digit = [&](std::uint64_t key) { return key >> shift & 2047; };
    std::array<std::uint32_t, 2049> begins{};
    for (const std::uint64_t key : keys) ++begins[digit(key) + 1];
    std::partial_sum(begins.begin(), begins.end(), begins.begin());
    for (const std::uint64_t key : keys) scratch[begins[digit(key)]++] = key;
    std::swap(keys, scratch);
  }
}

void CellSweep::sort_into_tiles(CellSetup& setup, CellsOnScreen& screen) {
  sort_keys(setup.keys, setup.sorted);
  const auto tiles_of = [](const CellOnScreen& cell) {
    return PixelRectangle{cell.left / cell_tile_side, cell.right / cell_tile_side, cell.bottom / cell_tile_side,
                          cell.top / cell_tile_side};
  };
  PixelRectangle all{std::numeric_limits<int>::max(), -1, std::numeric_limits<int>::max(), -1};
  for (const CellOnScreen& cell : screen.cells) {
    const PixelRectangle own = tiles_of(cell);
    all = {std::min(all.x0, own.x0), std::max(all.x1, own.x1), std::min(all.y0, own.y0), std::max(all.y1, own.y1)};
  }
  screen.tiles_across = screen.tiles_up = 0;
  if (all.is_empty()) return;
  screen.tiles_left = all.x0, screen.tiles_bottom = all.y0;
  screen.tiles_across = all.x1 - all.x0 + 1, screen.tiles_up = all.y1 - all.y0 + 1;
  const auto visit = [&](const CellOnScreen& cell, const auto& use) {
    const PixelRectangle own = tiles_of(cell);
    for (int row = own.y0; row <= own.y1; ++row)
      for (int column = own.x0; column <= own.x1; ++column)
        use(static_cast<std::size_t>((row - all.y0) * screen.tiles_across + column - all.x0));
  };
  screen.begins.assign(static_cast<std::size_t>(screen.tiles_across) * static_cast<std::size_t>(screen.tiles_up) + 1,
                       0);
  for (const CellOnScreen& cell : screen.cells) visit(cell, [&](std::size_t tile) { ++screen.begins[tile + 1]; });
  std::partial_sum(screen.begins.begin(), screen.begins.end(), screen.begins.begin());
  screen.numbers.resize(screen.begins.back());
  setup.next.assign(screen.begins.begin(), screen.begins.end() - 1);
  for (const std::uint64_t key : setup.keys) {
    const auto number = static_cast<std::uint32_t>(key);
    visit(screen.cells[number], [&](std::size_t tile) { screen.numbers[setup.next[tile]++] = number; });
  }
}

// Returns false if there are too many segments.
bool CellSweep::draw_tile(int column, int row, std::uint32_t first, std::span<const CellsOnScreen> screens,
                          Tile& tile) {
  constexpr std::uint64_t blended_at_once = std::uint64_t{32} * cell_tile_pixels;
  const auto end = static_cast<std::uint32_t>(first + screens.size());
  const auto is_in_batch = [&] { return tile.next < tile.chunks.size() && tile.chunks[tile.next].chunk < end; };
  if (!is_in_batch()) return true;
  if (!tile.is_open) {
    while (is_in_batch()) ++tile.next;
    return true;
  }
  TileSegments& segments = workspace_.segments.local();
  const bool has_shades = frame_.has_shades();
  if (has_shades) segments.shades.resize(segments.segments.size());
  segments.counts.fill(0);
  if (!tile.counts.empty()) {
    while (segments.room < std::ranges::max(tile.counts)) static_cast<void>(segments.make_room());
    std::size_t from = 0;
    for (std::size_t pixel = 0; pixel < cell_tile_pixels; from += static_cast<std::size_t>(tile.counts[pixel++])) {
      const auto copy = [&](const auto& waiting, auto& all) {
        std::copy_n(waiting.begin() + static_cast<std::ptrdiff_t>(from), tile.counts[pixel],
                    all.begin() + static_cast<std::ptrdiff_t>(segments.begin_of(pixel)));
      };
      copy(tile.waiting, segments.segments);
      if (has_shades) copy(tile.shades, segments.shades);
    }
    std::ranges::copy(tile.counts, segments.counts.begin());
  }
  const CellTileArea area = {column * cell_tile_side, row * cell_tile_side};
  TileDepths depths;
  if (frame_.has_limits())
    for (int pixel = 0; pixel < cell_tile_pixels; ++pixel) {
      const int x = area.left + pixel % cell_tile_side, y = area.bottom + pixel / cell_tile_side;
      depths[static_cast<std::size_t>(pixel)] =
          x < view_.width && y < view_.height ? visible_depths(x, y) : std::array{0.0, 0.0};
    }
  std::uint64_t unblended = 0;
  float later_key = -farthest;
  for (; is_in_batch(); ++tile.next) {
    const InTile& chunk = tile.chunks[tile.next];
    const CellsOnScreen& screen = screens[chunk.chunk - first];
    const std::uint64_t had = segments.added;
    if (frame_.has_limits()) set_limits(screen, depths, segments);
    add_segments(frame_, screen, screen.in_tile(column, row), area, nearest_d(screen, chunk.first_key), segments);
    if (segments.is_full) return false;
    unblended += segments.added - had;
    drawn_segments_ += segments.added - had;
    later_key = chunk.later_key;
    if (unblended < blended_at_once) continue;
    tile.is_open = blend_segments(frame_, area, later_key, segments, tile.light);
    unblended = 0;
    if (!tile.is_open) break;
  }
  if (tile.is_open) tile.is_open = blend_segments(frame_, area, later_key, segments, tile.light);
  while (is_in_batch()) ++tile.next;
  tile.waiting.clear();
  tile.shades.clear();
  tile.counts.clear();
  if (!tile.is_open || std::ranges::max(segments.counts) == 0) {
    tile.waiting = {};
    tile.shades = {};
    return true;
  }
  tile.counts.assign(segments.counts.begin(), segments.counts.end());
  for (std::size_t pixel = 0; pixel < cell_tile_pixels; ++pixel) {
    const auto keep = [&](const auto& all, auto& waiting) {
      const auto from = all.begin() + static_cast<std::ptrdiff_t>(segments.begin_of(pixel));
      waiting.insert(waiting.end(), from, from + segments.counts[pixel]);
    };
    keep(segments.segments, tile.waiting);
    if (has_shades) keep(segments.shades, tile.shades);
  }
  return true;
}

void CellSweep::finish_tile(int column, int row, const Tile& tile) {
  for (std::size_t pixel = 0; pixel < cell_tile_pixels; ++pixel) {
    const int x = column * cell_tile_side + static_cast<int>(pixel) % cell_tile_side;
    const int y = row * cell_tile_side + static_cast<int>(pixel) / cell_tile_side;
    if (x >= view_.width || y >= view_.height) continue;
    const auto& color = tile.light.color;
    picture_.image.at(x, view_.height - 1 - y) =
        vec4(color[0][pixel], color[1][pixel], color[2][pixel], 1 - tile.light.transmittance[pixel]);
  }
}

}  // namespace

CellRasterizer::CellRasterizer() : workspace_(std::make_unique<CellWorkspace>()) {}
CellRasterizer::~CellRasterizer() = default;

Result<CellPicture> CellRasterizer::draw(const CellSource& source, const CellDrawing& drawing) {
  // Wider samples would blur the outlines of surfaces.
  const int spacing = drawing.surfaces ? 1 : drawing.sample_spacing;
  const View view = spacing > 1 ? sampled_view(drawing.view, spacing) : drawing.view;
  SPLATVOL_TRY_ASSIGN(picture, CellSweep(source, drawing, view, *workspace_).draw());
  if (spacing <= 1) return picture;
  Image rows, whole{drawing.view.width, drawing.view.height, {}};
  whole.pixels.resize(static_cast<std::size_t>(whole.width) * static_cast<std::size_t>(whole.height));
  interpolate(picture.image, spacing, rows, whole);
  picture.image = std::move(whole);
  return picture;
}

namespace tiles {

bool TileSegments::make_room() {
  const int more_room = 2 * room + 4;
  is_full = is_full || more_room > most_room;
  if (is_full) return false;
  const auto spread = [&](auto& all) {
    if (all.empty()) return;
    std::remove_reference_t<decltype(all)> more(static_cast<std::size_t>(more_room) * cell_tile_pixels);
    for (std::size_t pixel = 0; pixel < cell_tile_pixels; ++pixel)
      std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(begin_of(pixel)), std::min(counts[pixel], room),
                  more.begin() + static_cast<std::ptrdiff_t>(pixel * static_cast<std::size_t>(more_room)));
    all = std::move(more);
  };
  spread(segments);
  spread(shades);
  room = more_room;
  return true;
}

namespace {

// A plane through three corners of which one may be behind the eye: in double precision, by their places in space.
struct PlaneInSpace {
  CellOnScreen::Face face;
  CellOnScreen::Reference reference;
  bool is_positive;  // as the area on the screen would be
};

PlaneInSpace plane_in_space(const CellFrame& frame, const std::array<dvec3, 3>& p, const std::array<double, 3>& u,
                            double w) {
  const View& view = *frame.view;
  const dvec3 q = p[1] - p[0], r = p[2] - p[0], normal = glm::cross(q, r);
  const double square = std::max(glm::dot(normal, normal), std::numeric_limits<double>::min());
  const dvec3 gradient = ((u[1] - u[0]) * glm::cross(r, normal) + (u[2] - u[0]) * glm::cross(normal, q)) / square;
  const auto not_zero = [](double x) { return x == 0 ? 1e-300 : x; };
  // A plane that is seen edge-on is as steep as numbers allow.
  const auto number = [](double x) { return static_cast<float>(std::clamp(x, -1e18, 1e18)); };
  const double focal = view.focal;
  if (view.orthographic) {
    const double across = not_zero(normal.z), offset = glm::dot(normal, p[0]);
    const double a = normal.x / across / focal, b = normal.y / across / focal, z = offset / across;
    return {{number(a), number(b), number(gradient.x / focal - gradient.z * a),
             number(gradient.y / focal - gradient.z * b)},
            {0, 0, number(w - z), number(u[0] + glm::dot(gradient, dvec3(0, 0, z) - p[0]))},
            across > 0};
  }
  const double offset = not_zero(glm::dot(normal, p[0])), along = glm::dot(gradient, p[0]);
  const double a = normal.x / offset / focal, b = normal.y / offset / focal, c = normal.z / offset;
  // 1/z at the reference must not be 0: of a few pixels, the one where it is largest.
  const double x_end = frame.middle_x, y_end = frame.middle_y;
  dvec2 at(0);
  for (const dvec2 other : {dvec2(x_end, y_end), dvec2(-x_end, y_end), dvec2(x_end, -y_end), dvec2(-x_end, -y_end)})
    if (std::abs(a * other.x + b * other.y + c) > std::abs(a * at.x + b * at.y + c)) at = other;
  const double inverse_z = not_zero(a * at.x + b * at.y + c);
  const double in_u = (glm::dot(gradient, dvec3(at / focal, 1)) - along * inverse_z) / inverse_z;
  return {{number(a), number(b), number(gradient.x / focal - (along + in_u) * a),
           number(gradient.y / focal - (along + in_u) * b)},
          {static_cast<float>(at.x), static_cast<float>(at.y), number(inverse_z - w), number(u[0] + in_u)},
          offset > 0};
}

// The values on the eye's plane: in perspective those at the eye.
void set_eye_plane(const CellFrame& frame, const std::array<dvec3, 4>& p, const std::array<float, 4>& u,
                   FarOut& far_out) {
  const dvec3 q = p[1] - p[0], r = p[2] - p[0], s = p[3] - p[0];
  const dvec3 sum = double{u[1] - u[0]} * glm::cross(r, s) + double{u[2] - u[0]} * glm::cross(s, q) +
                    double{u[3] - u[0]} * glm::cross(q, r);
  const double volume = glm::dot(q, glm::cross(r, s));
  const dvec3 gradient = volume == 0 ? dvec3(0) : sum / volume;
  far_out.eye_u = nearest_float(u[0] - glm::dot(gradient, p[0]));
  if (!frame.view->orthographic) return;
  far_out.eye_e = nearest_float(gradient.x / frame.view->focal);
  far_out.eye_f = nearest_float(gradient.y / frame.view->focal);
}

// The pixels that a cell may cover; false: none.
bool bound_pixels(const CellFrame& frame, const std::array<dvec3, 4>& corners, CellOnScreen& cell) {
  const View& view = *frame.view;
  dvec2 low(1e9), high(-1e9);
  const auto reach = [&](const dvec3& p) {
    const dvec2 at = dvec2(p) * (view.orthographic ? view.focal : view.focal / p.z);
    low = glm::min(low, at), high = glm::max(high, at);
  };
  const double nearest = frame.nearest;
  for (const dvec3& p : corners) {
    if (view.orthographic || p.z > nearest) reach(p);
    if (view.orthographic || p.z <= nearest) continue;
    for (const dvec3& q : corners)
      if (q.z <= nearest) reach(glm::mix(q, p, (nearest - q.z) / (p.z - q.z)));
  }
  const auto pixel = [](double x, double first, double last) {
    return static_cast<std::int32_t>(std::clamp(x, first, last));
  };
  cell.left = pixel(std::ceil(low.x + frame.middle_x - frame.slack), 0, view.width);
  cell.right = pixel(std::floor(high.x + frame.middle_x + frame.slack), -1, view.width - 1);
  cell.bottom = pixel(std::ceil(low.y + frame.middle_y - frame.slack), 0, view.height);
  cell.top = pixel(std::floor(high.y + frame.middle_y + frame.slack), -1, view.height - 1);
  return cell.left <= cell.right && cell.bottom <= cell.top;
}

}  // namespace

bool set_up_far_out(const CellFrame& frame, const std::array<std::uint32_t, 4>& corners, const CellSetup& setup,
                    const FacesOfCell& faces, const std::array<float, 4>& u, CellOnScreen& cell,
                    CellsOnScreen& screen) {
  const PointsOnScreen& points = setup.points;
  std::array<dvec3, 4> p;
  for (std::size_t k = 0; k < 4; ++k) p[k] = setup.in_view[corners[k]];
  if (!bound_pixels(frame, p, cell)) return false;
  FarOut far_out{};
  std::size_t fronts = 0, backs = 4;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto [a, b, c, opposite] = face_corners[k];
    PlaneInSpace plane{faces.planes[k],
                       {points.x[corners[a]], points.y[corners[a]], points.d[corners[a]], u[a]},
                       !faces.is_negative[k]};
    if ((points.is_far_out[corners[a]] | points.is_far_out[corners[b]] | points.is_far_out[corners[c]]) != 0)
      plane = plane_in_space(frame, {p[a], p[b], p[c]}, {u[a], u[b], u[c]}, screen.w);
    const double side = glm::dot(glm::cross(p[b] - p[a], p[c] - p[a]), p[opposite] - p[a]);
    const std::size_t at = plane.is_positive == (side > 0) ? fronts++ : --backs;
    cell.faces[at] = plane.face;
    far_out.references[at] = plane.reference;
  }
  cell.fronts = static_cast<std::uint8_t>(fronts);
  cell.far_out = static_cast<std::int32_t>(screen.far_out.size());
  set_eye_plane(frame, p, u, far_out);
  screen.far_out.push_back(far_out);
  return true;
}

}  // namespace tiles
}  // namespace splatvol
