// Segments of rays in cells, and their light: pixels in the lanes.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <utility>

#include "renderer/cpu/cell_frame.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/cpu/cell_tiles.cpp"
#include "renderer/cpu/targets.h"
// The order matters: this includes the file again, once for each instruction set.
#include <hwy/foreach_target.h>

#include "renderer/cpu/precise_cell-inl.h"
#include "renderer/cpu/segment-inl.h"
#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

constexpr float closed = 1e-5F;  // transmittance behind which nothing can be seen

/// Where a tile's pixels lie, from the picture's middle.
struct TileCorner {
  int left, bottom;
  PixelRectangle pixels;  // of the tile, that are drawn
  float x, y;
  const std::uint8_t* is_wanted;  // as CellTileArea's
};

/// [width - 1][i]: pixel i of a rectangle of this width in a tile, from its first pixel on.
constexpr auto rectangle_pixels = [] {
  std::array<std::array<std::int32_t, most_lanes>, cell_tile_side> pixels{};
  for (int width = 1; width <= cell_tile_side; ++width)
    for (int i = 0; i < most_lanes; ++i)
      pixels[static_cast<std::size_t>(width - 1)][static_cast<std::size_t>(i)] = i / width * cell_tile_side + i % width;
  return pixels;
}();

/// Lists the tile's pixels (16 row + column) that a cell's outline may enclose. Returns how many they are.
HWY_INLINE int list_covered(const CellOnScreen& cell, const TileCorner& tile, float slack,
                            std::int32_t* HWY_RESTRICT covered) {
  const PixelRectangle& drawn = tile.pixels;
  const int left = std::max(cell.left - tile.left, drawn.x0), right = std::min(cell.right - tile.left, drawn.x1);
  const int bottom = std::max(cell.bottom - tile.bottom, drawn.y0), top = std::min(cell.top - tile.bottom, drawn.y1);
  if (left > right || bottom > top) return 0;
  const int lanes = lane_count();
  alignas(64) std::array<std::int32_t, cell_tile_side> from, to;
  const int width_of_all = right - left + 1, pixels = width_of_all * (top - bottom + 1);
  if (pixels <= lanes) {  // one vector has them all: rays tell
    const Int first = load(rectangle_pixels[static_cast<std::size_t>(width_of_all - 1)].data());
    store(first + Int(cell_tile_side * bottom + left), covered);
    return pixels;
  }
  if (slack > static_cast<float>(cell_tile_side)) {
    from.fill(left), to.fill(right);
  } else {
    const std::array<float, 4> xs = {cell.corners[0].x, cell.corners[1].x, cell.others[0], cell.others[2]};
    const std::array<float, 4> ys = {cell.corners[0].y, cell.corners[1].y, cell.others[1], cell.others[3]};
    for (int row = bottom / lanes * lanes; row <= top; row += lanes) {
      const Float y = lane_numbers() + (tile.y + static_cast<float>(row));
      Float least(1e9F), most(-1e9F);
      for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = i + 1; j < 4; ++j) {
          const std::size_t low = ys[i] <= ys[j] ? i : j, high = i + j - low;
          const float rise = ys[high] - ys[low], slope = rise > 1e-20F ? (xs[high] - xs[low]) / rise : 0;
          // Rounding may take a corner off its row.
          const Mask in = both(y >= Float(ys[low] - slack), y <= Float(ys[high] + slack));
          const Float x = fma(y - ys[low], slope, xs[low]);
          least = select(in, min(least, x), least);
          most = select(in, max(most, x), most);
        }
      const Float first = hn::Ceil((least - (tile.x + slack)).v), last = hn::Floor((most - (tile.x - slack)).v);
      store(truncate(max(first, static_cast<float>(left))), from.data() + row);
      store(truncate(min(last, static_cast<float>(right))), to.data() + row);
    }
  }
  int count = 0;
  for (int row = bottom; row <= top; ++row) {
    const auto r = static_cast<std::size_t>(row);
    const int width = to[r] - from[r] + 1;
    const Int first = lane_indices() + Int(cell_tile_side * row + from[r]);
    for (int done = 0; done < width; done += lanes) store(first + Int(done), covered + count + done);
    count += std::max(width, 0);
  }
  return count;
}

/// The same without pixels that are not wanted.
HWY_INLINE int list_wanted(const CellOnScreen& cell, const TileCorner& tile, float slack,
                           std::int32_t* HWY_RESTRICT covered) {
  const int count = list_covered(cell, tile, slack, covered);
  if (!tile.is_wanted) return count;
  int kept = 0;
  for (int i = 0; i < count; ++i) {
    covered[kept] = covered[i];
    kept += tile.is_wanted[covered[i]];
  }
  return kept;
}

/// The same on a face whose number matters: in CellOnScreen::faces.
struct CrossingOfFace : Crossing {
  Int face;
};

HWY_INLINE CrossingOfFace select(Mask mask, const CrossingOfFace& yes, const CrossingOfFace& no) {
  return {select(mask, static_cast<const Crossing&>(yes), static_cast<const Crossing&>(no)),
          select_int(mask, yes.face, no.face)};
}

/// What holds for a tile and a chunk.
struct CellTile {
  const CellFrame& frame;
  const CellsOnScreen& screen;
  TileCorner corner;
  float first_key;  // no segment gets a lower one
  float nearest_d;  // of what is in the chunk, and in front of the eye: where the origin has not risen
  float per_pixel;  // 1 / focal: slope of rays
  bool has_limits;
  bool is_flat;  // the origin is a plane
  float w, wx, wy, at_x, at_y;
};

/// Another attribute where a ray enters or leaves. `d`: from that of the reference.
HWY_INLINE Float field_at(const FieldOnScreen& field, Float dx, Float dy, Float d, Float z) {
  const Float along = fma(dx, field.x, fma(dy, field.y, fma(d, field.d, field.c)));
  return clamp(fma(along, z, field.at), field.low, field.high);
}

/// The factor on the colours of a lit cell.
template <bool orthographic>
HWY_INLINE Float light_at(const CellTile& t, const Lighting& lighting, const CellShading& shading, Float x, Float y) {
  const auto ambient = static_cast<float>(lighting.ambient), diffuse = static_cast<float>(lighting.diffuse);
  if (!shading.has_gradient) return ambient + diffuse;
  const Float along = abs(fma(x - shading.x, shading.lx, fma(y - shading.y, shading.ly, shading.l0)));
  if (orthographic) return fma(along, diffuse, ambient);
  const Float a = x * t.per_pixel, b = y * t.per_pixel;
  return fma(along / sqrt(fma(a, a, fma(b, b, 1.0F))), diffuse, ambient);
}

/// Segments of some pixels.
struct Segments {
  Float key, length, u_enter, u_leave;
  Float lighting, o_enter, o_leave;
};

/// Adds segments of different pixels.
template <bool has_shades>
HWY_INLINE void store_segments(const Segments& segments, Mask hit, Int pixel, TileSegments& tile) {
  alignas(64) std::array<CellSegment, most_lanes> made;
  alignas(64) std::array<SegmentShade, most_lanes> shades;
  hn::StoreInterleaved4(segments.key.v, segments.length.v, segments.u_enter.v, segments.u_leave.v, FloatTag(),
                        reinterpret_cast<float*>(made.data()));
  if constexpr (has_shades)
    hn::StoreInterleaved4(segments.lighting.v, segments.o_enter.v, segments.o_leave.v, segments.lighting.v, FloatTag(),
                          reinterpret_cast<float*>(shades.data()));
  // Lanes without a hit may have any number.
  pixel = pixel & Int(cell_tile_pixels - 1);
  const auto hits = hn::RebindMask(IntTag(), hit);
  const Int held(hn::GatherIndex(IntTag(), tile.counts.data(), pixel.v));
  if (!hn::AllFalse(IntTag(), hn::AndNot(hn::Lt(held.v, Int(tile.room).v), hits)) && !tile.make_room()) return;
  alignas(64) std::array<std::int32_t, most_lanes> pixels, places;
  store(pixel, pixels.data());
  store((pixel - Int(static_cast<std::int32_t>(tile.first_pixel))) * Int(tile.room) + held, places.data());
  CellSegment* const all = tile.segments.data();
  std::uint32_t bits = mask_bits(hit);
  tile.added += static_cast<std::uint64_t>(std::popcount(bits));
  for (; bits != 0; bits &= bits - 1) {
    const auto lane = static_cast<std::size_t>(std::countr_zero(bits));
    ++tile.counts[static_cast<std::size_t>(pixels[lane])];
    all[places[lane]] = made[lane];
    if constexpr (has_shades) tile.shades[static_cast<std::size_t>(places[lane])] = shades[lane];
  }
}

