// Sets up cells on the screen: a cell in each lane.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "renderer/cpu/cell_frame.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/cpu/cell_setup.cpp"
#include "renderer/cpu/targets.h"
// The order matters: this includes the file again, once for each instruction set.
#include <hwy/foreach_target.h>

#include "renderer/cpu/segment-inl.h"
#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

/// A corner of a cell in each lane.
struct Corner {
  Float x, y, d, w, u;
};

struct Plane {
  Float a, b, e, f;
  Float d;     // of a moved ray through the first corner
  Float area;  // twice that on the screen, with a sign
  Float size;  // the largest number that `area` is a difference of
  Mask is_steep;
};

/// Sets the plane through three corners, in the order of their ranks. A face is steep if it is narrower on the screen
/// than a few roundings of its corners' places, or so nearly edge-on that rounding changes its slope by 1 %: cells that
/// have one are precise. Both cells of a face find the same.
HWY_INLINE void set_plane(const Corner& p, const Corner& q, const Corner& r, float slack, Plane& plane) {
  const Float qx = q.x - p.x, qy = q.y - p.y, rx = r.x - p.x, ry = r.y - p.y;
  const Float product = qy * rx, area = fma(qx, ry, -product), size = abs(qx * ry) + abs(product);
  const Float length = max(max(abs(qx), abs(qy)), max(abs(rx), abs(ry)));
  const Float inverse = Float(1.0F) / area;
  const auto across = [&](Float along_q, Float along_r, Float& x, Float& y) HWY_ATTR {
    x = fma(along_q, ry, -(along_r * qy)) * inverse, y = fma(along_r, qx, -(along_q * rx)) * inverse;
  };
  across(q.d - p.d, r.d - p.d, plane.a, plane.b);
  across((q.u - p.u) * q.w, (r.u - p.u) * r.w, plane.e, plane.f);
  plane.d = fma(plane.a, ray_shift_x, fma(plane.b, ray_shift_y, p.d));
  plane.area = area, plane.size = size;
  plane.is_steep = hn::Not(abs(area) > max(length * slack, size * 2e-5F));
}

/// Values of tetrahedra, one in each lane.
struct ValueRanges {
  Float low, high;
};

/// Returns those from number `first` on. A lane behind the last tetrahedron has values of another one.
HWY_INLINE ValueRanges value_ranges(const Tetrahedra& cells, const float* u, std::size_t first) {
  const std::size_t count = cells.size();
  const auto lanes = static_cast<std::size_t>(lane_count());
  if (cells.constant) {
    alignas(64) std::array<float, most_lanes> own;
    for (std::size_t i = 0; i < lanes; ++i) own[i] = u[std::min(first + i, count - 1)];
    const Float value = load(own.data());
    return {value, value};
  }
  alignas(64) std::array<std::array<std::uint32_t, 4>, most_lanes> last;
  const std::array<std::uint32_t, 4>* corners = cells.corners.data() + first;
  if (first + lanes > count) {
    last.fill(cells.corners[first]);
    std::copy(corners, cells.corners.data() + count, last.begin());
    corners = last.data();
  }
  hn::Vec<IntTag> a, b, c, d;
  hn::LoadInterleaved4(IntTag(), reinterpret_cast<const std::int32_t*>(corners), a, b, c, d);
  const Float ua = gather(u, a), ub = gather(u, b), uc = gather(u, c), ud = gather(u, d);
  // A minimum may lose a NaN, a sum does not.
  const Float sum = (ua + ub) + (uc + ud);
  return {select(is_number(sum), min(min(ua, ub), min(uc, ud)), std::numeric_limits<float>::quiet_NaN()),
          max(max(ua, ub), max(uc, ud))};
}

