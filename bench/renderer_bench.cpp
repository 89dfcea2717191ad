// Frames of random splats: the time of drawing and sorting, by number and size of the splats on the screen.
#include <benchmark/benchmark.h>

#include <cmath>
#include <random>
#include <type_traits>

#include "renderer/gl/context.h"
#include "renderer/gl/gl_rasterizer.h"
#include "streamer/record.h"

namespace splatvol {
namespace {

constexpr int image_size = 512;

template <class Splat>
std::vector<Splat> random_splats(std::size_t count, float size) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> coordinate(-1, 1);
  std::vector<Splat> splats(count);
  for (Splat& splat : splats) {
    const vec3 position(coordinate(generator), coordinate(generator), coordinate(generator));
    splat.value = 0.5F + 0.5F * coordinate(generator);
    if constexpr (std::is_same_v<Splat, OctantSplat>) {
      splat.position = position;
      splat.size = size;
    } else {
      splat.center = dvec3(position);
      splat.mass = std::pow(static_cast<double>(size), 3.0);
      splat.deviations = dvec3(static_cast<double>(size) / std::sqrt(12.0));
      splat.value_deviation = 0.1;
    }
  }
  return splats;
}

/// A camera on a circle round the cube [-1, 1]^3, which fills most of the picture.
View orbit(double angle) {
  Camera camera;
  camera.position = {5 * std::sin(angle), 0, 5 * std::cos(angle)};
  return make_view(camera, image_size, image_size).value();
}

/// Arguments: number of splats, their size on the screen in tenths of a pixel (the edge of the cube that a splat stands
/// for), way of sorting, whether the camera moves.
template <class Splat>
void frame(benchmark::State& state) {
  static const std::unique_ptr<HeadlessContext> context = HeadlessContext::create().value();
  const auto renderer =
      GlRasterizer::create(std::is_same_v<Splat, OctantSplat> ? KernelKind::octant : KernelKind::moments).value();
  TransferFunction function;
  function.colors = {{0, {1, 0, 0}}, {1, {0, 0, 1}}};
  function.densities = {{0, 0.5}, {1, 5}};
  const double pixel = 5 / orbit(0).focal;
  const auto splats = random_splats<Splat>(static_cast<std::size_t>(state.range(0)),
                                           static_cast<float>(static_cast<double>(state.range(1)) * 0.1 * pixel));
  DrawList list;
  append(list, pack_row(std::span<const Splat>(splats), dvec3(0), 1), 0, static_cast<std::uint32_t>(splats.size()), 1);
  if (!renderer->set_transfer_function(function, {}) || !renderer->set_draw_list(list))
    return state.SkipWithError("setup");

  const auto sort = static_cast<SortMode>(state.range(2));
  const bool moving = state.range(3) != 0;
  FrameTimes sum;
  double angle = 0;
  if (!renderer->draw(orbit(angle), sort, 1)) return state.SkipWithError("draw");
  for ([[maybe_unused]] auto iteration : state) {
    const auto times = renderer->draw(orbit(moving ? angle += 0.01 : angle), sort, 1);
    if (!times) return state.SkipWithError("draw");
    sum.sort += times->sort;
    sum.upload += times->upload;
    sum.draw += times->draw;
  }
  const auto mean = [&](double seconds) {
    return benchmark::Counter(seconds * 1e3, benchmark::Counter::kAvgIterations);
  };
  state.counters["sort_ms"] = mean(sum.sort);
  state.counters["upload_ms"] = mean(sum.upload);
  state.counters["draw_ms"] = mean(sum.draw);
}

void arguments(benchmark::internal::Benchmark* benchmark) {
  constexpr auto none = static_cast<int>(SortMode::none), axis = static_cast<int>(SortMode::axis),
                 exact = static_cast<int>(SortMode::exact);
  benchmark->ArgNames({"splats", "size_dpx", "sort", "moving"})
      ->ArgsProduct({{100'000, 1'000'000}, {12}, {none, axis, exact}, {0, 1}})
      ->ArgsProduct({{100'000}, {100}, {none, exact}, {0}})
      ->Unit(benchmark::kMillisecond)
      ->MeasureProcessCPUTime()
      ->UseRealTime();
}
BENCHMARK(frame<OctantSplat>)->Apply(arguments);
BENCHMARK(frame<Material>)->Apply(arguments);

}  // namespace
}  // namespace splatvol

BENCHMARK_MAIN();
