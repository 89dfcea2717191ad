// Material of scattered points: the time for each point, by kind of estimate.
#include <benchmark/benchmark.h>

#include <cmath>
#include <random>

#include "builder/scattered/cell_estimate.h"
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

// The points of one subdomain.
void cell_estimate(benchmark::State& state) {
  const auto points = random_points(std::size_t{1} << 15);
  const auto values = values_at(points);
  CellEstimate estimate;
  for (auto run : state) {
    estimate.find(points, 0, {dvec3(0), dvec3(1)}, nullptr);
    for (std::size_t i = 0; i < points.size(); ++i) benchmark::DoNotOptimize(estimate.value(i, {values, {}}));
  }
  state.counters["points"] =
      benchmark::Counter(static_cast<double>(points.size()), benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(cell_estimate)->Unit(benchmark::kMillisecond);

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
