// Material of scattered points: the time for each point, by kind of estimate.
#include <benchmark/benchmark.h>

#include <cmath>
#include <random>

#include "builder/scattered/box_estimate.h"
#include "builder/scattered/sampled_cells.h"
#include "builder/scattered/scattered.h"

namespace splatvol {
namespace {

// `count` random points in a cube of edge 1.
std::vector<dvec3> random_points(std::size_t count) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit;
  std::vector<dvec3> points(count);
  for (dvec3& p : points) p = {unit(random), unit(random), unit(random)};
  return points;
}

std::vector<double> values_at(std::span<const dvec3> points) {
  std::vector<double> values;
  for (const dvec3& p : points) values.push_back(std::sin(3 * p.x) + p.y * p.z);
  return values;
}

// 10^7 points by estimate nodes of a given number of points. The nodes differ, so that the processor cannot learn
// branches by heart.
void box_estimate(benchmark::State& state) {
  const auto node_points = static_cast<std::size_t>(state.range(0));
  constexpr std::size_t total = 10'000'000;
  const auto points = random_points(total);
  const auto values = values_at(points);
  BoxEstimate estimate;
  std::vector<SpatialMoments> moments(node_points);
  std::vector<ValueMoments> value_moments(node_points);
  std::vector<dvec3> gradients(node_points);
  const EstimatedMaterial material{moments, {value_moments}, {gradients}};
  for (auto run : state)
    for (std::size_t begin = 0; begin + node_points <= total; begin += node_points) {
      const std::span<const double> part = std::span(values).subspan(begin, node_points);
      estimate.estimate(std::span(points).subspan(begin, node_points), {&part, 1}, {dvec3(0), dvec3(1)}, material);
      benchmark::DoNotOptimize(material.moments.data());
    }
  state.counters["points"] = benchmark::Counter(static_cast<double>(total / node_points * node_points),
                                                benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(box_estimate)->Arg(64)->Arg(512)->Arg(4096)->Unit(benchmark::kMillisecond);

// The points of two subdomains, at once.
void sampled_cells(benchmark::State& state) {
  const auto points = random_points(std::size_t{1} << 16);
  const auto values = values_at(points);
  SampledCells cells;
  for (auto run : state) {
    cells.find(points, points.size(), 0);
    for (std::size_t i = 0; i < points.size(); ++i) benchmark::DoNotOptimize(cells.value(i, values));
  }
  state.counters["points"] =
      benchmark::Counter(static_cast<double>(points.size()), benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(sampled_cells)->Unit(benchmark::kMillisecond);

void voronoi_cells(benchmark::State& state) {
  const auto points = random_points(20'000);
  const auto values = values_at(points);
  for (auto run : state) {
    const auto estimate = ScatteredEstimate::create(points);
    benchmark::DoNotOptimize(estimate->values(values).data());
  }
  state.counters["points"] =
      benchmark::Counter(static_cast<double>(points.size()), benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(voronoi_cells)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace splatvol

BENCHMARK_MAIN();
