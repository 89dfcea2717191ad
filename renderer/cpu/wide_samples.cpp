#include "renderer/cpu/wide_samples.h"

#include <algorithm>
#include <cstddef>

#include "base/parallel.h"
#include "renderer/cpu/samples.h"
#include "renderer/sampled_view.h"

namespace splatvol {
namespace {

/// The pixels of an axis that stand for samples.
struct SampledPixels {
  int count;    // of samples; the first and the last one lie beyond the ends
  int first;    // pixel of the first one
  float shift;  // pixels by which these lie before the samples

  SampledPixels(int pixels, int spacing) : count(sample_count(pixels, spacing)) {
    const int doubled = (1 - count) * spacing + pixels - 1;  // twice the place of the first sample
    shift = doubled % 2 == 0 ? 0 : 0.5F;
    first = (doubled - (doubled % 2 == 0 ? 0 : 1)) / 2;
  }
};

/// Goes on by the difference of two samples, between black and white.
vec4 go_on(const vec4& last, const vec4& before) {
  const vec4 next = glm::clamp(2.0F * last - before, 0.0F, 1.0F);
  return {glm::min(vec3(next), vec3(next.a)), next.a};
}

/// Sets the samples beyond both ends of an axis. `at`: the sample of a number.
template <class At>
void extend(int count, const At& at) {
  const bool is_one = count == 3;
  at(0) = is_one ? at(1) : go_on(at(1), at(2));
  at(count - 1) = is_one ? at(1) : go_on(at(count - 2), at(count - 3));
}

Image samples_of(const Image& exact, const SampledPixels& across, const SampledPixels& down, int spacing) {
  Image samples{across.count, down.count, {}};
  samples.pixels.resize(static_cast<std::size_t>(samples.width) * static_cast<std::size_t>(samples.height));
  parallel_for(1, down.count - 1, [&](int y) {
    for (int x = 1; x < across.count - 1; ++x)
      samples.at(x, y) = exact.at(across.first + x * spacing, down.first + y * spacing);
    extend(across.count, [&](int x) -> vec4& { return samples.at(x, y); });
  });
  for (int x = 0; x < across.count; ++x) extend(down.count, [&](int y) -> vec4& { return samples.at(x, y); });
  return samples;
}

}  // namespace

Image with_wide_samples(const Image& exact, int spacing, float refined_difference, Image memory) {
  memory.width = exact.width;
  memory.height = exact.height;
  if (spacing <= 1 || exact.pixels.empty()) {
    memory.pixels = exact.pixels;
    return memory;
  }
  memory.pixels.resize(exact.pixels.size());
  const SampledPixels across(exact.width, spacing), down(exact.height, spacing);
  const tiles::SampleShift shift{across.shift, down.shift};
  const Image samples = samples_of(exact, across, down, spacing);
  Image rows;
  tiles::interpolate(samples, spacing, rows, memory, shift);
  if (refined_difference <= 0) return memory;
  const tiles::DifferingBlocks blocks(samples, spacing, shift, exact.width, exact.height, refined_difference);
  parallel_for(0, exact.height, [&](int y) {
    for (int x = 0; x < exact.width; ++x)
      if (blocks.has(x, y)) memory.at(x, y) = exact.at(x, y);
  });
  return memory;
}

}  // namespace splatvol
