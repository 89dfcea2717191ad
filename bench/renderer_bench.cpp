// Frames of random splats: what drawing and sorting cost, by number and size of the splats on the screen.
#include <benchmark/benchmark.h>

#include <random>

#include "renderer/context.h"
#include "renderer/renderer.h"

namespace splatvol {
namespace {

constexpr int image_size = 512;

std::vector<OctantSplat> random_splats(std::size_t count, float size) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> coordinate(-1, 1);
  std::vector<OctantSplat> splats(count);
  for (OctantSplat& splat : splats) {
    splat.position = {coordinate(generator), coordinate(generator), coordinate(generator)};
    splat.value = 0.5F + 0.5F * coordinate(generator);
    splat.size = size;
  }
  return splats;
}

/// The camera on a circle round the cube [-1, 1]^3, which fills most of the picture.
View orbit(double angle) {
  Camera camera;
  camera.position = {5 * std::sin(angle), 0, 5 * std::cos(angle)};
  return make_view(camera, image_size, image_size).value();
}

/// Arguments: splats, size on the screen in tenths of a pixel (standard deviation), exact sort or none, moving camera.
void frame(benchmark::State& state) {
  static const std::unique_ptr<HeadlessContext> context = HeadlessContext::create().value();
  const auto renderer = Renderer::create().value();
  TransferFunction function;
  function.colors = {{0, {1, 0, 0}}, {1, {0, 0, 1}}};
  function.densities = {{0, 0.5}, {1, 5}};
  const double pixel = 5 / orbit(0).focal;
  const auto splats = random_splats(state.range(0), static_cast<float>(state.range(1) * 0.1 / 0.4 * pixel));
  const SplatBatch batch{dvec3(0), splats};
  if (!renderer->set_transfer_function(function) || !renderer->set_splats({&batch, 1}))
    return state.SkipWithError("setup");

  const SortMode sort = state.range(2) != 0 ? SortMode::exact : SortMode::none;
  const bool moving = state.range(3) != 0;
  FrameTimes sum;
  double angle = 0;
  if (!renderer->draw(orbit(angle), sort)) return state.SkipWithError("draw");
  for ([[maybe_unused]] auto iteration : state) {
    const auto times = renderer->draw(orbit(moving ? angle += 0.01 : angle), sort);
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

BENCHMARK(frame)
    ->ArgNames({"splats", "sigma_dpx", "exact", "moving"})
    ->ArgsProduct({{100'000, 1'000'000}, {5}, {0, 1}, {0, 1}})
    ->ArgsProduct({{100'000}, {40}, {0, 1}, {0}})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

}  // namespace
}  // namespace splatvol

BENCHMARK_MAIN();