/// Segments before layers and the clip region cut them.
struct WholeSegments {
  Segments segments;
  Float near_d, far_d, near_z, far_z;
  Float w, key_offset;  // of the chunk at the pixel
  Int pixel;
  Mask hit;
};

/// Adds the parts of segments between each two limits. In front of a layer, and behind it, the order stays that of
/// whole cells.
template <bool orthographic, bool has_shades>
HWY_NOINLINE void add_parts(const CellTile& t, const WholeSegments& whole, TileSegments& tile) {
  // Lanes behind the last pixel may have any number.
  const Int pixel = whole.pixel & Int(cell_tile_pixels - 1);
  for (std::size_t part = 0; part <= t.frame.layers; ++part) {
    const Float first_d = gather(tile.limits[part].d.data(), pixel);
    const Float last_d = gather(tile.limits[part + 1].d.data(), pixel);
    const Float from = min(whole.near_d, first_d), to = max(whole.far_d, last_d);
    Segments segments = whole.segments;
    // Both ends may be one in single precision.
    const Mask is_uncut = both(whole.near_d <= first_d, whole.far_d > last_d);
    Mask hit = both(whole.hit, either(from > to, is_uncut));
    if (part < t.frame.layers) hit = both(hit, segments.key < gather(tile.layers[part].keys.data(), pixel));
    if (!any(hit)) continue;
    if (part > 0) segments.key = max(segments.key, gather(tile.layers[part - 1].keys.data(), pixel));
    const Float from_z = z_at<orthographic>(from, whole.w), to_z = z_at<orthographic>(to, whole.w);
    const Float inverse = Float(1.0F) / segments.length;
    const Float before = depth_between(whole.near_d, whole.near_z, from, from_z) * inverse;
    const Float behind = depth_between(to, to_z, whole.far_d, whole.far_z) * inverse;
    const auto cut = [&](Float& at_enter, Float& at_leave) HWY_ATTR {
      const Float change = at_leave - at_enter;
      at_enter = fma(change, before, at_enter);
      at_leave = fnma(change, behind, at_leave);
    };
    cut(segments.u_enter, segments.u_leave);
    if (has_shades) cut(segments.o_enter, segments.o_leave);
    segments.length = select(is_uncut, whole.segments.length, depth_between(from, from_z, to, to_z));
    store_segments<has_shades>(segments, hit, whole.pixel, tile);
    if (tile.is_full) return;
  }
}

/// A share of a segment, as a place of its own on it: `share` is 0 where it begins, and 1 where it ends.
template <bool orthographic>
HWY_INLINE Float z_of_share(const WholeSegments& whole, Float share) {
  return orthographic ? Float(1.0F) : fma(whole.far_z - whole.near_z, share, whole.near_z);
}
HWY_INLINE Float d_of_share(const WholeSegments& whole, Float share, Float z) {
  const Float d = fma(whole.far_d - whole.near_d, share * whole.far_z / z, whole.near_d);
  return select(share >= Float(1.0F), whole.far_d, clamp(d, whole.far_d, whole.near_d));
}
/// The other way: the share of a depth.
HWY_INLINE Float share_of_depth(const WholeSegments& whole, Float d, Float z) {
  return clamp(depth_between(whole.near_d, whole.near_z, d, z) / max(whole.segments.length, 1e-37F), 0.0F, 1.0F);
}
HWY_INLINE Float mix(Float from, Float to, Float share) { return fma(to - from, share, from); }

/// Cuts off what lies behind a share of the segments, and returns it. The order of parts is that of their own depths.
HWY_INLINE WholeSegments cut_at(WholeSegments& whole, Float share, Float d, Float z) {
  WholeSegments behind = whole;
  Segments &front = whole.segments, &rest = behind.segments;
  front.length = whole.segments.length * share;
  rest.length = rest.length - front.length;
  front.u_leave = rest.u_enter = mix(rest.u_enter, rest.u_leave, share);
  front.o_leave = rest.o_enter = mix(rest.o_enter, rest.o_leave, share);
  rest.key = max(front.key, -(d + whole.key_offset));
  whole.far_d = behind.near_d = d;
  whole.far_z = behind.near_z = z;
  return behind;
}

/// Adds segments, cut by layers and the clip region if there are some.
template <bool orthographic, bool has_shades>
HWY_INLINE void add_whole(const CellTile& t, const WholeSegments& whole, TileSegments& tile) {
  if (t.has_limits)
    add_parts<orthographic, has_shades>(t, whole, tile);
  else
    store_segments<has_shades>(whole.segments, whole.hit, whole.pixel, tile);
}

/// The same, cut by slices too. `slices`: a bit for each.
template <bool orthographic, bool has_shades>
HWY_NOINLINE void add_between_slices(const CellTile& t, WholeSegments whole, std::uint64_t slices, TileSegments& tile) {
  for (; slices != 0; slices &= slices - 1) {
    const auto slice = static_cast<std::size_t>(std::countr_zero(slices));
    const Float d = gather(tile.slices[slice].d.data(), whole.pixel & Int(cell_tile_pixels - 1));
    const Mask cut = both(whole.hit, both(whole.near_d > d, d > whole.far_d));
    if (!any(cut)) continue;
    const Float z = z_at<orthographic>(d, whole.w);
    WholeSegments in_front = whole;
    WholeSegments behind = cut_at(in_front, share_of_depth(whole, d, z), d, z);
    behind.hit = in_front.hit = cut;
    add_between_slices<orthographic, has_shades>(t, in_front, slices & (slices - 1), tile);
    add_between_slices<orthographic, has_shades>(t, behind, slices & (slices - 1), tile);
    whole.hit = hn::AndNot(cut, whole.hit);
  }
  if (any(whole.hit)) add_whole<orthographic, has_shades>(t, whole, tile);
}

/// Adds an event on each segment of a mask. `number`: as events in the order of the ray sort, from 1 up.
template <bool has_shades>
HWY_INLINE void add_event(const WholeSegments& whole, Mask met, Float d, Float number, Float value, Float light,
                          TileSegments& tile) {
  Segments event{};
  event.key = max(whole.segments.key, -(d + whole.key_offset));
  event.length = -number;
  event.u_enter = value, event.u_leave = light;
  event.lighting = event.o_enter = event.o_leave = Float(0.0F);
  store_segments<has_shades>(event, met, whole.pixel, tile);
}

/// A cell in which rays may meet something.
struct CellWithEvents {
  const CellOnScreen& cell;
  const CellShading& shading;
  const EventsOfCell& events;
};

/// Pixels, and by which faces their rays enter and leave a cell; 4: the eye's plane.
struct RaysInCell {
  Float x, y;
  Int enter, leave;
};

/// Where rays enter or leave: values less that of a contour, and whether they count as above it.
struct SideOfContour {
  Float u;
  Mask is_above;
};

/// Tells by double precision on which side places on a face are. `lanes`: a bit for each.
HWY_NOINLINE std::uint32_t bits_above(const ContourInCell::Face& face, const RaysInCell& rays, std::uint32_t lanes) {
  alignas(64) std::array<float, most_lanes> x, y;
  store(rays.x, x.data());
  store(rays.y, y.data());
  std::uint32_t above = 0;
  for (; lanes != 0; lanes &= lanes - 1) {
    const auto lane = static_cast<std::size_t>(std::countr_zero(lanes));
    const double s = face.s + face.e * (double{x[lane]} - face.x) + face.f * (double{y[lane]} - face.y);
    if (s >= -CellEvents::rounding * double{face.largest_s}) above |= 1U << lane;
  }
  return above;
}

HWY_INLINE SideOfContour side_on_faces(const ContourInCell& contour, const RaysInCell& rays, Int number, int begin,
                                       int end, Mask hit, Float z) {
  SideOfContour side;
  side.u = fma(contour.eye_e, rays.x, fma(contour.eye_f, rays.y, contour.eye_u));
  side.is_above = side.u >= Float(0.0F);
  for (int k = begin; k < end; ++k) {
    const ContourInCell::Face& face = contour.faces[static_cast<std::size_t>(k)];
    const Mask here = both(hit, mask_of(hn::Eq(number.v, Int(k).v)));
    if (!any(here)) continue;
    const Float dx = (rays.x - face.whole_x) - face.rest_x, dy = (rays.y - face.whole_y) - face.rest_y;
    const Float s = fma(dx, face.single_e, fma(dy, face.single_f, face.single_s));
    Mask is_above = s >= Float(0.0F);
    const Mask is_near = both(here, abs(s) <= Float(face.largest_s * CellEvents::single_rounding));
    if (any(is_near)) {
      const Int bits(static_cast<std::int32_t>(bits_above(face, rays, mask_bits(is_near))));
      const Mask is_set = hn::Not(is_zero(bits & Int(hn::Shl(Int(1).v, lane_indices().v))));
      is_above = either(hn::AndNot(is_near, is_above), both(is_near, is_set));
    }
    side.u = select(here, clamp(s * z, face.low, face.high), side.u);
    side.is_above = either(hn::AndNot(here, side.is_above), both(here, is_above));
  }
  return side;
}

