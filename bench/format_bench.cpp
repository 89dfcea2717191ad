// Packing and unpacking of chunks: bytes of points in memory in a second, by kind of column.
#include <benchmark/benchmark.h>

#include <cmath>
#include <random>

#include "format/columns.h"

namespace splatvol::format {
namespace {

constexpr std::size_t points = 4096;

// A group like the builder's: points of a smooth field, near one another.
std::vector<dvec3> positions() {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<dvec3> result(points);
  for (dvec3& p : result) p = {5 + uniform(random), uniform(random), -3 + uniform(random)};
  return result;
}

std::vector<float> values() {
  std::vector<float> result;
  for (const dvec3& p : positions())
    result.push_back(static_cast<float>(std::sin(3 * p.x) * std::cos(2 * p.y) + 0.1 * p.z));
  return result;
}

std::vector<std::uint8_t> small_numbers(unsigned below) {
  std::mt19937 random(2);
  std::vector<std::uint8_t> result(points);
  for (std::uint8_t& number : result) number = static_cast<std::uint8_t>(1 + random() % below);
  return result;
}

std::vector<SplatShape> shapes() {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<SplatShape> result(points);
  for (SplatShape& s : result) {
    s.deviations = std::exp(0.3 * uniform(random)) * dvec3(1, 0.5, 0.2);
    s.mass = (40 + uniform(random)) * s.deviations.x * s.deviations.y * s.deviations.z;
    s.orientation = glm::normalize(glm::dquat(1, 0.2 * uniform(random), 0.2 * uniform(random), 0.2 * uniform(random)));
  }
  return result;
}

std::vector<SplatValue> splat_values() {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<SplatValue> result;
  for (const float value : values()) {
    const dvec3 correlation = 0.5 * dvec3(uniform(random), uniform(random), uniform(random));
    result.push_back({double{value}, 0.05 * (2 + uniform(random)), correlation,
                      std::sqrt(1 - glm::dot(correlation, correlation)), 1});
  }
  return result;
}

void report(benchmark::State& state, const PackedChunk& chunk, std::size_t bytes_per_point) {
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * points * bytes_per_point));
  state.counters["bytes/point"] = static_cast<double>(chunk.bytes.size()) / points;
}

template <class Pack>
void pack_column(benchmark::State& state, std::size_t bytes_per_point, Pack pack) {
  PackedChunk chunk;
  for ([[maybe_unused]] auto iteration : state) benchmark::DoNotOptimize(chunk = pack());
  report(state, chunk, bytes_per_point);
}

template <class Unpack>
void unpack_column(benchmark::State& state, std::size_t bytes_per_point, const PackedChunk& chunk, Unpack unpack) {
  for ([[maybe_unused]] auto iteration : state)
    if (!unpack(chunk)) return state.SkipWithError("refused");
  report(state, chunk, bytes_per_point);
}

// A cube that all numbers fit into.
constexpr double edge = 1e3;
const Cube cube{dvec3(-edge / 2), edge};

// The argument e sets the error to 2^-e of the group's extent; 0: exact.
double error_of(const benchmark::State& state) {
  return state.range(0) == 0 ? 0 : std::ldexp(1, -static_cast<int>(state.range(0)));
}

void pack_position(benchmark::State& state) {
  const auto in = positions();
  pack_column(state, sizeof(dvec3), [&] { return pack_positions(in, error_of(state)); });
}

void unpack_position(benchmark::State& state) {
  std::vector<dvec3> out(points);
  unpack_column(state, sizeof(dvec3), pack_positions(positions(), error_of(state)), [&](const PackedChunk& chunk) {
    return unpack_positions(chunk.entry, chunk.bytes, out, cube, "bench");
  });
}

void pack_value(benchmark::State& state) {
  const auto in = values();
  pack_column(state, sizeof(float), [&] { return pack_values(in, 1e-3, {-2, 2}); });
}

void unpack_value(benchmark::State& state) {
  std::vector<float> out(points);
  unpack_column(state, sizeof(float), pack_values(values(), 1e-3, {-2, 2}),
                [&](const PackedChunk& chunk) { return unpack_values(chunk.entry, chunk.bytes, out, "bench"); });
}

void pack_octant(benchmark::State& state) {
  const auto depths = small_numbers(4), counts = small_numbers(8);
  pack_column(state, 2, [&] { return pack_octants(depths, counts); });
}

void unpack_octant(benchmark::State& state) {
  std::vector<std::uint8_t> depths(points), counts(points);
  unpack_column(state, 2, pack_octants(small_numbers(4), small_numbers(8)), [&](const PackedChunk& chunk) {
    return unpack_octants(chunk.entry, chunk.bytes, depths, counts, "bench");
  });
}

void pack_shape(benchmark::State& state) {
  const auto in = shapes();
  pack_column(state, sizeof(SplatShape), [&] { return pack_moments(in, edge); });
}

void unpack_shape(benchmark::State& state) {
  std::vector<SplatShape> out(points);
  unpack_column(state, sizeof(SplatShape), pack_moments(shapes(), edge),
                [&](const PackedChunk& chunk) { return unpack_moments(chunk.entry, chunk.bytes, out, edge, "bench"); });
}

constexpr ValueSummary any_value{-2, 2, ~std::uint64_t{0}};

void pack_splat_value(benchmark::State& state) {
  const auto in = splat_values();
  pack_column(state, sizeof(SplatValue), [&] { return pack_value_moments(in, 1e-3, any_value); });
}

void unpack_splat_value(benchmark::State& state) {
  std::vector<SplatValue> out(points);
  unpack_column(state, sizeof(SplatValue), pack_value_moments(splat_values(), 1e-3, any_value),
                [&](const PackedChunk& chunk) { return unpack_value_moments(chunk.entry, chunk.bytes, out, "bench"); });
}

BENCHMARK(pack_position)->ArgName("error")->Arg(10)->Arg(20)->Arg(0);
BENCHMARK(unpack_position)->ArgName("error")->Arg(10)->Arg(20)->Arg(0);
BENCHMARK(pack_value);
BENCHMARK(unpack_value);
BENCHMARK(pack_octant);
BENCHMARK(unpack_octant);
BENCHMARK(pack_shape);
BENCHMARK(unpack_shape);
BENCHMARK(pack_splat_value);
BENCHMARK(unpack_splat_value);

}  // namespace
}  // namespace splatvol::format

BENCHMARK_MAIN();