/// Lists the tetrahedra with a visible value.
void list_seen(const CellFrame& frame, const Tetrahedra& cells, CellSetup& setup) {
  const FunctionPieces& function = *frame.function;
  const std::size_t count = cells.size();
  const auto lanes = static_cast<std::size_t>(lane_count());
  const IntTag tag;
  setup.seen.resize(count + lanes);
  const auto bin_of = [&](Float u) HWY_ATTR {
    return truncate(clamp(fma(u, static_cast<float>(FunctionPieces::bins), function.bin_of_origin), 0.0F,
                          static_cast<float>(FunctionPieces::bins + 1)));
  };
  std::size_t seen = 0;
  for (std::size_t first = 0; first < count; first += lanes) {
    const auto [low, high] = value_ranges(cells, setup.points.u.data(), first);
    const auto visible_before = [&](Int bin) HWY_ATTR {
      return Int(hn::GatherIndex(tag, function.visible_before.data(), bin.v));
    };
    const Int first_bin = bin_of(low), last_bin = bin_of(high);
    auto shows = hn::Gt(visible_before(last_bin + Int(1)).v, visible_before(first_bin).v);
    if (frame.events) {
      for (const float u : frame.events->u)
        shows = hn::Or(shows, hn::RebindMask(tag, both(low <= Float(u), high >= Float(u))));
      if (!setup.is_cut.empty()) shows = hn::Or(shows, hn::Gt(load(setup.is_cut.data() + first).v, hn::Zero(tag)));
    }
    shows = hn::And(shows, hn::RebindMask(tag, is_number(low)));
    const auto valid = hn::FirstN(tag, std::min(lanes, count - first));
    const Int numbers = lane_indices() + Int(static_cast<std::int32_t>(first));
    seen += hn::CompressStore(numbers.v, hn::And(shows, valid), tag, setup.seen.data() + seen);
  }
  setup.seen.resize(seen);
}

/// The pixels that cells may cover, from the picture's lower left corner.
struct PixelBounds {
  Float left, right, bottom, top;

  /// From the least and the largest places of corners.
  HWY_INLINE void set(const CellFrame& frame, Float least_x, Float most_x, Float least_y, Float most_y) {
    const auto middle_x = static_cast<float>(frame.middle_x), middle_y = static_cast<float>(frame.middle_y);
    const float rounding = 2 * frame.widest * std::numeric_limits<float>::epsilon();  // of places on the screen
    left = max(hn::Ceil((least_x + (middle_x - rounding)).v), 0.0F);
    right = min(hn::Floor((most_x + (middle_x + rounding)).v), static_cast<float>(frame.view->width - 1));
    bottom = max(hn::Ceil((least_y + (middle_y - rounding)).v), 0.0F);
    top = min(hn::Floor((most_y + (middle_y + rounding)).v), static_cast<float>(frame.view->height - 1));
  }
  [[nodiscard]] HWY_INLINE Mask has_some() const { return both(left <= right, bottom <= top); }
};

/// Tells which of some cells have a corner that is far out.
HWY_INLINE Mask are_far_out(const Tetrahedra& cells, const CellSetup& setup, const std::int32_t* numbers) {
  alignas(64) std::array<std::int32_t, most_lanes> far_out{};
  for (std::size_t i = 0; i < static_cast<std::size_t>(lane_count()) && setup.points.has_far_out; ++i)
    for (const std::uint32_t point : cells.corners[static_cast<std::size_t>(numbers[i])])
      far_out[i] |= setup.points.is_far_out[point];
  return hn::Not(is_zero(load(far_out.data())));
}

/// Numbers of points or cells that are four floats each, side by side.
using Fours = std::array<float, 4 * most_lanes>;

HWY_INLINE void load_fours(const Fours& fours, Float& a, Float& b, Float& c, Float& d) {
  hn::LoadInterleaved4(FloatTag(), fours.data(), a.v, b.v, c.v, d.v);
}

/// Tells which of the cells may cover a pixel that is drawn, in a picture of some blocks. `bits`: which of them to look
/// at.
HWY_INLINE std::uint32_t meet_blocks(const DifferingBlocks& blocks, const PixelBounds& bounds, std::uint32_t bits) {
  alignas(64) std::array<std::array<std::int32_t, most_lanes>, 4> sides;
  store(truncate(bounds.left), sides[0].data());
  store(truncate(bounds.right), sides[1].data());
  store(truncate(bounds.bottom), sides[2].data());
  store(truncate(bounds.top), sides[3].data());
  std::uint32_t meeting = 0;
  for (; bits != 0; bits &= bits - 1) {
    const auto lane = static_cast<std::size_t>(std::countr_zero(bits));
    const bool meets = blocks.meet({sides[0][lane], sides[1][lane], sides[2][lane], sides[3][lane]});
    meeting |= static_cast<std::uint32_t>(meets) << lane;
  }
  return meeting;
}

