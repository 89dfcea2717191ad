// A channel of a pixel in each lane.
#include "renderer/cpu/srgb_bytes.h"

#include <algorithm>
#include <array>
#include <cstddef>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/cpu/srgb_bytes.cpp"
#include "base/parallel.h"
#include "renderer/cpu/targets.h"
// The order matters: this includes the file again, once for each instruction set.
#include <hwy/foreach_target.h>

#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

// srgb_of for numbers of [0, 1]. The power is a polynomial of the fourth root.
HWY_INLINE Float srgb_of(Float linear) {
  const Float t = sqrt(sqrt(linear));
  Float curve = fma(t, -0.0681472859F, 0.289532928F);
  curve = fma(t, curve, -0.577482617F);
  curve = fma(t, curve, 1.25540433F);
  curve = fma(t, curve, 0.162026292F);
  curve = fma(t, curve, -0.0613402194F);
  return select(linear > Float(0.0031308F), curve, linear * 12.92F);
}

// Encodes pixels of four channels. `background` has an alpha of 1.
HWY_INLINE Float encoded(Float pixels, Float background) {
  const Float alpha = hn::Broadcast<3>(pixels.v);
  return srgb_of(clamp(fma(Float(1.0F) - alpha, background, pixels), 0.0F, 1.0F));
}

void encode(const float* pixels, std::size_t count, const std::array<float, 4>& background, std::uint8_t* bytes) {
  const hn::Rebind<std::uint8_t, FloatTag> bytes_tag;
  const auto lanes = static_cast<std::size_t>(lane_count());
  const Float behind = hn::LoadDup128(FloatTag(), background.data());
  const auto encode_lanes = [&](const float* from, std::uint8_t* to) {
    hn::StoreU(hn::DemoteTo(bytes_tag, nearest(encoded(load(from), behind) * 255.0F).v), bytes_tag, to);
  };
  std::size_t i = 0;
  for (; i + lanes <= 4 * count; i += lanes) encode_lanes(pixels + i, bytes + i);
  if (i == 4 * count) return;
  std::array<float, most_lanes> last{};
  std::array<std::uint8_t, most_lanes> last_bytes{};
  std::copy(pixels + i, pixels + 4 * count, last.begin());
  encode_lanes(last.data(), last_bytes.data());
  std::copy_n(last_bytes.begin(), 4 * count - i, bytes + i);
}

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatvol {
namespace tiles {
HWY_EXPORT(encode);
}

void encode_srgb(const Image& image, dvec3 background, std::vector<std::uint8_t>& bytes) {
  constexpr std::size_t pixels_per_task = std::size_t{1} << 15;
  static_assert(sizeof(vec4) == 4 * sizeof(float));
  bytes.resize(4 * image.pixels.size());
  const std::array<float, 4> behind{static_cast<float>(background.r), static_cast<float>(background.g),
                                    static_cast<float>(background.b), 1.0F};
  parallel_for_ranges(0, image.pixels.size(), pixels_per_task, [&](std::size_t first, std::size_t last) {
    using namespace tiles;
    HWY_DYNAMIC_DISPATCH(encode)(&image.pixels[first].x, last - first, behind, &bytes[4 * first]);
  });
}

}  // namespace splatvol
#endif
