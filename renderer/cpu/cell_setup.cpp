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

#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

/// A corner of a cell in each lane.
struct Corner {
  Float x, y, d, w, u;
};

HWY_INLINE Corner corner_at(const PointsOnScreen& points, Int number) {
  return {gather(points.x.data(), number), gather(points.y.data(), number), gather(points.d.data(), number),
          gather(points.w.data(), number), gather(points.u.data(), number)};
}

struct Plane {
  Float a, b, e, f;
  Float d;     // of a moved ray through the first corner
  Float area;  // twice that on the screen, with a sign
  Float size;  // the largest number that `area` is a difference of
  Mask is_steep;
};

/// Returns the plane through three corners, in the order of their ranks. A face is steep if it is narrower on the
/// screen than a few roundings of its corners' places, or so nearly edge-on that rounding changes its slope by 1 %:
/// cells that have one are precise. Both cells of a face find the same.
HWY_INLINE Plane plane_through(const Corner& p, const Corner& q, const Corner& r, float slack) {
  const Float qx = q.x - p.x, qy = q.y - p.y, rx = r.x - p.x, ry = r.y - p.y;
  const Float product = qy * rx, area = fma(qx, ry, -product), size = abs(qx * ry) + abs(product);
  const Float length = max(max(abs(qx), abs(qy)), max(abs(rx), abs(ry)));
  const Mask is_steep = hn::Not(abs(area) > max(length * slack, size * 2e-5F));
  const Float inverse = Float(1.0F) / area;
  const auto across = [&](Float along_q, Float along_r) HWY_ATTR {
    return std::array{fma(along_q, ry, -(along_r * qy)) * inverse, fma(along_r, qx, -(along_q * rx)) * inverse};
  };
  const auto [a, b] = across(q.d - p.d, r.d - p.d);
  const auto [e, f] = across((q.u - p.u) * q.w, (r.u - p.u) * r.w);
  return {a, b, e, f, fma(a, ray_shift_x, fma(b, ray_shift_y, p.d)), area, size, is_steep};
}