HWY_INLINE Mask mask_of_bits(std::uint32_t bits) {
  return hn::Not(is_zero(Int(static_cast<std::int32_t>(bits)) & Int(hn::Shl(Int(1).v, lane_indices().v))));
}

/// Drops the cells that lie between samples or outside of the picture. The others then fill whole vectors.
void drop_uncovering(const CellFrame& frame, const Tetrahedra& cells, CellSetup& setup) {
  const hn::FixedTag<float, 4> tag;
  const auto lanes = static_cast<std::size_t>(lane_count());
  const std::size_t count = setup.seen.size();
  setup.seen.resize(count + lanes, 0);
  const float* const places = &setup.points.places.data()->x;
  std::size_t kept = 0;
  for (std::size_t first = 0; first < count; first += lanes) {
    const std::int32_t* const numbers = setup.seen.data() + first;
    alignas(64) Fours least, most;
    for (std::size_t i = 0; i < lanes; ++i) {
      const auto& [p, q, r, s] = cells.corners[static_cast<std::size_t>(numbers[i])];
      const auto at = [&](std::size_t point) HWY_ATTR { return hn::LoadU(tag, places + 4 * point); };
      const auto on_p = at(p), on_q = at(q), on_r = at(r), on_s = at(s);
      hn::Store(hn::Min(hn::Min(on_p, on_q), hn::Min(on_r, on_s)), tag, &least[4 * i]);
      hn::Store(hn::Max(hn::Max(on_p, on_q), hn::Max(on_r, on_s)), tag, &most[4 * i]);
    }
    Float least_x, least_y, most_x, most_y, unused;
    load_fours(least, least_x, least_y, unused, unused);
    load_fours(most, most_x, most_y, unused, unused);
    PixelBounds bounds;
    bounds.set(frame, least_x, most_x, least_y, most_y);
    Mask in = bounds.has_some();
    if (frame.blocks) in = mask_of_bits(meet_blocks(*frame.blocks, bounds, mask_bits(in)));
    in = either(in, are_far_out(cells, setup, numbers));
    const Mask valid = hn::FirstN(FloatTag(), std::min(lanes, count - first));
    kept += hn::CompressStore(load(numbers).v, hn::RebindMask(IntTag(), both(in, valid)), IntTag(),
                              setup.seen.data() + kept);
  }
  setup.seen.resize(kept);
}

HWY_INLINE Float least(Float a, Float b, Float c, Float d) { return min(min(a, b), min(c, d)); }
HWY_INLINE Float most(Float a, Float b, Float c, Float d) { return max(max(a, b), max(c, d)); }

/// Cells that rays meet, a cell in each lane.
struct CellLanes {
  std::array<Corner, 4> corners;
  std::array<Plane, 4> planes;  // in the order of face_corners
  std::array<Mask, 4> fronts;   // whether they are in front
  Float low, high;              // least and largest u
  PixelBounds bounds;
};

/// The segments of cells that may cover few pixels, a cell in each lane: of one pixel of each after the other.
struct FoundInLanes {
  static constexpr int most = 8;
  alignas(64) std::array<std::array<float, 4 * most_lanes>, most> segments;
  alignas(64) std::array<std::array<std::int32_t, most_lanes>, most> columns, rows;
  std::array<std::uint32_t, most> hits;  // a bit for each lane
  int pixels = 0;                        // of the cell that has most

  /// Copies what a cell's rays meet, and returns how many they are. Writes up to `most` segments.
  HWY_INLINE std::size_t copy(std::size_t lane, FoundSegment* to) const {
    std::size_t count = 0;
    for (std::size_t i = 0; i < static_cast<std::size_t>(pixels); ++i) {
      FoundSegment& found = to[count];
      std::memcpy(&found.segment, &segments[i][4 * lane], sizeof(CellSegment));
      found.x = static_cast<std::int16_t>(columns[i][lane]), found.y = static_cast<std::int16_t>(rows[i][lane]);
      count += hits[i] >> lane & 1;  // no branch: whether a ray hits cannot be foreseen
    }
    return count;
  }
};

