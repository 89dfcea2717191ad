#include "streamer/gather.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <tuple>

namespace splatvol {

using format::ColumnKind;
using format::Group;

namespace {

// Chunks with no more than this between them are read at once. Little: it is often another attribute's chunk, and what
// a view does not need is not to be read.
constexpr std::uint64_t largest_gap = 1024;

// Enough for every processor to have chunks to decode, little beside any budget.
constexpr std::uint64_t wave_bytes = 16u << 20;
constexpr std::uint64_t run_bytes = 2u << 20;

// What decoding takes besides the decoded numbers: packed bytes, the gap before them, payload, and a coordinate's
// integers.
std::uint64_t decoding_bytes(const format::ChunkEntry& entry, std::uint32_t points) {
  return largest_gap + entry.packed_bytes + entry.unpacked_bytes + points * sizeof(std::uint64_t);
}

std::uint64_t decoded_bytes(ColumnKind kind, std::uint32_t points) {
  return points * (kind == ColumnKind::position ? sizeof(dvec3) : sizeof(float));
}

}  // namespace

// A chunk on its way in.
struct Gatherer::Chunk {
  CacheKey key;
  ColumnKind kind;
  std::uint64_t row;
  std::uint32_t points;
  format::ChunkPlace place;
  Reservation decoded;
  Reservation decoding;
  CacheData data;
};

// Groups that are loaded together.
struct Gatherer::Wave {
  std::vector<Chunk> missing;
  std::map<CacheKey, Cache::Pointer> held;  // an empty pointer where the chunk is missing
  std::uint64_t bytes = 0;
};

Gatherer::Gatherer(PagedVolume& volume, Cache& cache, int position, int value, int octant)
    : volume_(&volume), cache_(&cache), position_(position), value_(value), octant_(octant) {}

Result<Gatherer> Gatherer::create(PagedVolume& volume, Cache& cache) {
  const format::VolumeInfo& info = volume.volume().info();
  const int value = info.find_column(ColumnKind::value, volume.attribute());
  const int octant = info.find_column(ColumnKind::octant);
  const std::string& attribute = info.attributes[static_cast<std::size_t>(volume.attribute())].name;
  if (value < 0)
    return fail(ErrorCode::unsupported, "{}: no values of attribute '{}'", volume.volume().name(), attribute);
  if (octant < 0)
    return fail(ErrorCode::unsupported, "{}: no octants, which the octant kernel draws", volume.volume().name());
  return Gatherer(volume, cache, info.find_column(ColumnKind::position), value, octant);
}

Result<GatherPlan> Gatherer::plan(const Cut& cut, const ValueVisibility& visibility) {
  const format::RowLayout& rows = volume_->volume().rows();
  GatherPlan plan;
  std::map<std::uint64_t, bool> shown;  // [group]
  const auto shows = [&](std::uint64_t group, std::size_t segment) -> Result<bool> {
    const auto [entry, added] = shown.try_emplace(group, false);
    if (!added) return entry->second;
    SPLATVOL_TRY_ASSIGN(place, volume_->find_chunk(rows.row(segment, group), value_));
    return entry->second = visibility.shows(place.entry.min, place.entry.max, place.entry.occupancy);
  };

  for (std::uint32_t i = 0; i < cut.items.size(); ++i) {
    const CutItem& item = cut.items[i];
    const auto ranges = cut.ranges_of(item);
    for (std::size_t segment = 0; segment < ranges.size(); ++segment) {
      for (PointRange left = ranges[segment]; left.count > 0;) {
        const std::uint64_t segment_begin = segment == 0 ? 0 : volume_->volume().info().resolution_counts[segment - 1];
        const std::uint64_t number = rows.group_at(segment, left.begin - segment_begin);
        const Group group = rows.group(number);
        const auto begin = static_cast<std::uint32_t>(left.begin - group.begin);
        const auto count = static_cast<std::uint32_t>(std::min<std::uint64_t>(left.count, group.count - begin));
        left = {left.begin + count, left.count - count};
        SPLATVOL_TRY_ASSIGN(visible, shows(number, segment));
        if (!visible) continue;
        plan.jobs.push_back({number, plan.splats, begin, count, i, item.resolution});
        plan.splats += count;
      }
    }
    plan.item_ends.push_back(plan.splats);
  }
  std::ranges::sort(plan.jobs, {},
                    [](const CopyJob& job) { return std::tuple(job.group, job.resolution, job.begin, job.item); });
  return plan;
}

std::uint64_t Gatherer::working_bytes() const {
  const format::VolumeInfo& info = volume_->volume().info();
  const std::uint64_t points = std::min<std::uint64_t>(info.points_per_chunk, info.point_count());
  const auto chunk_bytes = [&](ColumnKind kind, std::uint64_t payload) {
    return decoded_bytes(kind, static_cast<std::uint32_t>(points)) + largest_gap + points * sizeof(std::uint64_t) +
           2 * payload;
  };
  return chunk_bytes(ColumnKind::position, sizeof(format::PositionHeader) + points * sizeof(dvec3)) +
         chunk_bytes(ColumnKind::value, points * sizeof(float)) +
         info.resolutions() * chunk_bytes(ColumnKind::octant, points * 2);
}

Status Gatherer::gather(const Cut& cut, const GatherPlan& plan, std::span<OctantSplat> splats) {
  for (std::size_t job = 0; job < plan.jobs.size();) {
    Wave wave;
    SPLATVOL_TRY_ASSIGN(end, fill_wave(plan, job, wave));
    SPLATVOL_TRY(load(wave));
    tbb::parallel_for(job, end, [&](std::size_t j) { copy(plan.jobs[j], cut.items[plan.jobs[j].item], wave, splats); });
    job = end;
  }
  return {};
}

// As many groups as fit; returns the job after the last of them.
Result<std::size_t> Gatherer::fill_wave(const GatherPlan& plan, std::size_t first_job, Wave& wave) {
  std::size_t job = first_job;
  while (job < plan.jobs.size() && wave.bytes < wave_bytes) {
    const auto rest = std::span(plan.jobs).subspan(job);
    const auto end = std::ranges::find_if(rest, [&](const CopyJob& j) { return j.group != rest.front().group; });
    const auto of_group = rest.first(static_cast<std::size_t>(end - rest.begin()));
    const Status added = add_group(of_group, wave);
    if (!added && added.error().code == ErrorCode::out_of_budget && job > first_job) break;
    SPLATVOL_TRY(added);
    job += of_group.size();
  }
  return job;
}

CacheKey Gatherer::sizes_key(const CopyJob& job) const {
  return {CacheKey::Kind::sizes, volume_->volume().rows().row(job.resolution, job.group)};
}

// Adds all the chunks that the jobs of one group need, or none: out_of_budget.
Status Gatherer::add_group(std::span<const CopyJob> jobs, Wave& wave) {
  const format::RowLayout& rows = volume_->volume().rows();
  const std::uint64_t number = jobs.front().group;
  const Group group = rows.group(number);
  const std::uint64_t own_row = rows.row(group.segment, number);
  std::vector<Chunk> missing;
  std::map<CacheKey, Cache::Pointer> held;
  const auto want = [&](CacheKey key, std::uint64_t row, int column) -> Status {
    const auto [entry, added] = held.try_emplace(key, nullptr);
    if (!added || (entry->second = cache_->find(key))) return {};
    SPLATVOL_TRY_ASSIGN(place, volume_->find_chunk(row, column));
    const ColumnKind kind = volume_->volume().info().columns[static_cast<std::size_t>(column)].kind;
    missing.push_back({key, kind, row, group.count, place, {}, {}, {}});
    return {};
  };
  SPLATVOL_TRY(want({CacheKey::Kind::positions, number}, own_row, position_));
  SPLATVOL_TRY(want({CacheKey::Kind::values, number}, own_row, value_));
  for (const CopyJob& job : jobs) SPLATVOL_TRY(want(sizes_key(job), sizes_key(job).number, octant_));

  // Only now, since it may cost the directory pages their place.
  std::uint64_t bytes = 0;
  for (Chunk& chunk : missing) {
    auto decoded = cache_->reserve(decoded_bytes(chunk.kind, chunk.points));
    auto decoding = cache_->reserve(decoding_bytes(chunk.place.entry, chunk.points));
    if (!decoded || !decoding)
      return fail(ErrorCode::out_of_budget, "{}: no memory to decode {} points", volume_->volume().name(), group.count);
    bytes += decoded->bytes() + decoding->bytes();
    chunk.decoded = std::move(*decoded);
    chunk.decoding = std::move(*decoding);
  }
  wave.bytes += bytes;
  std::ranges::move(missing, std::back_inserter(wave.missing));
  wave.held.merge(held);
  return {};
}

// Reads and decodes what is missing, in runs of chunks that lie side by side.
Status Gatherer::load(Wave& wave) {
  std::ranges::sort(wave.missing, {}, [](const Chunk& chunk) { return chunk.place.offset; });
  const auto end_of = [](const Chunk& chunk) { return chunk.place.offset + chunk.place.entry.packed_bytes; };
  std::vector<std::span<Chunk>> runs;
  for (std::size_t begin = 0; begin < wave.missing.size();) {
    std::size_t end = begin + 1;
    while (end < wave.missing.size() && wave.missing[end].place.offset - end_of(wave.missing[end - 1]) <= largest_gap &&
           end_of(wave.missing[end]) - wave.missing[begin].place.offset <= run_bytes)
      ++end;
    runs.push_back(std::span(wave.missing).subspan(begin, end - begin));
    begin = end;
  }

  // The first failure in the file's order is the one that is told, whatever the threads did.
  std::vector<Status> outcomes(runs.size());
  tbb::parallel_for(std::size_t{0}, runs.size(), [&](std::size_t i) { outcomes[i] = read_and_decode(runs[i]); });
  for (const Status& outcome : outcomes) SPLATVOL_TRY(outcome);
  for (Chunk& chunk : wave.missing)
    wave.held[chunk.key] = cache_->insert(chunk.key, std::move(chunk.data), std::move(chunk.decoded));
  wave.missing.clear();
  return {};
}

Status Gatherer::read_and_decode(std::span<Chunk> run) const {
  const std::uint64_t begin = run.front().place.offset;
  const std::uint64_t end = run.back().place.offset + run.back().place.entry.packed_bytes;
  SPLATVOL_TRY_ASSIGN(bytes, volume_->volume().read_bytes(begin, end - begin));
  std::vector<Status> outcomes(run.size());
  tbb::parallel_for(std::size_t{0}, run.size(), [&](std::size_t i) {
    const format::ChunkPlace& place = run[i].place;
    outcomes[i] = decode(run[i], std::span(bytes).subspan(place.offset - begin, place.entry.packed_bytes));
  });
  for (const Status& outcome : outcomes) SPLATVOL_TRY(outcome);
  return {};
}

Status Gatherer::decode(Chunk& chunk, std::span<const std::byte> packed) const {
  const format::Volume& volume = volume_->volume();
  const std::string what =
      fmt::format("{}: chunk '{}' of row {}", volume.name(), column_kind_name(chunk.kind), chunk.row);
  if (chunk.kind == ColumnKind::position) {
    std::vector<dvec3> positions(chunk.points);
    SPLATVOL_TRY(format::unpack_positions(chunk.place.entry, packed, positions, what));
    chunk.data = std::move(positions);
    return {};
  }
  std::vector<float> numbers(chunk.points);
  if (chunk.kind == ColumnKind::value) {
    SPLATVOL_TRY(format::unpack_values(chunk.place.entry, packed, numbers, what));
  } else {
    std::vector<std::uint8_t> depths(chunk.points), counts(chunk.points);
    SPLATVOL_TRY(format::unpack_octants(chunk.place.entry, packed, depths, counts, what));
    for (std::size_t i = 0; i < numbers.size(); ++i)
      numbers[i] = static_cast<float>(std::ldexp(volume.info().cube.edge, -depths[i]) / std::cbrt(counts[i]));
  }
  chunk.data = std::move(numbers);
  return {};
}

void Gatherer::copy(const CopyJob& job, const CutItem& item, const Wave& wave, std::span<OctantSplat> splats) const {
  const auto& positions = std::get<std::vector<dvec3>>(*wave.held.at({CacheKey::Kind::positions, job.group}));
  const auto& values = std::get<std::vector<float>>(*wave.held.at({CacheKey::Kind::values, job.group}));
  const auto& sizes = std::get<std::vector<float>>(*wave.held.at(sizes_key(job)));
  const dvec3 centre = item.cell.origin + 0.5 * item.cell.edge;
  for (std::uint32_t i = 0; i < job.count; ++i) {
    const std::size_t point = job.begin + i;
    splats[job.destination + i] = {vec3(positions[point] - centre), values[point], sizes[point]};
  }
}

}  // namespace splatvol
