// The kernel octant: projects a splat in each lane, then blends a pixel in each lane.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "renderer/cpu/octant_kernel.h"
#include "splat/constants.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/cpu/octant.cpp"
#include "renderer/cpu/targets.h"
// The order matters: this includes the file again, once for each instruction set.
#include <hwy/foreach_target.h>

#include "renderer/cpu/blend-inl.h"
#include "renderer/cpu/projection-inl.h"
#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

using namespace drawing;

constexpr int shape_words = sizeof(OctantShape) / 4, words_of_record = shape_words + sizeof(OctantValue) / 4;

struct Records {
  alignas(64) std::array<std::array<std::int32_t, most_lanes>, words_of_record> words;
  RangesInLanes ranges;
  OpacityInLanes opacities;

  void set(int lane, const RangeInView& range, std::uint32_t index) {
    std::array<std::int32_t, words_of_record> copy;
    std::memcpy(copy.data(), &range.octants[index], sizeof(OctantShape));
    std::memcpy(&copy[shape_words], &range.octant_values[index], sizeof(OctantValue));
    for (int i = 0; i < words_of_record; ++i) words[i][lane] = copy[i];
    ranges.set(lane, range);
    opacities.set(lane, range, index);
  }
  [[nodiscard]] HWY_INLINE Int word(int i) const { return load(words[i].data()); }
  [[nodiscard]] HWY_INLINE Float number(int i) const { return bits_as_float(word(i)); }
};

HWY_INLINE Vector3 position_in_view(const FrameConstants& frame, const Records& records) {
  return unpack_position(frame, records.word(0), records.word(1), records.ranges);
}

struct Distance {
  Float key;
  Mask drawn;
};

HWY_INLINE Distance distance_to_eye(const FrameConstants& frame, const Records& records, Vector3 center) {
  const Float size = records.number(2), value = records.number(3);
  const Mask drawn = both(both(size > Float(0.0F), hn::Eq(value.v, value.v)), center.z > Float(0.0F));
  return {frame.orthographic ? center.z : max(length(center), center.z), drawn};
}

Int keys_of(const FrameConstants& frame, const Records& records, SortKey kind) {
  const Vector3 center = position_in_view(frame, records);
  if (kind == SortKey::depth) return key_of(center.z);
  const Distance distance = distance_to_eye(frame, records, center);
  const Float widened = fma(records.number(2), sigma_per_size * largest_cut, 0.0F);
  const Mask seen = hn::AndNot(is_outside(frame, center, widened), distance.drawn);
  return select_int(seen, key_of(distance.key), -1);
}

/// Returns the factor on the colour; the light is at the eye.
HWY_INLINE Float light_on(const FrameConstants& frame, const Records& records, Vector3 center, Float distance) {
  if (frame.diffuse == 0) return frame.ambient;
  const Int packed = records.word(4);
  const auto component = [](Int code) HWY_ATTR { return max(to_float(code) * (1.0F / 127), -1.0F); };
  const Vector3 gradient =
      rotate_to_view(frame, {component(signed_bits_of<0, 8>(packed)), component(signed_bits_of<8, 8>(packed)),
                             component(signed_bits_of<16, 8>(packed))});
  const Float product = frame.orthographic ? length(gradient) : length(gradient) * distance;
  const Float along = abs(frame.orthographic ? gradient.z : dot(gradient, center));
  const Float cosine = select(product > Float(0.0F), min(along / max(product, smallest_float), 1.0F), 1.0F);
  return fma(cosine, frame.diffuse, frame.ambient);
}

/// Projected splats, one in each lane.
struct Projection {
  alignas(64) std::array<std::array<float, most_lanes>, sizeof(GaussianSplat) / 4> fields;
  alignas(64) std::array<std::int32_t, most_lanes> left, bottom, right, top;
  alignas(64) std::array<std::int32_t, most_lanes> drawn;
  alignas(64) std::array<float, most_lanes> depths;
};

/// Stores the pixels whose centres lie within `cut` of `at`. Next to the eye the bounds are infinite until they are
/// clamped.
HWY_INLINE void set_edges(Float at, Float cut, Float by_pixel, float extent, std::int32_t* first, std::int32_t* end) {
  const auto pixel = [&](Float edge) HWY_ATTR {
    return max(truncate(hn::Ceil((clamp(edge * by_pixel + 0.5F * extent, 0.0F, extent) - 0.5F).v)), Int(0));
  };
  store(pixel(at - cut), first);
  store(pixel(at + cut), end);
}