/// The rays of pixels that meet cells, one in each lane: rounded as where a cell's rays are in the lanes
/// (cell_tiles.cpp).
template <bool orthographic>
struct RayThroughCells {
  Float key;
  Float length, u_enter, u_leave;
  Mask hit;

  HWY_INLINE RayThroughCells(const CellsOnScreen& screen, const CellLanes& cells, Float x, Float y) {
    Crossing enter{Float(3e38F), Float(0.0F), Float(0.0F)}, leave{Float(-3e38F), Float(0.0F), Float(0.0F)};
    for (std::size_t k = 0; k < 4; ++k) {
      const Corner& reference = cells.corners[k == 3 ? 1 : 0];
      const Plane& plane = cells.planes[k];
      const Float dx = x - reference.x, dy = y - reference.y;
      const Crossing crossing{fma(plane.a, dx, dy * plane.b) + plane.d, fma(plane.e, dx, dy * plane.f), reference.u};
      const Mask front = cells.fronts[k];
      enter = select(both(front, crossing.d < enter.d), crossing, enter);
      leave = select(hn::Not(either(front, leave.d > crossing.d)), crossing, leave);
    }
    hit = enter.d > leave.d;
    const DepthOrigin& origin = screen.origin;
    Float rise(0.0F);
    if (origin.wx != 0 || origin.wy != 0)
      rise = fma(x - static_cast<float>(origin.at_x), static_cast<float>(origin.wx),
                 (y - static_cast<float>(origin.at_y)) * static_cast<float>(origin.wy));
    const Float w = rise + static_cast<float>(origin.w);
    const Float near_z = z_at<orthographic>(enter.d, w), far_z = z_at<orthographic>(leave.d, w);
    key = -(enter.d + (rise + screen.key_offset));
    length = depth_between(enter.d, near_z, leave.d, far_z);
    u_enter = clamp(fma(enter.n, near_z, enter.u), cells.low, cells.high);
    u_leave = clamp(fma(leave.n, far_z, leave.u), cells.low, cells.high);
  }
};

/// Finds the segments of some of the cells.
template <bool orthographic>
HWY_INLINE void find_segments(const CellFrame& frame, const CellsOnScreen& screen, const CellLanes& cells, Mask wanted,
                              FoundInLanes& found) {
  const auto middle_x = static_cast<float>(frame.middle_x), middle_y = static_cast<float>(frame.middle_y);
  const PixelBounds& bounds = cells.bounds;
  Float column = bounds.left, row = bounds.bottom;
  found.pixels = 0;
  for (Mask todo = wanted; any(todo); ++found.pixels) {
    const auto i = static_cast<std::size_t>(found.pixels);
    const RayThroughCells<orthographic> ray(screen, cells, column - middle_x, row - middle_y);
    hn::StoreInterleaved4(ray.key.v, ray.length.v, ray.u_enter.v, ray.u_leave.v, FloatTag(), found.segments[i].data());
    store(truncate(column), found.columns[i].data());
    store(truncate(row), found.rows[i].data());
    found.hits[i] = mask_bits(both(ray.hit, todo));
    const Mask is_last = column >= bounds.right;
    row = select(is_last, row + 1.0F, row);
    column = select(is_last, bounds.left, column + 1.0F);
    todo = both(todo, row <= bounds.top);
  }
}

/// Tells which cells may cover few pixels: so many that all of them are tried elsewhere, too.
HWY_INLINE Mask cover_few(const PixelBounds& bounds) {
  const Float pixels = (bounds.right - bounds.left + 1.0F) * (bounds.top - bounds.bottom + 1.0F);
  return pixels <= static_cast<float>(std::min(lane_count(), FoundInLanes::most));
}