/// Returns a part of segments, between two shares of each.
template <bool orthographic>
HWY_INLINE WholeSegments part_of(const WholeSegments& whole, Float from, Float to) {
  WholeSegments part = whole;
  part.hit = both(whole.hit, from < to);
  part.near_z = z_of_share<orthographic>(whole, from), part.far_z = z_of_share<orthographic>(whole, to);
  part.near_d = d_of_share(whole, from, part.near_z), part.far_d = d_of_share(whole, to, part.far_z);
  Segments& segments = part.segments;
  segments.length = whole.segments.length * (to - from);
  segments.u_enter = mix(whole.segments.u_enter, whole.segments.u_leave, from);
  segments.u_leave = mix(whole.segments.u_enter, whole.segments.u_leave, to);
  segments.o_enter = mix(whole.segments.o_enter, whole.segments.o_leave, from);
  segments.o_leave = mix(whole.segments.o_enter, whole.segments.o_leave, to);
  segments.key = select(from > Float(0.0F), max(segments.key, -(part.near_d + whole.key_offset)), segments.key);
  return part;
}

/// The factor on the colours of a contour at a place on a ray: by the gradients of the points.
template <bool orthographic>
HWY_INLINE Float light_on_contour(const CellTile& t, const CellWithEvents& c, const RaysInCell& rays, Float d,
                                  Float z) {
  const CellShading& shading = c.shading;
  const NormalInCell& normal = t.screen.normals[c.events.normal_at];
  const Float dx = rays.x - shading.x, dy = rays.y - shading.y, from_d = d - shading.d;
  const Float nx = field_at(normal[0], dx, dy, from_d, z), ny = field_at(normal[1], dx, dy, from_d, z),
              nz = field_at(normal[2], dx, dy, from_d, z);
  Float along = nz, square = fma(nx, nx, fma(ny, ny, nz * nz));
  if (!orthographic) {
    const Float a = rays.x * t.per_pixel, b = rays.y * t.per_pixel;
    along = fma(nx, a, fma(ny, b, nz));
    square = square * fma(a, a, fma(b, b, 1.0F));
  }
  // Without a gradient it is lit as from the front.
  const Float cosine = select(square > Float(1e-30F), abs(along) / sqrt(max(square, 1e-30F)), 1.0F);
  const auto ambient = static_cast<float>(t.frame.contour_lighting.ambient),
             diffuse = static_cast<float>(t.frame.contour_lighting.diffuse);
  return fma(cosine, diffuse, ambient);
}

/// Adds contours, and the segments between them.
template <bool orthographic, bool has_shades>
HWY_INLINE void add_contours(const CellTile& t, const CellWithEvents& c, const WholeSegments& whole,
                             const RaysInCell& rays, TileSegments& tile) {
  const std::int32_t contours = t.frame.events->contours();
  const Mask rises = whole.segments.u_leave >= whole.segments.u_enter;
  const auto add_part = [&](Float from, Float to) HWY_ATTR {
    if (!c.cell.shows_matter || !any(both(whole.hit, from < to))) return;
    const WholeSegments part = part_of<orthographic>(whole, from, to);
    add_between_slices<orthographic, has_shades>(t, part, c.events.slices, tile);
  };
  // A ray that rises meets lower values first, and one that falls higher ones.
  Float before = select(rises, Float(0.0F), Float(1.0F));
  for (std::int32_t i = c.events.first; i < c.events.end; ++i) {
    const ContourInCell& contour =
        t.screen.contours[c.events.contour_at + static_cast<std::uint32_t>(i - c.events.first)];
    const SideOfContour enter = side_on_faces(contour, rays, rays.enter, 0, c.cell.fronts, whole.hit, whole.near_z);
    const int first_back = c.cell.precise < 0 ? c.cell.fronts : 0;
    const SideOfContour leave = side_on_faces(contour, rays, rays.leave, first_back, 4, whole.hit, whole.far_z);
    Mask met = both(whole.hit, hn::Xor(enter.is_above, leave.is_above));
    const Float change = leave.u - enter.u, none = select(hn::Xor(rises, enter.is_above), Float(1.0F), Float(0.0F));
    const Mask is_flat = hn::Eq(change.v, hn::Zero(FloatTag()));
    Float share = clamp(-enter.u / select(is_flat, Float(1.0F), change), 0.0F, 1.0F);
    share = select(met, share, none);
    add_part(min(before, share), max(before, share));
    if (tile.is_full) return;
    before = share;
    if (!any(met)) continue;
    const Float z = z_of_share<orthographic>(whole, share), d = d_of_share(whole, share, z);
    if (t.has_limits) {
      const Int pixel = whole.pixel & Int(cell_tile_pixels - 1);
      met = both(
          met, both(d <= gather(tile.limits.front().d.data(), pixel), d >= gather(tile.limits.back().d.data(), pixel)));
    }
    Float color(0.0F);
    if (t.frame.contour_colors) {
      color = Float(FunctionPieces::outside);
      if (c.shading.has_color)
        color = field_at(c.shading.color, rays.x - c.shading.x, rays.y - c.shading.y, d - c.shading.d, z);
    }
    const Float light = light_on_contour<orthographic>(t, c, rays, d, z);
    const Float number =
        select(leave.is_above, Float(static_cast<float>(contours - i)), Float(static_cast<float>(contours + i + 1)));
    add_event<has_shades>(whole, met, d, number, color, light, tile);
    if (tile.is_full) return;
  }
  const Float last = select(rises, Float(1.0F), Float(0.0F));
  add_part(min(before, last), max(before, last));
}

/// Adds what rays meet in a cell, and the segments between.
template <bool orthographic, bool has_shades>
HWY_NOINLINE void add_with_events(const CellTile& t, const CellWithEvents& c, const WholeSegments& whole,
                                  const RaysInCell& rays, TileSegments& tile) {
  // Cells begin a little sooner and end a little later, as far as places on the screen are rounded: of neighbours, the
  // first one that has a place counts.
  Float enter_slope(0.0F), leave_slope(0.0F);
  for (std::int32_t k = 0; k < 4 && c.events.slices != 0; ++k) {
    const CellOnScreen::Face& face = c.cell.faces[static_cast<std::size_t>(k)];
    const Float slope((std::abs(face.a) + std::abs(face.b)) * (0.02F * t.frame.slack));
    enter_slope = select(mask_of(hn::Eq(rays.enter.v, Int(k).v)), slope, enter_slope);
    leave_slope = select(mask_of(hn::Eq(rays.leave.v, Int(k).v)), slope, leave_slope);
  }
  const auto margin = [&](Float d, Float z, Float slope) HWY_ATTR {
    const Float length = whole.segments.length / (z * z);
    return fma(abs(d), 4e-7F, fma(length, 1e-6F, min(slope, length * 0.01F)));
  };
  const Float nearest = whole.near_d + margin(whole.near_d, whole.near_z, enter_slope);
  const Float farthest_here = whole.far_d - margin(whole.far_d, whole.far_z, leave_slope);
  for (std::uint64_t slices = c.events.slices; slices != 0; slices &= slices - 1) {
    const auto slice = static_cast<std::size_t>(std::countr_zero(slices));
    Float d = gather(tile.slices[slice].d.data(), whole.pixel & Int(cell_tile_pixels - 1));
    Mask met = both(d <= nearest, d >= farthest_here);
    // Rounding of depths may take a slice off the face in which it lies.
    for (std::int32_t k = 0; k < 4; ++k)
      if ((c.events.slices_of_faces[static_cast<std::size_t>(k)] >> slice & 1) != 0)
        met = either(met, either(mask_of(hn::Eq(rays.enter.v, Int(k).v)), mask_of(hn::Eq(rays.leave.v, Int(k).v))));
    met = both(both(met, whole.hit), d > Float(-0.5F * farthest));
    if (!any(met)) continue;
    d = clamp(d, whole.far_d, whole.near_d);
    const Float share = share_of_depth(whole, d, z_at<orthographic>(d, whole.w));
    const auto number = static_cast<float>(2 * t.frame.events->contours() + static_cast<int>(slice) + 1);
    add_event<has_shades>(whole, met, d, number, mix(whole.segments.u_enter, whole.segments.u_leave, share), 1.0F,
                          tile);
    if (tile.is_full) return;
  }
  if (c.events.first < c.events.end)
    add_contours<orthographic, has_shades>(t, c, whole, rays, tile);
  else if (c.cell.shows_matter)
    add_between_slices<orthographic, has_shades>(t, whole, c.events.slices, tile);
}