/// Lists the tetrahedra with a visible value.
void list_seen(const CellFrame& frame, const DrawnCells& cells, CellSetup& setup) {
  const FunctionPieces& function = *frame.function;
  const std::size_t count = cells.tetrahedra.size();
  const auto lanes = static_cast<std::size_t>(lane_count());
  const IntTag tag;
  setup.seen.resize(count + lanes);
  const auto bin_of = [&](Float u) HWY_ATTR {
    return truncate(clamp(fma(u, static_cast<float>(FunctionPieces::bins), function.bin_of_origin), 0.0F,
                          static_cast<float>(FunctionPieces::bins + 1)));
  };
  std::size_t seen = 0;
  for (std::size_t first = 0; first < count; first += lanes) {
    alignas(64) std::array<std::array<std::uint32_t, 4>, most_lanes> last;
    const std::array<std::uint32_t, 4>* corners = cells.tetrahedra.data() + first;
    if (first + lanes > count) {
      last.fill(cells.tetrahedra[first]);
      std::copy(corners, cells.tetrahedra.data() + count, last.begin());
      corners = last.data();
    }
    Float low, high;
    if (cells.constant) {
      alignas(64) std::array<float, most_lanes> own;
      for (std::size_t i = 0; i < lanes; ++i) own[i] = setup.points.u[std::min(first + i, count - 1)];
      low = high = load(own.data());
    } else {
      hn::Vec<IntTag> a, b, c, d;
      hn::LoadInterleaved4(tag, reinterpret_cast<const std::int32_t*>(corners), a, b, c, d);
      const float* u = setup.points.u.data();
      const Float ua = gather(u, a), ub = gather(u, b), uc = gather(u, c), ud = gather(u, d);
      low = min(min(ua, ub), min(uc, ud)), high = max(max(ua, ub), max(uc, ud));
      // A minimum may lose a NaN, a sum does not.
      const Float sum = (ua + ub) + (uc + ud);
      low = select(is_number(sum), low, std::numeric_limits<float>::quiet_NaN());
    }
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

void set_up_all(const CellFrame& frame, const DrawnCells& cells, CellSetup& setup, CellsOnScreen& screen) {
  const auto lanes = static_cast<std::size_t>(lane_count());
  const std::size_t count = setup.seen.size();
  const View& view = *frame.view;
  const auto middle_x = static_cast<float>(frame.middle_x), middle_y = static_cast<float>(frame.middle_y);
  const float* const u_of_cells = setup.points.u.data();
  screen.cells.reserve(count);
  setup.keys.resize(count);
  setup.numbers.resize(count);
  setup.tiles.resize(count);
  std::size_t made = 0;
  const float rounding = 2 * frame.widest * std::numeric_limits<float>::epsilon();  // of places on the screen
  for (std::size_t first = 0; first < count; first += lanes) {
    alignas(64) std::array<std::array<std::int32_t, most_lanes>, 4> numbers;
    const std::size_t end = std::min(lanes, count - first);
    for (std::size_t i = 0; i < lanes; ++i) {
      const auto& corners = cells.tetrahedra[static_cast<std::size_t>(setup.seen[first + std::min(i, end - 1)])];
      for (std::size_t k = 0; k < 4; ++k) numbers[k][i] = static_cast<std::int32_t>(corners[k]);
    }
    std::array<Corner, 4> corners;
    Int far_out(0);
    for (std::size_t k = 0; k < 4; ++k) {
      const Int number = load(numbers[k].data());
      corners[k] = corner_at(setup.points, cells.constant ? Int(0) : number);
      if (cells.constant) {
        corners[k].x = gather(setup.points.x.data(), number);
        corners[k].y = gather(setup.points.y.data(), number);
        corners[k].d = gather(setup.points.d.data(), number);
        corners[k].w = gather(setup.points.w.data(), number);
      }
      far_out = far_out + Int(hn::GatherIndex(IntTag(), setup.points.is_far_out.data(), number.v));
    }
    if (cells.constant) {
      alignas(64) std::array<float, most_lanes> own;
      for (std::size_t i = 0; i < lanes; ++i)
        own[i] = u_of_cells[static_cast<std::size_t>(setup.seen[first + std::min(i, end - 1)])];
      for (Corner& corner : corners) corner.u = load(own.data());
    }
    const auto& [p, q, r, s] = corners;
    const auto least = [&](auto member) HWY_ATTR { return min(min(p.*member, q.*member), min(r.*member, s.*member)); };
    const auto most = [&](auto member) HWY_ATTR { return max(max(p.*member, q.*member), max(r.*member, s.*member)); };
    const Float left = max(hn::Ceil((least(&Corner::x) + (middle_x - rounding)).v), 0.0F);
    const Float right =
        min(hn::Floor((most(&Corner::x) + (middle_x + rounding)).v), static_cast<float>(view.width - 1));
    const Float bottom = max(hn::Ceil((least(&Corner::y) + (middle_y - rounding)).v), 0.0F);
    const Float top = min(hn::Floor((most(&Corner::y) + (middle_y + rounding)).v), static_cast<float>(view.height - 1));
    const Mask is_far_out = hn::Not(is_zero(far_out));
    Mask in = either(both(left <= right, bottom <= top), is_far_out);
    in = both(in, hn::FirstN(FloatTag(), end));
    if (!any(in)) continue;

    const std::array<Plane, 4> planes = {plane_through(p, q, r, frame.slack), plane_through(p, q, s, frame.slack),
                                         plane_through(p, r, s, frame.slack), plane_through(q, r, s, frame.slack)};
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
    std::array<std::uint32_t, 4> front_bits;
    for (std::size_t k = 0; k < 4; ++k) {
      const Mask differs = hn::Xor(is_negative, planes[k].area < Float(0.0F));
      front_bits[k] = mask_bits(k % 2 == 0 ? differs : hn::Not(differs));
    }

    // Numbers of a cell side by side: [group of four][lane][number].
    alignas(64) std::array<std::array<float, 4 * most_lanes>, 9> groups;
    const auto put = [&](std::size_t group, Float a, Float b, Float c, Float d)
                         HWY_ATTR { hn::StoreInterleaved4(a.v, b.v, c.v, d.v, FloatTag(), groups[group].data()); };
    put(0, p.x, p.y, p.u, 0.0F);
    put(1, q.x, q.y, q.u, 0.0F);
    put(2, r.x, r.y, s.x, s.y);
    for (std::size_t k = 0; k < 4; ++k) put(3 + k, planes[k].a, planes[k].b, planes[k].e, planes[k].f);
    put(7, planes[0].d, planes[1].d, planes[2].d, planes[3].d);
    put(8, least(&Corner::u), most(&Corner::u), (p.d + q.d) + (r.d + s.d), 0.0F);
    alignas(64) std::array<std::int32_t, 4 * most_lanes> bounds;
    hn::StoreInterleaved4(truncate(left).v, truncate(right).v, truncate(bottom).v, truncate(top).v, IntTag(),
                          bounds.data());
    const std::uint32_t precise_bits = mask_bits(is_precise);
    for (std::uint32_t bits = mask_bits(in); bits != 0; bits &= bits - 1) {
      const auto lane = static_cast<std::size_t>(std::countr_zero(bits));
      CellOnScreen& cell = screen.cells[made];
      const auto take = [&](void* to, std::size_t group, std::size_t bytes = 16) {
        std::memcpy(to, &groups[group][4 * lane], bytes);
      };
      take(&cell.corners[0], 0, sizeof(CellOnScreen::Reference));
      take(&cell.corners[1], 1, sizeof(CellOnScreen::Reference));
      take(&cell.others, 2);
      cell.shows_matter = true;
      cell.has_events = false;
      cell.precise = -1;
      cell.low = groups[8][4 * lane];
      cell.high = groups[8][4 * lane + 1];
      std::memcpy(&cell.left, &bounds[4 * lane], 16);
      if ((precise_bits >> lane & 1) != 0) {
        const auto number = static_cast<std::size_t>(setup.seen[first + lane]);
        const std::array<std::uint32_t, 4>& of_cell = cells.tetrahedra[number];
        std::array<float, 4> u, opacities{};
        for (std::size_t k = 0; k < 4; ++k) {
          const std::size_t at = cells.constant ? number : of_cell[k];
          u[k] = u_of_cells[at];
          if (frame.opacity) opacities[k] = setup.opacities[at];
        }
        if (!set_up_precise(frame, of_cell, setup, u, opacities, cell, screen)) continue;
      } else {
        std::size_t fronts = 0, backs = 4;
        std::uint8_t second = 0;
        unsigned numbers_in_order = 0;
        for (std::size_t k = 0; k < 4; ++k) {
          const std::size_t at = (front_bits[k] >> lane & 1) != 0 ? fronts++ : --backs;
          take(&cell.faces[at], 3 + k);
          cell.faces[at].d = groups[7][4 * lane + k];
          numbers_in_order |= static_cast<unsigned>(k) << (2 * at);
          if (k == 3) second = static_cast<std::uint8_t>(1U << at);
        }
        cell.fronts = static_cast<std::uint8_t>(fronts);
        cell.second = second;
        cell.order = static_cast<std::uint8_t>(numbers_in_order);
      }
      // Nearer cells have larger d, and lower keys.
      const auto order = std::bit_cast<std::uint32_t>(groups[8][4 * lane + 2]);
      const std::uint32_t key = (order >> 31) != 0 ? order : ~(order | 0x80000000U);
      const auto tile_of = [](std::int32_t at) { return static_cast<std::uint16_t>(at / cell_tile_side); };
      setup.tiles[made] = {tile_of(cell.left), tile_of(cell.right), tile_of(cell.bottom), tile_of(cell.top)};
      setup.numbers[made] = setup.seen[first + lane];
      setup.keys[made] = std::uint64_t{key} << 32 | made;
      ++made;
    }
  }
  screen.cells.resize(made);
  setup.keys.resize(made);
  setup.tiles.resize(made);
}

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace splatvol::tiles {

HWY_EXPORT(list_seen);
HWY_EXPORT(set_up_all);

void list_seen_cells(const CellFrame& frame, const DrawnCells& cells, CellSetup& setup) {
  HWY_DYNAMIC_DISPATCH(list_seen)(frame, cells, setup);
}

void set_up_cells(const CellFrame& frame, const DrawnCells& cells, CellSetup& setup, CellsOnScreen& screen) {
  HWY_DYNAMIC_DISPATCH(set_up_all)(frame, cells, setup, screen);
}

}  // namespace splatvol::tiles

#endif