/// Sets up the cells of a chunk, as many at once as there are lanes.
class CellsSetUp {
 public:
  CellsSetUp(const CellFrame& frame, const Tetrahedra& cells, CellSetup& setup, CellsOnScreen& screen)
      : frame_(frame),
        cells_(cells),
        setup_(setup),
        screen_(screen),
        finds_segments_(!frame.has_shades() && !frame.has_limits() && !frame.events &&
                        std::max(frame.view->width, frame.view->height) <= std::numeric_limits<std::int16_t>::max()) {
    const std::size_t count = setup.seen.size();
    screen.cells.reserve(count);
    setup.keys.resize(count);
    setup.numbers.resize(count);
    setup.tiles.resize(count);
    setup.found_tiles.resize(finds_segments_ ? count : 0);
    screen.found_begins.resize(setup.found_tiles.size() + 1);
  }

  // `first`: in setup.seen, which has a whole vector there.
  void add(std::size_t first, std::size_t count) {
    const std::int32_t* const numbers = setup_.seen.data() + first;
    set_corners(numbers);
    const auto& [p, q, r, s] = lanes_.corners;
    lanes_.bounds.set(frame_, least(p.x, q.x, r.x, s.x), most(p.x, q.x, r.x, s.x), least(p.y, q.y, r.y, s.y),
                      most(p.y, q.y, r.y, s.y));
    const Mask is_precise = set_planes(are_far_out(cells_, setup_, numbers));
    put_numbers();
    const Mask valid = hn::FirstN(FloatTag(), count);
    Mask is_found = hn::FirstN(FloatTag(), 0);
    if (finds_segments_) is_found = hn::AndNot(is_precise, both(valid, cover_few(lanes_.bounds)));
    const std::uint32_t found_bits = mask_bits(is_found), precise_bits = mask_bits(is_precise);
    if (found_bits != 0) find(is_found);
    for (std::size_t lane = 0; lane < count; ++lane) {
      const std::int32_t cell = setup_.seen[first + lane];
      if ((found_bits >> lane & 1) != 0)
        keep_found(lane);
      else
        keep_cell(lane, cell, (precise_bits >> lane & 1) != 0);
    }
  }

  void finish() {
    screen_.cells.resize(made_);
    setup_.keys.resize(keys_);
    setup_.tiles.resize(made_);
    setup_.found_tiles.resize(kept_);
    screen_.found_begins.resize(kept_ + 1);
  }

 private:
  HWY_INLINE void set_corners(const std::int32_t* numbers) {
    alignas(64) std::array<Fours, 4> places;
    alignas(64) std::array<std::array<std::int32_t, most_lanes>, 4> of_values;
    for (std::size_t i = 0; i < static_cast<std::size_t>(lane_count()); ++i) {
      const std::array<std::uint32_t, 4>& corners = cells_.corners[static_cast<std::size_t>(numbers[i])];
      for (std::size_t k = 0; k < 4; ++k) {
        std::memcpy(&places[k][4 * i], &setup_.points.places[corners[k]], sizeof(PointsOnScreen::Place));
        of_values[k][i] = cells_.constant ? numbers[i] : static_cast<std::int32_t>(corners[k]);
      }
    }
    for (std::size_t k = 0; k < 4; ++k) {
      Corner& corner = lanes_.corners[k];
      load_fours(places[k], corner.x, corner.y, corner.d, corner.w);
      corner.u = gather(setup_.points.u.data(), load(of_values[k].data()));
    }
  }