/// A cell, and what it has besides.
struct CellToAdd {
  const CellOnScreen& cell;
  const CellShading* shading;  // null: the frame has no shades, nor events
  const EventsOfCell* events;  // null: the cell has none
};

/// Adds segments of a cell.
template <bool orthographic, bool has_shades, bool has_events>
HWY_INLINE void add_found(const CellTile& t, const CellToAdd& c, const WholeSegments& whole, const RaysInCell& rays,
                          TileSegments& tile) {
  if constexpr (has_events)
    add_with_events<orthographic, has_shades>(t, {c.cell, *c.shading, *c.events}, whole, rays, tile);
  else
    add_whole<orthographic, has_shades>(t, whole, tile);
}

/// Returns how much the plane from which depths in a chunk count is above the depth of the chunk's middle.
HWY_INLINE Float rise_at(const CellTile& t, Float x, Float y) {
  return t.is_flat ? fma(x - t.at_x, t.wx, (y - t.at_y) * t.wy) : Float(0.0F);
}

/// Returns the light on a cell: 1 without lighting.
template <bool orthographic, bool has_shades>
HWY_INLINE Float light_on(const CellTile& t, const CellToAdd& c, Float x, Float y) {
  return has_shades && t.frame.lighting ? light_at<orthographic>(t, *t.frame.lighting, *c.shading, x, y) : Float(1.0F);
}

/// Adds the segments of a precise cell.
template <bool orthographic, bool has_shades, bool has_events>
HWY_NOINLINE void add_precise_cell(const CellTile& t, const CellToAdd& c, const PreciseCell& precise,
                                   TileSegments& tile) {
  const int count = list_wanted(c.cell, t.corner, precise.slack, tile.covered.data());
  if (count == 0) return;
  const PreciseRays rays_of_cell(t.frame, t.screen.origin, precise);
  PreciseWays ways;
  const auto lanes = [](const PreciseWays::Lanes& numbers) HWY_ATTR { return load(numbers.data()); };
  for (int first = 0; first < count; first += lane_count()) {
    const Int pixel = load(tile.covered.data() + first);
    const Float x = to_float(pixel & Int(cell_tile_side - 1)) + t.corner.x,
                y = to_float(shift_right<4>(pixel)) + t.corner.y;
    const auto valid = hn::FirstN(FloatTag(), static_cast<std::size_t>(std::min(count - first, lane_count())));
    const Mask hit = both(rays_of_cell.find<orthographic>(x, y, ways), valid);
    if (!any(hit)) continue;
    const Float rise = rise_at(t, x, y);
    const Float key_offset = rise + t.screen.key_offset;
    const Float near_d = min(lanes(ways.enter.d), Float(t.nearest_d) - rise), far_d = min(lanes(ways.leave.d), near_d);
    const WholeSegments whole{
        {max(-(near_d + key_offset), t.first_key), lanes(ways.length),
         clamp(lanes(ways.enter.u), c.cell.low, c.cell.high), clamp(lanes(ways.leave.u), c.cell.low, c.cell.high),
         light_on<orthographic, has_shades>(t, c, x, y), lanes(ways.enter.o), lanes(ways.leave.o)},
        near_d,
        far_d,
        lanes(ways.enter.z),
        lanes(ways.leave.z),
        rise + t.w,
        key_offset,
        pixel,
        hit};
    const RaysInCell rays{x, y, truncate(lanes(ways.enter.face)), truncate(lanes(ways.leave.face))};
    add_found<orthographic, has_shades, has_events>(t, c, whole, rays, tile);
    if (tile.is_full) return;
  }
}

/// Where rays enter and leave a cell.
template <class CrossingOfCell>
struct WaysThrough {
  CrossingOfCell enter, leave;
};

/// Returns the ways of rays through a cell that is not precise; without a length where `enter` is not before `leave`.
template <class CrossingOfCell>
HWY_INLINE WaysThrough<CrossingOfCell> cross(const CellOnScreen& cell, Float x, Float y) {
  const auto& references = cell.corners;
  const std::array<Float, 2> dx = {x - references[0].x, x - references[1].x},
                             dy = {y - references[0].y, y - references[1].y};
  const auto cross_face = [&](int k) HWY_ATTR {
    const CellOnScreen::Face& face = cell.faces[static_cast<std::size_t>(k)];
    const int r = cell.second >> k & 1;
    // Both cells of a face round the same numbers in the same way up to here.
    CrossingOfCell crossing;
    crossing.d = fma(face.a, dx[r], dy[r] * face.b) + face.d;
    crossing.n = fma(face.e, dx[r], dy[r] * face.f);
    crossing.u = references[r].u;
    if constexpr (std::is_same_v<CrossingOfCell, CrossingOfFace>) crossing.face = Int(k);
    return crossing;
  };
  const auto enter_at = [&](const CrossingOfCell& face, const CrossingOfCell& other)
                            HWY_ATTR { return select(face.d < other.d, face, other); };
  const auto leave_at = [&](const CrossingOfCell& face, const CrossingOfCell& other)
                            HWY_ATTR { return select(face.d > other.d, face, other); };
  if (cell.fronts == 2) return {enter_at(cross_face(1), cross_face(0)), leave_at(cross_face(3), cross_face(2))};
  if (cell.fronts == 1) return {cross_face(0), leave_at(cross_face(3), leave_at(cross_face(2), cross_face(1)))};
  return {enter_at(cross_face(2), enter_at(cross_face(1), cross_face(0))), cross_face(3)};
}

/// Adds the segments of a cell that is not precise.
template <bool orthographic, bool has_shades, bool has_events>
HWY_INLINE void add_cell(const CellTile& t, const CellToAdd& c, TileSegments& tile) {
  const CellOnScreen& cell = c.cell;
  const TileCorner& corner = t.corner;
  const int count = list_wanted(cell, corner, t.frame.slack, tile.covered.data());
  for (int first = 0; first < count; first += lane_count()) {
    const Int pixel = load(tile.covered.data() + first);
    const Float x = to_float(pixel & Int(cell_tile_side - 1)) + corner.x,
                y = to_float(shift_right<4>(pixel)) + corner.y;
    auto [enter, leave] = cross<std::conditional_t<has_events, CrossingOfFace, Crossing>>(cell, x, y);
    const Float rise = rise_at(t, x, y);
    enter.d = min(enter.d, Float(t.nearest_d) - rise);
    const auto valid = hn::FirstN(FloatTag(), static_cast<std::size_t>(std::min(count - first, lane_count())));
    const Mask hit = both(enter.d > leave.d, valid);
    if (!any(hit)) continue;

    const Float w = rise + t.w;
    const Float near_z = z_at<orthographic>(enter.d, w), far_z = z_at<orthographic>(leave.d, w);
    const Float length = depth_between(enter.d, near_z, leave.d, far_z);
    const Float u_enter = clamp(fma(enter.n, near_z, enter.u), cell.low, cell.high);
    const Float u_leave = clamp(fma(leave.n, far_z, leave.u), cell.low, cell.high);
    Float o_enter(0.0F), o_leave(0.0F);
    if (has_shades && t.frame.opacity) {
      const Float dx_shade = x - c.shading->x, dy_shade = y - c.shading->y;
      o_enter = field_at(c.shading->opacity, dx_shade, dy_shade, enter.d - c.shading->d, near_z);
      o_leave = field_at(c.shading->opacity, dx_shade, dy_shade, leave.d - c.shading->d, far_z);
    }
    const Float key_offset = rise + t.screen.key_offset, key = max(-(enter.d + key_offset), t.first_key);
    const WholeSegments whole{
        {key, length, u_enter, u_leave, light_on<orthographic, has_shades>(t, c, x, y), o_enter, o_leave},
        enter.d,
        leave.d,
        near_z,
        far_z,
        w,
        key_offset,
        pixel,
        hit};
    RaysInCell rays{x, y, {}, {}};
    if constexpr (has_events) rays.enter = enter.face, rays.leave = leave.face;
    add_found<orthographic, has_shades, has_events>(t, c, whole, rays, tile);
    if (tile.is_full) return;
  }
}

/// Adds segments that were found before. They lie in front of the eye.
void add_found_before(std::span<const FoundSegment> all, const TileCorner& corner, float first_key,
                      TileSegments& tile) {
  const PixelRectangle& drawn = corner.pixels;
  for (const FoundSegment& found : all) {
    const int x = found.x - corner.left, y = found.y - corner.bottom;
    if (x < drawn.x0 || x > drawn.x1 || y < drawn.y0 || y > drawn.y1) continue;
    const std::size_t pixel = CellTileArea::number_of(x, y);
    if (corner.is_wanted && corner.is_wanted[pixel] == 0) continue;
    if (tile.counts[pixel] >= tile.room && !tile.make_room()) return;
    CellSegment& to = tile.segments[tile.begin_of(pixel) + static_cast<std::size_t>(tile.counts[pixel]++)];
    to = found.segment;
    to.key = std::max(to.key, first_key);
    ++tile.added;
  }
}