void project(const FrameConstants& frame, const Records& records, Projection& result) {
  const Vector3 center = position_in_view(frame, records);
  const Distance distance = distance_to_eye(frame, records, center);
  const Float size = records.number(2);
  const Float t = clamp(axis_position(frame.axis, records.number(3)), -1.0F, 2.0F);
  const Float column = fma(t, frame.table.inner_columns(), static_cast<float>(TableView::margin));
  const Material material = gather_from(frame.table, column);
  Float extinction = material.extinction;
  if (frame.opacity.factors) extinction = extinction * opacity_factor(frame, records.opacities);
  Float alpha = opacity(min(max(extinction * size, 0.0F), 1e30F));

  // A splat too small for the raster spreads the same light over more of it.
  const Float pixel_size = max((frame.orthographic ? Float(1.0F) : center.z) * (1.0F / frame.focal), smallest_float);
  const Float by_pixel = Float(1.0F) / pixel_size;
  const Float true_sigma = size * sigma_per_size;
  const Float sigma = max(true_sigma, pixel_size * smallest_sigma);
  const Float shrunk = true_sigma / sigma;
  alpha = alpha * shrunk * shrunk;
  const Mask drawn = both(distance.drawn, alpha > Float(faintest_alpha));

  const Float log_range = natural_log(max(alpha, faintest_alpha) * (1.0F / faintest_alpha));
  const Float cut = sigma * min(sqrt(log_range + log_range), largest_cut);
  set_edges(center.x, cut, by_pixel, frame.width, result.left.data(), result.right.data());
  set_edges(center.y, cut, by_pixel, frame.height, result.bottom.data(), result.top.data());

  const Float lit = alpha * light_on(frame, records, center, distance.key);
  const Float scale = pixel_size / (sigma * half_width_per_sigma);
  const std::array<Float, sizeof(GaussianSplat) / 4> fields{fma(center.x, by_pixel, 0.5F * frame.width),
                                                            fma(center.y, by_pixel, 0.5F * frame.height),
                                                            scale,
                                                            lit * material.r,
                                                            lit * material.g,
                                                            lit * material.b,
                                                            alpha};
  for (std::size_t i = 0; i < fields.size(); ++i) store(fields[i], result.fields[i].data());
  const Mask sound = both(is_finite(fields[0] + fields[1] + scale), is_finite(lit + alpha));
  store(select_int(both(drawn, sound), 1, 0), result.drawn.data());
  store(center.z, result.depths.data());
}

/// Sets the depth of a splat that surfaces may hide in some pixels. Removes it if they hide it in all.
void compare_with_surfaces(const DepthPyramid& surfaces, float depth, PixelBounds& pixels, float& compared) {
  const DepthRange range = surfaces.range(pixels.left, pixels.bottom, pixels.right, pixels.top);
  if (depth >= range.farthest) pixels = {};
  compared = depth < range.nearest ? -1.0F : depth;
}

void write_splat(const FrameConstants& frame, const Projection& projection, int lane, const ScreenSplats& screen,
                 std::size_t slot) {
  const auto edge = [lane](const auto& edges) { return static_cast<std::uint16_t>(edges[lane]); };
  PixelBounds pixels{edge(projection.left), edge(projection.bottom), edge(projection.right), edge(projection.top)};
  if (projection.drawn[lane] == 0 || pixels.left >= pixels.right || pixels.bottom >= pixels.top) pixels = {};
  if (frame.surfaces) compare_with_surfaces(*frame.surfaces, projection.depths[lane], pixels, screen.depths[slot]);
  screen.bounds[slot] = pixels;
  screen.forms[slot] = pixels.left == pixels.right ? Form::none : Form::gaussian;
  std::array<float, sizeof(GaussianSplat) / 4> line;
  for (std::size_t i = 0; i < line.size(); ++i) line[i] = projection.fields[i][lane];
  std::memcpy(&screen.gaussians[slot], line.data(), sizeof(line));
}

void project_all(const FrameConstants& frame, const SplatNumbers& splats, std::span<const std::uint32_t> numbers,
                 const ScreenSplats& screen) {
  Records records{};
  Projection projection{};
  for_each_group(splats, numbers, records, [&](std::size_t first, std::size_t count) HWY_ATTR {
    project(frame, records, projection);
    for (std::size_t lane = 0; lane < count; ++lane)
      write_splat(frame, projection, static_cast<int>(lane), screen, first + lane);
  });
}