  // Sets the planes, and which are in front. Returns which cells are precise.
  HWY_INLINE Mask set_planes(Mask is_far_out) {
    const auto& [p, q, r, s] = lanes_.corners;
    std::array<Plane, 4>& planes = lanes_.planes;
    set_plane(p, q, r, frame_.slack, planes[0]);
    set_plane(p, q, s, frame_.slack, planes[1]);
    set_plane(p, r, s, frame_.slack, planes[2]);
    set_plane(q, r, s, frame_.slack, planes[3]);
    lanes_.low = least(p.u, q.u, r.u, s.u), lanes_.high = most(p.u, q.u, r.u, s.u);
    const Float qx = q.x - p.x, qy = q.y - p.y, qd = q.d - p.d, rx = r.x - p.x, ry = r.y - p.y, rd = r.d - p.d,
                sx = s.x - p.x, sy = s.y - p.y, sd = s.d - p.d;
    const Float volume =
        fma(qx, fma(ry, sd, -(rd * sy)), fma(qy, fma(rd, sx, -(rx * sd)), qd * fma(rx, sy, -(ry * sx))));
    const auto largest = [](Float a, Float b, Float c, Float d)
                             HWY_ATTR { return max(max(abs(a), abs(b)), max(abs(c), abs(d))); };
    // Each depth is rounded by 6e-8 of its size: 3 % of this thickness.
    const Float least_volume =
        largest(p.d, q.d, r.d, s.d) * largest(planes[0].size, planes[1].size, planes[2].size, planes[3].size) * 2e-6F;
    Mask is_precise = either(is_far_out, hn::Not(abs(volume) > least_volume));
    for (const Plane& plane : planes) is_precise = either(is_precise, plane.is_steep);

    // A face is in front if its plane is nearer than the corner opposite of it.
    const Mask is_negative = volume < Float(0.0F);
    for (std::size_t k = 0; k < 4; ++k) {
      const Mask differs = hn::Xor(is_negative, planes[k].area < Float(0.0F));
      lanes_.fronts[k] = k % 2 == 0 ? differs : hn::Not(differs);
      front_bits_[k] = mask_bits(lanes_.fronts[k]);
    }
    return is_precise;
  }

  HWY_INLINE void put_numbers() {
    const auto put = [&](std::size_t group, Float a, Float b, Float c, Float d)
                         HWY_ATTR { hn::StoreInterleaved4(a.v, b.v, c.v, d.v, FloatTag(), groups_[group].data()); };
    const auto& [p, q, r, s] = lanes_.corners;
    const auto& planes = lanes_.planes;
    put(0, p.x, p.y, p.u, 0.0F);
    put(1, q.x, q.y, q.u, 0.0F);
    put(2, r.x, r.y, s.x, s.y);
    for (std::size_t k = 0; k < 4; ++k) put(3 + k, planes[k].a, planes[k].b, planes[k].e, planes[k].f);
    put(7, planes[0].d, planes[1].d, planes[2].d, planes[3].d);
    put(8, lanes_.low, lanes_.high, (p.d + q.d) + (r.d + s.d), 0.0F);
    const PixelBounds& bounds = lanes_.bounds;
    hn::StoreInterleaved4(truncate(bounds.left).v, truncate(bounds.right).v, truncate(bounds.bottom).v,
                          truncate(bounds.top).v, IntTag(), bounds_.data());
  }

  HWY_INLINE void find(Mask wanted) {
    if (frame_.view->orthographic)
      find_segments<true>(frame_, screen_, lanes_, wanted, found_);
    else
      find_segments<false>(frame_, screen_, lanes_, wanted, found_);
  }

  void keep_found(std::size_t lane) {
    const std::size_t begin = screen_.found_begins[kept_];
    if (screen_.found.size() < begin + FoundInLanes::most)
      screen_.found.resize(2 * screen_.found.size() + std::size_t{1024});
    const std::size_t count = found_.copy(lane, screen_.found.data() + begin);
    screen_.found_begins[kept_ + 1] = static_cast<std::uint32_t>(begin + count);
    setup_.found_tiles[kept_] = tiles_of(&bounds_[4 * lane]);
    setup_.keys[keys_] = key_of(lane) | CellsOnScreen::found_bit | kept_;
    const std::size_t is_hit = count > 0 ? 1 : 0;
    kept_ += is_hit, keys_ += is_hit;
  }

  void keep_cell(std::size_t lane, std::int32_t number, bool is_precise) {
    CellOnScreen& cell = screen_.cells[made_];
    const auto take = [&](void* to, std::size_t group, std::size_t bytes = 16) {
      std::memcpy(to, &groups_[group][4 * lane], bytes);
    };
    take(&cell.corners[0], 0, sizeof(CellOnScreen::Reference));
    take(&cell.corners[1], 1, sizeof(CellOnScreen::Reference));
    take(&cell.others, 2);
    cell.shows_matter = true;
    cell.has_events = false;
    cell.precise = -1;
    cell.low = groups_[8][4 * lane];
    cell.high = groups_[8][4 * lane + 1];
    std::memcpy(&cell.left, &bounds_[4 * lane], 16);
    if (is_precise) {
      if (!make_precise(static_cast<std::size_t>(number), cell)) return;
    } else {
      order_faces(lane, cell);
    }
    setup_.tiles[made_] = tiles_of(&cell.left);
    setup_.numbers[made_] = number;
    setup_.keys[keys_++] = key_of(lane) | made_++;
  }