template <bool orthographic, bool has_shades>
void add_all(const CellTile& t, std::span<const std::uint32_t> numbers, TileSegments& tile) {
  const CellsOnScreen& screen = t.screen;
  const auto prefetch = [](const auto& all) HWY_ATTR {
    const auto* bytes = reinterpret_cast<const char*>(&all);
    for (std::size_t at = 0; at < sizeof(all); at += 64) hwy::Prefetch(bytes + at);
  };
  const auto number_at = [&](std::size_t i) { return numbers[std::min(i, numbers.size() - 1)]; };
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    // Not in functions of their own: GCC drops those that only prefetch.
    const std::uint32_t next = number_at(i + 6), soon = number_at(i + 3);
    if (CellsOnScreen::has_found(next))
      hwy::Prefetch(&screen.found[screen.found_begins[next & ~CellsOnScreen::found_bit]]);
    else
      prefetch(screen.cells[next]);
    if (!screen.precise.empty() && !CellsOnScreen::has_found(soon) && screen.cells[soon].precise >= 0)
      prefetch(screen.precise[static_cast<std::size_t>(screen.cells[soon].precise)]);
    if (CellsOnScreen::has_found(numbers[i])) {
      add_found_before(screen.found_of(numbers[i]), t.corner, t.first_key, tile);
      continue;
    }
    const CellOnScreen& cell = screen.cells[numbers[i]];
    if (!cell.shows_matter && !cell.has_events) continue;
    const bool has_events = cell.has_events;
    const CellToAdd c = {cell, screen.shadings.empty() ? nullptr : &screen.shadings[numbers[i]],
                         has_events ? &screen.events[numbers[i]] : nullptr};
    if (cell.precise >= 0) {
      const PreciseCell& precise = screen.precise[static_cast<std::size_t>(cell.precise)];
      if (has_events)
        add_precise_cell<orthographic, has_shades, true>(t, c, precise, tile);
      else
        add_precise_cell<orthographic, has_shades, false>(t, c, precise, tile);
    } else if (has_events) {
      add_cell<orthographic, has_shades, true>(t, c, tile);
    } else {
      add_cell<orthographic, has_shades, false>(t, c, tile);
    }
  }
}

void add_cells(const CellFrame& frame, const CellsOnScreen& screen, std::span<const std::uint32_t> numbers,
               const CellTileArea& area, float first_key, TileSegments& tile) {
  const DepthOrigin& origin = screen.origin;
  // Rounding must not cut off a part of a thin cell.
  const float slack = 1e-6F * (std::abs(first_key) + std::abs(screen.key_offset));
  const CellTile t = {frame,
                      screen,
                      {area.left, area.bottom, area.pixels, static_cast<float>(area.left - frame.middle_x),
                       static_cast<float>(area.bottom - frame.middle_y), area.is_wanted},
                      first_key,
                      slack - first_key - screen.key_offset,
                      static_cast<float>(1 / frame.view->focal),
                      frame.has_limits(),
                      origin.wx != 0 || origin.wy != 0,
                      static_cast<float>(origin.w),
                      static_cast<float>(origin.wx),
                      static_cast<float>(origin.wy),
                      static_cast<float>(origin.at_x),
                      static_cast<float>(origin.at_y)};
  const bool has_shades = frame.has_shades();
  if (frame.view->orthographic)
    has_shades ? add_all<true, true>(t, numbers, tile) : add_all<true, false>(t, numbers, tile);
  else
    has_shades ? add_all<false, true>(t, numbers, tile) : add_all<false, false>(t, numbers, tile);
}

/// Numbers of a function's pieces, to look up: in registers if `few`.
template <bool few>
class Lookup {
 public:
  explicit HWY_INLINE Lookup(const std::vector<float>& numbers) : numbers_(numbers.data()) {
    if constexpr (is_held())
      for (std::size_t i = 0; i < most_lanes / lanes(); ++i) held_[i] = load(numbers_ + i * lanes());
  }
  [[nodiscard]] HWY_INLINE Float at(Int piece) const {
    if constexpr (!is_held()) {
      return gather(numbers_, piece);
    } else {
      const auto in_part = hn::IndicesFromVec(FloatTag(), (piece & Int(static_cast<int>(lanes()) - 1)).v);
      const Float low = hn::TableLookupLanes(held_[0].v, in_part);
      if constexpr (lanes() == most_lanes) return low;
      const Float high = hn::TableLookupLanes(held_[most_lanes / lanes() - 1].v, in_part);
      return select(mask_of(hn::Gt(piece.v, Int(static_cast<int>(lanes()) - 1).v)), high, low);
    }
  }

 private:
  static constexpr std::size_t lanes() {
    return HWY_MAX_BYTES / sizeof(float) < most_lanes ? HWY_MAX_BYTES / sizeof(float) : most_lanes;
  }
  static constexpr bool is_held() { return few && lanes() >= most_lanes / 2; }

  const float* numbers_;
  std::array<Float, 2> held_;
};

/// The light of rays that is gathered.
struct Light {
  std::array<Float, 3> color;
  Float transmittance;
};

/// On colours and extinctions of a stretch.
struct Factors {
  Float lighting;
  Float first, last;  // of the opacity, at its ends; linear between them
};

/// A step along a segment, in which extinction and factor are linear.
template <bool factored>
struct Step {
  Float length, reach;        // in world units, and in u
  Float k, rise;              // the extinction, and its change
  Float factor, factor_rise;  // the same of the factor

  /// The optical depth up to a share p of the step.
  [[nodiscard]] HWY_INLINE Float depth_at(float p) const {
    if constexpr (!factored) return fma(rise, 0.5F * p, k) * (length * p);
    const Float mixed = fma(k, factor_rise, rise * factor);
    return max(fma(rise * factor_rise, p * p / 3, fma(mixed, 0.5F * p, k * factor)), 0.0F) * (length * p);
  }
  [[nodiscard]] HWY_INLINE Float extinction_at(float p) const {
    const Float plain = fma(rise, p, k);
    return factored ? plain * fma(factor_rise, p, factor) : plain;
  }
};

/// Returns the piece of a function that a ray is in from `u` on. Upwards a knot belongs to what follows it, downwards
/// to what precedes it.
HWY_INLINE Int piece_in(const FunctionPieces& function, Float u, Mask up) {
  constexpr int last_bin = FunctionPieces::bins + 1;
  const Int bin = truncate(clamp(fma(u, static_cast<float>(FunctionPieces::bins), function.bin_of_origin), 0.0F,
                                 static_cast<float>(last_bin)));
  const auto first_of = [&](Int of)
                            HWY_ATTR { return Int(hn::GatherIndex(IntTag(), function.first_of_bin.data(), of.v)); };
  Int piece = first_of(bin);
  // Of a bent axis, hundreds of pieces may begin in a bin.
  Int behind = first_of(min(bin + Int(1), Int(last_bin))) + Int(1);
  for (;;) {
    const Mask several = mask_of(hn::Gt((behind - piece).v, Int(1).v));
    if (!any(several)) break;
    const Int middle = shift_right<1>(piece + behind);
    const Mask later = gather(function.starts.data(), middle) <= u;
    piece = select_int(both(several, later), middle, piece);
    behind = select_int(hn::AndNot(later, several), middle, behind);
  }
  // Rounding of the bin may have led not far enough.
  for (;;) {
    const Mask later = gather(function.starts.data(), piece + Int(1)) <= u;
    if (!any(later)) break;
    piece = piece + select_int(later, Int(1), Int(0));
  }
  // Or too far.
  for (;;) {
    const Float start = gather(function.starts.data(), piece);
    const Mask sooner = either(start > u, hn::AndNot(up, start >= u));
    if (!any(sooner)) break;
    piece = piece - select_int(sooner, Int(1), Int(0));
  }
  return piece;
}

template <bool few>
class Integrator {
 public:
  explicit HWY_INLINE Integrator(const FunctionPieces& function)
      : function_(function),
        starts_(function.starts),
        values_{Lookup<few>(function.values[0]), Lookup<few>(function.values[1]), Lookup<few>(function.values[2]),
                Lookup<few>(function.values[3])},
        slopes_{Lookup<few>(function.slopes[0]), Lookup<few>(function.slopes[1]), Lookup<few>(function.slopes[2]),
                Lookup<few>(function.slopes[3])} {}

