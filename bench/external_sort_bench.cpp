// External sorting of scattered points: records in a second, and CPU time for each record.
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/sorting/external_sort.h"

namespace splatvol {
namespace {

template <class T>
struct Sample {
  T x, y, z, value;
};

constexpr Cube cube{dvec3(-1), 2};

// Random points in a cube with a smooth value. They take some 10 ns each, little against the sort.
class Samples {
 public:
  template <class T>
  void fill(std::span<Sample<T>> samples, bool clustered) {
    for (Sample<T>& s : samples) {
      const T scale = clustered && state_ % 2 == 0 ? T(1e-3) : T(1);
      s = {scale * next<T>(), scale * next<T>(), scale * next<T>(), 0};
      s.value = s.x * (1 - s.y * s.y) + s.z / 10;
    }
  }

 private:
  // SplitMix64 (Steele, Lea and Flood, 2014).
  template <class T>
  T next() {
    std::uint64_t z = state_ += 0x9E3779B97F4A7C15u;
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
    z = (z ^ z >> 27) * 0x94D049BB133111EBu;
    return static_cast<T>(static_cast<std::int64_t>(z ^ z >> 31)) * T(0.9 * 0x1p-63);
  }

  std::uint64_t state_ = 1;
};

template <class T>
void key_samples(std::span<const std::byte> records, std::span<MortonKey> keys) {
  const auto* samples = reinterpret_cast<const Sample<T>*>(records.data());
  for (std::size_t i = 0; i < keys.size(); ++i)
    keys[i] = morton_key(dvec3(samples[i].x, samples[i].y, samples[i].z), cube);
}

double seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

struct CpuTime {
  double user, system;

  static CpuTime now() {
    rusage usage{};
    ::getrusage(RUSAGE_SELF, &usage);
    return {seconds(usage.ru_utime), seconds(usage.ru_stime)};
  }
};

// Arguments: millions of records; MiB of memory; whether half of the points lie in a billionth of the volume.
template <class T>
void sort_samples(benchmark::State& state) {
  const auto count = static_cast<std::size_t>(state.range(0)) * 1'000'000;
  const std::size_t memory = static_cast<std::size_t>(state.range(1)) << 20;
  const bool clustered = state.range(2) != 0;
  std::vector<Sample<T>> pool(1 << 16);
  CpuTime spent{0, 0};
  for ([[maybe_unused]] auto iteration : state) {
    const CpuTime before = CpuTime::now();
    auto sorter = ExternalSorter::create({sizeof(Sample<T>), key_samples<T>, memory, memory, "/tmp"}).value();
    Samples samples;
    for (std::size_t added = 0; added < count; added += pool.size()) {
      samples.fill(std::span(pool), clustered);
      if (!sorter.add(std::as_bytes(std::span(pool).first(std::min(pool.size(), count - added)))))
        return state.SkipWithError("disk");
    }
    if (!sorter.finish()) return state.SkipWithError("disk");
    std::size_t read = 0;
    for (;;) {
      const auto packet = sorter.next();
      if (!packet) return state.SkipWithError("disk");
      if (packet->keys.empty()) break;
      benchmark::DoNotOptimize(packet->records.data());
      read += packet->keys.size();
    }
    if (read != count) return state.SkipWithError("records were lost");
    const CpuTime after = CpuTime::now();
    spent = {spent.user + after.user - before.user, spent.system + after.system - before.system};
  }
  const double records = static_cast<double>(count) * static_cast<double>(state.iterations());
  state.SetItemsProcessed(static_cast<std::int64_t>(records));
  state.counters["user_ns"] = 1e9 * spent.user / records;
  state.counters["system_ns"] = 1e9 * spent.system / records;
}

BENCHMARK(sort_samples<float>)
    ->ArgNames({"millions", "MiB", "clustered"})
    ->Args({20, 1000, 0})
    ->Args({20, 128, 0})
    ->Args({20, 128, 1})
    ->Args({20, 8, 0})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK(sort_samples<double>)
    ->ArgNames({"millions", "MiB", "clustered"})
    ->Args({10, 1000, 0})
    ->Args({10, 128, 0})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace splatvol

BENCHMARK_MAIN();