  [[nodiscard]] bool make_precise(std::size_t number, CellOnScreen& cell) const {
    const std::array<std::uint32_t, 4>& corners = cells_.corners[number];
    std::array<float, 4> u, opacities{};
    for (std::size_t k = 0; k < 4; ++k) {
      const std::size_t at = cells_.constant ? number : corners[k];
      u[k] = setup_.points.u[at];
      if (frame_.opacity) opacities[k] = setup_.opacities[at];
    }
    return set_up_precise(frame_, corners, setup_, u, opacities, cell, screen_);
  }

  // Those in front first.
  void order_faces(std::size_t lane, CellOnScreen& cell) const {
    std::size_t fronts = 0, backs = 4;
    std::uint8_t second = 0;
    unsigned order = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::size_t at = (front_bits_[k] >> lane & 1) != 0 ? fronts++ : --backs;
      std::memcpy(&cell.faces[at], &groups_[3 + k][4 * lane], 16);
      cell.faces[at].d = groups_[7][4 * lane + k];
      order |= static_cast<unsigned>(k) << (2 * at);
      if (k == 3) second = static_cast<std::uint8_t>(1U << at);
    }
    cell.fronts = static_cast<std::uint8_t>(fronts);
    cell.second = second;
    cell.order = static_cast<std::uint8_t>(order);
  }

  // Nearer cells have larger d, and lower keys.
  [[nodiscard]] std::uint64_t key_of(std::size_t lane) const {
    const auto order = std::bit_cast<std::uint32_t>(groups_[8][4 * lane + 2]);
    const std::uint32_t key = (order >> 31) != 0 ? order : ~(order | 0x80000000U);
    return std::uint64_t{key} << 32;
  }

  // `bounds`: left, right, bottom, top.
  [[nodiscard]] static TileBounds tiles_of(const std::int32_t* bounds) {
    const auto tile_of = [](std::int32_t at) { return static_cast<std::uint16_t>(at / cell_tile_side); };
    return {tile_of(bounds[0]), tile_of(bounds[1]), tile_of(bounds[2]), tile_of(bounds[3])};
  }

  const CellFrame& frame_;
  const Tetrahedra& cells_;
  CellSetup& setup_;
  CellsOnScreen& screen_;
  bool finds_segments_;
  CellLanes lanes_;
  std::array<std::uint32_t, 4> front_bits_;  // of lanes_.fronts
  // Numbers of a cell side by side: [group of four][lane][number]; its bounds.
  alignas(64) std::array<std::array<float, 4 * most_lanes>, 9> groups_;
  alignas(64) std::array<std::int32_t, 4 * most_lanes> bounds_;
  FoundInLanes found_;
  std::size_t made_ = 0, kept_ = 0, keys_ = 0;  // cells; cells whose segments are found; both
};

void set_up_all(const CellFrame& frame, const Tetrahedra& cells, CellSetup& setup, CellsOnScreen& screen) {
  drop_uncovering(frame, cells, setup);
  const auto lanes = static_cast<std::size_t>(lane_count());
  const std::size_t count = setup.seen.size();
  CellsSetUp set_up(frame, cells, setup, screen);
  setup.seen.resize(count + lanes, 0);
  for (std::size_t first = 0; first < count; first += lanes) set_up.add(first, std::min(lanes, count - first));
  setup.seen.resize(count);
  set_up.finish();
}

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace splatvol::tiles {

HWY_EXPORT(list_seen);
HWY_EXPORT(set_up_all);

void list_seen_cells(const CellFrame& frame, const Tetrahedra& cells, CellSetup& setup) {
  HWY_DYNAMIC_DISPATCH(list_seen)(frame, cells, setup);
}

void set_up_cells(const CellFrame& frame, const Tetrahedra& cells, CellSetup& setup, CellsOnScreen& screen) {
  HWY_DYNAMIC_DISPATCH(set_up_all)(frame, cells, setup, screen);
}

}  // namespace splatvol::tiles

#endif