  /// Adds the light of segments along which u goes linearly from `u` to `end`, in steps: to the next knot of the
  /// function or to an optical depth of one, whichever comes first.
  template <bool factored>
  HWY_INLINE void add(Mask todo, Float u, const Float end, const Float length, const Factors& factors,
                      Light& light) const {
    const Float change = end - u;
    const Mask up = change >= Float(0.0F), flat = hn::Eq(change.v, hn::Zero(FloatTag()));
    const Float per_u = length / select(flat, 1.0F, change);  // with a sign
    Int piece = piece_at(u, up);
    Float left = length;
    const Float fall = (factors.last - factors.first) / max(length, 1e-37F);
    // Where what is left is known best: by its length, or near u = 0 by u.
    const Mask by_left = abs(end) >= abs(change);
    while (any(todo)) {
      const Float start = starts_.at(piece), next = starts_.at(piece + Int(1)), x = u - start;
      const Float to = select(up, min(end, next), max(end, start));
      Mask last = either(flat, hn::Eq(to.v, end.v));
      const Float whole = select(both(last, by_left), max(left, 0.0F), (to - u) * per_u), slope = slopes_[3].at(piece);
      Float k = max(fma(slope, x, values_[3].at(piece)), 0.0F), rise = slope * (to - u);
      // Extinction times factor counts as linear only to choose steps.
      Float factor(1.0F), first = k, change_of_step = rise;
      if constexpr (factored) {
        factor = max(fma(fall, length - left, factors.first), 0.0F);
        first = k * factor;
        change_of_step = (k + rise) * max(fma(fall, whole, factor), 0.0F) - first;
      }
      const Mask is_dense = both(fma(change_of_step, 0.5F, first) * whole > Float(1.0F), todo);
      Float part(1.0F);
      if (any(is_dense)) {
        part = select(is_dense, part_of_dense(whole, first, change_of_step, k, rise), part);
        last = hn::AndNot(is_dense, last);
      }
      const Float step_length = whole * part;
      const Step<factored> step = {step_length, (to - u) * part, k,
                                   rise * part, factor,          factored ? fall * step_length : Float(0.0F)};
      const Float depth = step.depth_at(1.0F);
      const std::array<Float, 3> sum = emission(todo, piece, x, step, depth);
      const Float front = light.transmittance * step.length * factors.lighting;
      for (std::size_t c = 0; c < 3; ++c)
        light.color[c] = select(todo, fma(front, sum[c], light.color[c]), light.color[c]);
      light.transmittance =
          select(todo, fnma(light.transmittance, opacity(depth), light.transmittance), light.transmittance);
      left = left - step.length;
      u = select(is_dense, u + step.reach, to);
      const Mask crossed = hn::AndNot(either(last, is_dense), todo);
      if (any(crossed)) {
        if (function_.has_peaks) {
          const Float here = factored ? max(fma(fall, length - left, factors.first), 0.0F) : Float(1.0F);
          add_peak(crossed, select_int(up, piece + Int(1), piece), abs(per_u) * here, factors.lighting, light);
        }
        piece = piece + select_int(crossed, select_int(up, Int(1), Int(-1)), Int(0));
      }
      todo = both(hn::AndNot(last, todo), light.transmittance > Float(1e-6F));
    }
  }

  /// The same with an opacity along which o goes linearly: in stretches between its knots.
  HWY_INLINE void add_with_opacity(Mask todo, Float u, const Float u_end, Float o, const Float o_end, Float length,
                                   Float lighting, const FunctionPieces& opacity, Light& light) const {
    const Float u_change = u_end - u, u_begin = u, o_change = o_end - o, o_begin = o;
    const Mask up = o_change >= Float(0.0F), flat = hn::Eq(o_change.v, hn::Zero(FloatTag()));
    const Float per_o = Float(1.0F) / select(flat, 1.0F, o_change);
    Int piece = piece_in(opacity, o, up);
    Float share(0.0F);
    while (any(todo)) {
      const Float start = gather(opacity.starts.data(), piece), next = gather(opacity.starts.data(), piece + Int(1));
      const Float to = select(up, min(o_end, next), max(o_end, start));
      const Mask last = either(flat, hn::Eq(to.v, o_end.v));
      const Float share_to = select(last, 1.0F, clamp((to - o_begin) * per_o, share, 1.0F));
      const Float u_to = select(last, u_end, fma(u_change, share_to, u_begin));
      const auto factor_at = [&](Float at) HWY_ATTR {
        const Float slope = gather(opacity.slopes[3].data(), piece), value = gather(opacity.values[3].data(), piece);
        return max(fma(slope, at - start, value), 0.0F);
      };
      const Factors factors = {lighting, factor_at(o), factor_at(to)};
      const Mask shows = both(todo, factors.first + factors.last > Float(0.0F));
      if (any(shows)) add<true>(shows, u, u_to, length * (share_to - share), factors, light);
      u = u_to, o = to, share = share_to;
      todo = both(hn::AndNot(last, todo), light.transmittance > Float(1e-6F));
      piece = piece + select_int(todo, select_int(up, Int(1), Int(-1)), Int(0));
    }
  }

 private:
  // As piece_in.
  [[nodiscard]] HWY_INLINE Int piece_at(Float u, Mask up) const {
    if (!few) return piece_in(function_, u, up);
    Int piece(-1);
    for (std::size_t i = 0; i < function_.count; ++i) {
      const Float start(function_.starts[i]);
      const Mask begun = either(both(up, start <= u), hn::AndNot(up, start < u));
      piece = piece + select_int(begun, Int(1), Int(0));
    }
    return piece;
  }

  // Returns the share of a stretch up to an optical depth of one: first whole p + change whole p^2 / 2 = 1. Denser
  // matter is opaque at once, too, and its squares would overflow: it counts as less dense.
  static HWY_INLINE Float part_of_dense(Float whole, Float first, Float change, Float& k, Float& rise) {
    const Float most = Float(1e18F) / max(whole, 1e-18F), least = Float(0.0F) - most;
    const Mask exceeds = max(k, k + rise) > most;
    rise = select(exceeds, min(k + rise, most) - min(k, most), rise);
    k = min(k, most);
    const Float a = min(first, most) * whole, b = max(min(change, most), least) * whole;
    const Float root = Float(2.0F) / (a + sqrt(max(fma(b, 2.0F, a * a), 0.0F)));
    return min(root, 1.0F);
  }

  // Returns the colour that a step sends to its begin, from `x` behind the piece's start: by two points of Gauss, or
  // three where it is dense.
  template <bool factored>
  [[nodiscard]] HWY_INLINE std::array<Float, 3> emission(Mask todo, Int piece, Float x, const Step<factored>& step,
                                                         Float depth) const {
    const Mask is_thin = depth <= Float(0.02F);
    const std::array<Float, 3> color = {values_[0].at(piece), values_[1].at(piece), values_[2].at(piece)};
    const std::array<Float, 3> color_slope = {slopes_[0].at(piece), slopes_[1].at(piece), slopes_[2].at(piece)};
    const auto add_point = [&](float at, float weight, bool thin, std::array<Float, 3>& to_sum) HWY_ATTR {
      const Float before = step.depth_at(at);
      const Float through = thin ? fma(before, fma(before, 0.5F, -1.0F), 1.0F) : Float(1.0F) - opacity(before);
      const Float share = step.extinction_at(at) * through * weight, place = fma(step.reach, at, x);
      for (std::size_t c = 0; c < 3; ++c) to_sum[c] = fma(share, fma(color_slope[c], place, color[c]), to_sum[c]);
    };
    std::array<Float, 3> sum = {Float(0.0F), Float(0.0F), Float(0.0F)};
    if (any(both(is_thin, todo))) {
      add_point(0.2113248654F, 0.5F, true, sum);
      add_point(0.7886751346F, 0.5F, true, sum);
    }
    if (any(hn::AndNot(is_thin, todo))) {
      std::array<Float, 3> fine = {Float(0.0F), Float(0.0F), Float(0.0F)};
      add_point(0.1127016654F, 0.2777777778F, false, fine);
      add_point(0.5F, 0.4444444444F, false, fine);
      add_point(0.8872983346F, 0.2777777778F, false, fine);
      for (std::size_t c = 0; c < 3; ++c) sum[c] = select(is_thin, sum[c], fine[c]);
    }
    return sum;
  }

  HWY_INLINE void add_peak(Mask crossed, Int peak, Float per_u, Float lighting, Light& light) const {
    const Float depth = gather(function_.peaks.data(), peak) * per_u;
    const Float alpha = only(crossed, opacity(depth) * light.transmittance);
    for (std::size_t c = 0; c < 3; ++c)
      light.color[c] = fma(alpha * lighting, gather(function_.peak_colors[c].data(), peak), light.color[c]);
    light.transmittance = light.transmittance - alpha;
  }

  const FunctionPieces& function_;
  Lookup<few> starts_;
  std::array<Lookup<few>, 4> values_, slopes_;
};

HWY_INLINE Float segment_part(const CellSegment* segments, Int place, int part) {
  return gather(reinterpret_cast<const float*>(segments) + part, place);
}