void keys_of_all(const FrameConstants& frame, const SplatNumbers& splats, std::uint32_t begin, SortKey kind,
                 std::span<std::uint32_t> keys) {
  Records records{};
  make_keys(splats, begin, keys, records, [&]() HWY_ATTR { return keys_of(frame, records, kind); });
}

/// Returns 2^-x. Requires x >= 0.
HWY_INLINE Float exp2_of_minus(Float x) {
  const Float y = max(-x, -100.0F);
  const Int n = nearest(y);
  const Float f = y - to_float(n);
  Float p = fma(f, 0.0013381303F, 0.0096663685F);
  p = fma(f, p, 0.05550381F);
  p = fma(f, p, 0.24022349F);
  p = fma(f, p, 0.69314718F);
  return fma(f, p, 1.0F) * bits_as_float(shift_left<23>(n + Int(127)));
}

/// `surfaces`: null, or those that hide the splat where they are not behind `depth`.
template <bool partial>
HWY_INLINE void blend_splat(const GaussianSplat& splat, const PixelBounds& bounds, const TileArea& area,
                            const DepthPyramid* surfaces, float depth, TilePixels& pixels) {
  const int lanes = lane_count();
  const int left = std::max(bounds.left - area.left, 0), right = std::min(bounds.right - area.left, area.width);
  const int bottom = std::max(bounds.bottom - area.bottom, 0), top = std::min(bounds.top - area.bottom, area.height);
  // A Gaussian is the product of one of x and one of y.
  alignas(64) std::array<float, tile_size + most_lanes> by_row, by_column;
  for (int y = bottom; y < top; y += lanes) {
    const Float away = (lane_numbers() + (static_cast<float>(area.bottom + y) + 0.5F - splat.y)) * splat.scale;
    store(exp2_of_minus(away * away) * splat.alpha, by_row.data() + y);
  }
  for (int x = left; x < right; x += lanes) {
    const Float away = (lane_numbers() + (static_cast<float>(area.left + x) + 0.5F - splat.x)) * splat.scale;
    const Mask inside = lane_numbers() < Float(static_cast<float>(right - x));
    store(only(inside, exp2_of_minus(away * away)), by_column.data() + x);
  }
  // Colours are those of the material times alpha.
  const Float by_alpha(1.0F / splat.alpha);
  const Material material{by_alpha * splat.r, by_alpha * splat.g, by_alpha * splat.b, 0.0F};
  for (int y = bottom; y < top; ++y)
    for (int x = left; x < right; x += lanes) {
      Float alpha = load(by_column.data() + x) * by_row[y];
      if constexpr (partial) alpha = only(load(surfaces->at(area.left + x, area.bottom + y)) > Float(depth), alpha);
      blend(alpha, 1.0F, material, pixels.values.data() + y * TilePixels::row_stride + x);
    }
}

bool blend_all(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
               const TileArea& area, TilePixels& pixels) {
  constexpr std::size_t splats_per_check = 64;
  for (std::size_t i = 0; i < slots.size(); ++i) {
    if (i % splats_per_check == 0 && is_opaque(area, pixels)) return true;
    const std::uint32_t slot = slots[i];
    if (screen.depths && screen.depths[slot] >= 0)
      blend_splat<true>(screen.gaussians[slot], screen.bounds[slot], area, frame.surfaces, screen.depths[slot], pixels);
    else
      blend_splat<false>(screen.gaussians[slot], screen.bounds[slot], area, nullptr, 0, pixels);
  }
  return is_opaque(area, pixels);
}

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatvol::tiles {

HWY_EXPORT(project_all);
HWY_EXPORT(keys_of_all);
HWY_EXPORT(blend_all);

void octant_keys(const FrameConstants& frame, const SplatNumbers& splats, std::uint32_t begin, SortKey kind,
                 std::span<std::uint32_t> keys) {
  HWY_DYNAMIC_DISPATCH(keys_of_all)(frame, splats, begin, kind, keys);
}

void project_octant(const FrameConstants& frame, const SplatNumbers& splats, std::span<const std::uint32_t> numbers,
                    const ScreenSplats& screen) {
  HWY_DYNAMIC_DISPATCH(project_all)(frame, splats, numbers, screen);
}

bool blend_octant(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
                  const TileArea& area, TilePixels& pixels) {
  return HWY_DYNAMIC_DISPATCH(blend_all)(frame, screen, slots, area, pixels);
}

}  // namespace splatvol::tiles
#endif