/// Lets a surface's light cover what is behind it.
HWY_INLINE void add_surface(Mask met, const std::array<Float, 3>& color, Float opacity, Light& light) {
  const Float front = only(met, light.transmittance);
  for (std::size_t c = 0; c < 3; ++c) light.color[c] = fma(front, color[c], light.color[c]);
  light.transmittance = fnma(front, opacity, light.transmittance);
}

/// Returns a function's colour.
HWY_INLINE std::array<Float, 3> color_at(const FunctionPieces& function, Float u) {
  const Int piece = piece_in(function, u, u >= u);
  const Float x = u - gather(function.starts.data(), piece);
  std::array<Float, 3> color;
  for (std::size_t c = 0; c < 3; ++c)
    color[c] = fma(gather(function.slopes[c].data(), piece), x, gather(function.values[c].data(), piece));
  return color;
}

/// Blends the segments of pixels side by side, and the layers between them.
template <bool few, bool has_shades>
class PixelBlender {
 public:
  PixelBlender(const CellFrame& frame, const CellTileArea& area, TileSegments& tile, CellTileLight& light)
      : frame_(frame), area_(area), tile_(tile), light_(light), integrator_(*frame.function) {}

  // `first`: pixel. Returns whether more can be seen.
  HWY_INLINE bool blend(std::size_t first, float end) {
    const Int count = load(tile_.counts.data() + first);
    const std::int32_t most = hn::GetLane(hn::MaxOfLanes(IntTag(), count.v));
    const Float transmittance = load(light_.transmittance.data() + first);
    const bool has_layers = frame_.layers > 0, has_events = frame_.events;
    if (most == 0 && !has_layers) return is_open(first, end, transmittance);
    const Int before_end = sort(first, count, most, end);
    Light light{{load(light_.color[0].data() + first), load(light_.color[1].data() + first),
                 load(light_.color[2].data() + first)},
                transmittance};
    Int layers = load(light_.layers.data() + first);
    const Float stretch = stretch_of(first);
    const std::int32_t ends = hn::GetLane(hn::MaxOfLanes(IntTag(), before_end.v));
    for (std::int32_t k = 0; k < ends; ++k) {
      Mask todo = both(mask_of(hn::Gt(before_end.v, Int(k).v)), light.transmittance > Float(0.0F));
      if (!any(todo)) continue;
      if (has_layers) add_layers(first, todo, load(row_at(k).keys.data()), layers, light);
      const Int place = load(row_at(k).places.data());
      if (has_events) {
        const Mask is_event = segment_part(tile_.segments.data(), place, 1) < Float(0.0F), met = both(todo, is_event);
        if (any(met)) add_events(first, met, place, light);
        todo = hn::AndNot(is_event, todo);
        if (!any(todo)) continue;
      }
      const CellSegment* const all = tile_.segments.data();
      const Float u = segment_part(all, place, 2), end_u = segment_part(all, place, 3);
      const Float length = segment_part(all, place, 1) * stretch;
      if constexpr (has_shades) {
        const auto shade = [&](int part) HWY_ATTR {
          return gather(reinterpret_cast<const float*>(tile_.shades.data()) + part, place);
        };
        if (frame_.opacity)
          integrator_.add_with_opacity(todo, u, end_u, shade(1), shade(2), length, shade(0), *frame_.opacity, light);
        else
          integrator_.template add<false>(todo, u, end_u, length, {shade(0), 1.0F, 1.0F}, light);
      } else {
        integrator_.template add<false>(todo, u, end_u, length, {1.0F, 1.0F, 1.0F}, light);
      }
      light.transmittance = only(light.transmittance > Float(closed), light.transmittance);
    }
    if (has_layers) {
      add_layers(first, light.transmittance > Float(0.0F), end, layers, light);
      store(layers, light_.layers.data() + first);
    }
    store(light.transmittance, light_.transmittance.data() + first);
    for (std::size_t c = 0; c < 3; ++c) store(light.color[c], light_.color[c].data() + first);
    keep_rest(first, count, before_end);
    return is_open(first, end, light.transmittance);
  }

 private:
  [[nodiscard]] HWY_INLINE TileSegments::Row& row_at(std::int32_t k) { return tile_.rows[static_cast<std::size_t>(k)]; }

  // Whether more than what is before `end` can be seen.
  [[nodiscard]] HWY_INLINE bool is_open(std::size_t first, float end, Float transmittance) const {
    const Mask open = transmittance > Float(0.0F);
    if (!frame_.has_limits()) return any(open);
    return any(both(open, load(tile_.end_keys.data() + first) > Float(end)));
  }

  // Adds the layers that are not behind `key`. Most pictures have none: their light stays in registers.
  HWY_INLINE void add_layers(std::size_t first, Mask todo, Float key, Int& layers, Light& light) const {
    Light with = light;
    Int blended = layers;
    add_some_layers(first, todo, key, blended, with);
    light = with;
    layers = blended;
  }
  HWY_NOINLINE void add_some_layers(std::size_t first, Mask todo, Float key, Int& layers, Light& light) const {
    constexpr int part = cell_tile_pixels, layer = sizeof(CellTileLayer) / sizeof(float);
    const float* const numbers = reinterpret_cast<const float*>(tile_.layers.data());
    for (;;) {
      const Int place = layers * Int(layer) + (lane_indices() + Int(static_cast<std::int32_t>(first)));
      const Mask met = both(todo, gather(numbers, place) <= key);
      if (!any(met)) return;
      const auto number = [&](int i) HWY_ATTR { return gather(numbers, place + Int(i * part)); };
      add_surface(met, {number(1), number(2), number(3)}, number(4), light);
      light.transmittance = only(light.transmittance > Float(closed), light.transmittance);
      layers = layers + select_int(met, Int(1), Int(0));
    }
  }

  // Adds contours and slices.
  HWY_INLINE void add_events(std::size_t first, Mask met, Int place, Light& light) {
    Light with = light;
    add_some_events(first, met, place, with);
    light = with;
  }
  HWY_NOINLINE void add_some_events(std::size_t first, Mask met, Int place, Light& light) {
    const CellEvents& events = *frame_.events;
    const CellSegment* const all = tile_.segments.data();
    const Int contours(events.contours()), number = truncate(-segment_part(all, place, 1)) - Int(1);
    const Mask rises = mask_of(hn::Lt(number.v, contours.v));
    const Int event = min(max(select_int(rises, contours - Int(1) - number, number - contours), Int(0)),
                          Int(static_cast<std::int32_t>(events.opacities.size()) - 1));
    met = hn::AndNot(add_to_slices(first, both(met, hn::Not(mask_of(hn::Lt(event.v, contours.v)))), event - contours),
                     met);
    const Float value = segment_part(all, place, 2), factor = segment_part(all, place, 3);
    const Int coloring(hn::GatherIndex(IntTag(), events.colorings.data(), event.v));
    std::array<Float, 3> color;
    for (std::size_t c = 0; c < 3; ++c) color[c] = gather(events.colors[c].data(), event);
    const auto take = [&](CellEvents::Coloring kind, const FunctionPieces* function) HWY_ATTR {
      const Mask is_kind = both(met, mask_of(hn::Eq(coloring.v, Int(static_cast<int>(kind)).v)));
      if (!any(is_kind)) return;
      const Mask is_missing = both(is_kind, value >= Float(FunctionPieces::outside));
      const std::array<Float, 3> by_function = color_at(*function, only(hn::AndNot(is_missing, is_kind), value));
      for (std::size_t c = 0; c < 3; ++c) color[c] = select(is_kind, by_function[c], color[c]);
      met = hn::AndNot(is_missing, met);
    };
    take(CellEvents::Coloring::by_attribute, frame_.contour_colors);
    take(CellEvents::Coloring::by_value, frame_.function);
    const Float opacity = gather(events.opacities.data(), event);
    for (Float& channel : color) channel = channel * (factor * opacity);
    add_surface(met, color, opacity, light);
    light.transmittance = only(light.transmittance > Float(closed), light.transmittance);
  }

  // Takes note of slices. Returns which had been met before: a place on a face is in both of its cells.
  HWY_INLINE Mask add_to_slices(std::size_t first, Mask met, Int slice) {
    Mask again = hn::FirstN(FloatTag(), 0);
    if (!any(met)) return again;
    const Int bit(hn::Shl(Int(1).v, (slice & Int(31)).v));
    for (int word = 0; word < 2; ++word) {
      std::int32_t* const bits = light_.slices[static_cast<std::size_t>(word)].data() + first;
      const Mask here = both(met, mask_of(hn::Eq(shift_right<5>(slice).v, Int(word).v)));
      const Int before = load(bits);
      again = either(again, hn::AndNot(is_zero(before & bit), here));
      store(before | select_int(here, bit, Int(0)), bits);
    }
    return again;
  }

  // Sorts, and returns how many are before `end`. Few segments are sorted by insertion, all lanes at once: they are
  // nearly sorted. Those with one key stay in the order of chunks, and of the cells of each.
  HWY_INLINE Int sort(std::size_t first, Int count, std::int32_t most, float end) {
    constexpr std::int32_t few_segments = 1024;
    // Rows are inserted by two.
    if (static_cast<std::size_t>(most) + 1 > tile_.rows.size()) tile_.rows.resize(static_cast<std::size_t>(most) + 1);
    return most > few_segments ? sort_many(first, count, most, end) : insert_all(first, count, most, end);
  }

  Int sort_many(std::size_t first, Int count, std::int32_t most, float end) {
    alignas(64) std::array<std::int32_t, most_lanes> counts, before_end{};
    store(count, counts.data());
    for (std::size_t lane = 0; lane < static_cast<std::size_t>(lane_count()); ++lane) {
      numbers_.resize(static_cast<std::size_t>(counts[lane]));
      if (!numbers_.empty()) std::iota(numbers_.begin(), numbers_.end(), tile_.begin_of(first + lane));
      std::ranges::sort(numbers_, [&](std::size_t a, std::size_t b) {
        const float key = tile_.segments[a].key, other = tile_.segments[b].key;
        return key != other ? key < other : is_before(a, b) || (!is_before(b, a) && a < b);
      });
      for (std::size_t k = 0; k < static_cast<std::size_t>(most); ++k) {
        const bool in = k < numbers_.size();
        const float key = in ? tile_.segments[numbers_[k]].key : 3e38F;
        tile_.rows[k].keys[lane] = key;
        tile_.rows[k].places[lane] = in ? static_cast<std::int32_t>(4 * numbers_[k]) : 0;
        before_end[lane] += key < end ? 1 : 0;
      }
    }
    return load(before_end.data());
  }

  HWY_INLINE Int insert_all(std::size_t first, Int count, std::int32_t most, float end) {
    const Int pixel = lane_indices() + Int(static_cast<std::int32_t>(first) - static_cast<int>(tile_.first_pixel));
    const Int start = pixel * Int(4 * tile_.room);
    Int before_end(0);
    TileSegments::Row* const rows = tile_.rows.data();
    const auto put = [&](std::int32_t k, Float key, Int place) HWY_ATTR {
      store(key, rows[k].keys.data());
      store(place, rows[k].places.data());
    };
    for (std::int32_t k = 0; k < most; k += 2) {
      const auto take = [&](std::int32_t number, Float& key, Int& place) HWY_ATTR {
        const Mask in = mask_of(hn::Gt(count.v, Int(number).v));
        place = select_int(in, start + Int(4 * number), Int(0));
        key = select(in, segment_part(tile_.segments.data(), place, 0), 3e38F);
        before_end = before_end + select_int(key < Float(end), Int(1), Int(0));
      };
      Float key, next_key;
      Int place, next_place;
      take(k, key, place);
      take(k + 1, next_key, next_place);
      const Mask turned = key > next_key;
      const Float lower = min(key, next_key);
      next_key = max(key, next_key);
      key = lower;
      const Int place_of_lower = select_int(turned, next_place, place);
      next_place = select_int(turned, place, next_place);
      place = place_of_lower;
      std::int32_t j = k;
      for (; j > 0; --j) {
        const Float before = load(rows[j - 1].keys.data());
        const Mask later = before > key, last = before > next_key;
        if (!any(later)) break;
        const Int place_before = load(rows[j - 1].places.data());
        put(j + 1, max(before, next_key), select_int(last, place_before, next_place));
        next_place = select_int(last, next_place, select_int(later, place_before, place));
        next_key = max(key, min(before, next_key));
        place = select_int(later, place, place_before);
        key = min(key, before);
      }
      put(j, key, place);
      put(j + 1, next_key, next_place);
    }
    if (frame_.events) order_ties(count);
    return before_end;
  }

  // What rays meet comes before segments with its key, in its own order. Segments keep theirs.
  void order_ties(Int count) {
    alignas(64) std::array<std::int32_t, most_lanes> counts;
    store(count, counts.data());
    const auto lanes = static_cast<std::size_t>(lane_count());
    for (std::size_t lane = 0; lane < lanes; ++lane)
      for (std::int32_t k = 1; k < counts[lane]; ++k)
        for (std::int32_t j = k; j > 0 && row_at(j).keys[lane] == row_at(j - 1).keys[lane] &&
                                 is_before(number_at(lane, j), number_at(lane, j - 1));
             --j)
          std::swap(row_at(j).places[lane], row_at(j - 1).places[lane]);
  }
  [[nodiscard]] bool is_before(std::size_t a, std::size_t b) const {
    return std::min(tile_.segments[a].length, 0.0F) < std::min(tile_.segments[b].length, 0.0F);
  }

  [[nodiscard]] std::size_t number_at(std::size_t lane, std::int32_t k) const {
    return static_cast<std::size_t>(tile_.rows[static_cast<std::size_t>(k)].places[lane] / 4);
  }

  // The length of rays for a unit of depth.
  [[nodiscard]] HWY_INLINE Float stretch_of(std::size_t first) const {
    const View& view = *frame_.view;
    if (view.orthographic) return 1.0F;
    const auto per_pixel = static_cast<float>(1 / view.focal);
    const auto row = static_cast<int>(first) / cell_tile_side, column = static_cast<int>(first) % cell_tile_side;
    const auto y = static_cast<float>(area_.bottom + row - frame_.middle_y) * per_pixel;
    const Float x = (lane_numbers() + static_cast<float>(area_.left + column - frame_.middle_x)) * per_pixel;
    return sqrt(fma(x, x, 1 + y * y));
  }

  void keep_rest(std::size_t first, Int count, Int blended) {
    const Int rest = count - blended;
    store(rest, tile_.counts.data() + first);
    if (hn::GetLane(hn::MaxOfLanes(IntTag(), rest.v)) == 0) return;
    alignas(64) std::array<std::int32_t, most_lanes> done, left;
    store(blended, done.data());
    store(rest, left.data());
    for (std::size_t lane = 0; lane < static_cast<std::size_t>(lane_count()); ++lane) {
      if (left[lane] == 0) continue;
      const auto keep = [&](auto& all, auto& kept) {
        kept.clear();
        for (std::int32_t k = 0; k < left[lane]; ++k) kept.push_back(all[number_at(lane, done[lane] + k)]);
        std::ranges::copy(kept, all.begin() + static_cast<std::ptrdiff_t>(tile_.begin_of(first + lane)));
      };
      keep(tile_.segments, kept_);
      if (has_shades) keep(tile_.shades, kept_shades_);
    }
  }

  const CellFrame& frame_;
  const CellTileArea& area_;
  TileSegments& tile_;
  CellTileLight& light_;
  Integrator<few> integrator_;
  std::vector<std::size_t> numbers_;
  std::vector<CellSegment> kept_;
  std::vector<SegmentShade> kept_shades_;
};

template <bool few, bool has_shades>
bool blend_all(const CellFrame& frame, const CellTileArea& area, float end, TileSegments& tile, CellTileLight& light) {
  PixelBlender<few, has_shades> blender(frame, area, tile, light);
  bool is_open = false;
  const auto lanes = static_cast<std::size_t>(lane_count());
  for (std::size_t first = area.first_pixel() / lanes * lanes; first <= area.last_pixel(); first += lanes)
    is_open |= blender.blend(first, end);
  return is_open;
}
bool blend(const CellFrame& frame, const CellTileArea& area, float end, TileSegments& tile, CellTileLight& light) {
  const bool few = frame.function->fit_registers(), has_shades = frame.has_shades();
  if (few && !has_shades) return blend_all<true, false>(frame, area, end, tile, light);
  if (few) return blend_all<true, true>(frame, area, end, tile, light);
  if (!has_shades) return blend_all<false, false>(frame, area, end, tile, light);
  return blend_all<false, true>(frame, area, end, tile, light);
}

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace splatvol::tiles {

HWY_EXPORT(add_cells);
HWY_EXPORT(blend);

void add_segments(const CellFrame& frame, const CellsOnScreen& screen, std::span<const std::uint32_t> numbers,
                  const CellTileArea& area, float first_key, TileSegments& tile) {
  HWY_DYNAMIC_DISPATCH(add_cells)(frame, screen, numbers, area, first_key, tile);
}

bool blend_segments(const CellFrame& frame, const CellTileArea& area, float end, TileSegments& tile,
                    CellTileLight& light) {
  return HWY_DYNAMIC_DISPATCH(blend)(frame, area, end, tile, light);
}

}  // namespace splatvol::tiles

#endif
