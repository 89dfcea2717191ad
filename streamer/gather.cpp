#include "streamer/gather.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <tuple>
#include <unordered_map>
#include <unordered_set>

#include "streamer/decode.h"

namespace splatvol {

using format::ColumnKind;

namespace {

// Enough chunks for every processor to decode, and small against any budget.
constexpr std::uint64_t wave_bytes = 16u << 20;
constexpr std::uint64_t run_bytes = 512u << 10;

// The decoded chunks of a row, for the kernel octant. Without lighting there are no gradients.
struct OctantRow {
  std::span<const dvec3> positions;
  std::span<const float> values, sizes;
  std::span<const std::uint32_t> gradients;

  OctantSplat splat(std::size_t point, const dvec3& origin, double length) const {
    return {vec3((positions[point] - origin) / length), values[point], sizes[point],
            gradients.empty() ? 0 : gradients[point]};
  }
};

// The decoded chunks of a row, for the kernel moments.
struct MomentsRow {
  std::span<const dvec3> centroids;
  std::span<const MaterialShape> shapes;
  std::span<const MaterialValue> values;

  MomentsSplat splat(std::size_t point, const dvec3& origin, double length) const {
    const MaterialShape& shape = shapes[point];
    const MaterialValue& value = values[point];
    std::uint32_t correlations = 0;
    for (std::uint32_t k = 0; k < 4; ++k) {
      const bool reversed = k < 3 && shape.turned < 3 && k != shape.turned;
      const int c = value.correlations[k];
      correlations |= static_cast<std::uint32_t>(static_cast<std::uint8_t>(reversed ? -c : c)) << 8 * k;
    }
    return {vec3((centroids[point] - origin) / length),
            shape.mass * value.coverage,
            shape.deviations,
            shape.orientation,
            value.mean,
            value.deviation,
            correlations,
            shape.boundary};
  }
};

template <class T>
std::span<const T> elements(const CacheData& data) {
  return std::get<std::vector<T>>(std::get<DecodedChunk>(data));
}

template <class Row, class Splat>
void copy_jobs(std::span<const CopyJob> jobs, const Cut& cut, const Row& row, double length, std::span<Splat> splats) {
  for (const CopyJob& job : jobs) {
    const Cube& cube = cut.items[job.item].cube;
    const dvec3 origin = cube.origin + 0.5 * cube.edge;
    for (std::uint32_t i = 0; i < job.count; ++i)
      splats[job.destination + i] = row.splat(job.begin + i, origin, length);
  }
}

}  // namespace

// Rows that are loaded at once.
struct Gatherer::Wave {
  std::vector<std::span<const CopyJob>> rows;  // the jobs of each
  std::vector<PartLoad> missing;
  std::map<CacheKey, Cache::Pointer> held;  // null: the chunk is missing
  std::uint64_t bytes = 0;
};

SplatArray::SplatArray(KernelKind kernel, std::uint64_t count) : count_(count) {
  if (kernel == KernelKind::octant)
    storage_ = std::make_unique_for_overwrite<OctantSplat[]>(count);
  else
    storage_ = std::make_unique_for_overwrite<MomentsSplat[]>(count);
}

SplatSpan SplatArray::splats() const {
  if (const auto* octants = std::get_if<std::unique_ptr<OctantSplat[]>>(&storage_))
    return std::span<const OctantSplat>(octants->get(), count_);
  return std::span<const MomentsSplat>(std::get<std::unique_ptr<MomentsSplat[]>>(storage_).get(), count_);
}

Gatherer::Gatherer(PagedVolume& volume, Cache& cache, KernelKind kernel, std::vector<int> columns)
    : volume_(&volume), cache_(&cache), kernel_(kernel), columns_(std::move(columns)) {}

Result<Gatherer> Gatherer::create(PagedVolume& volume, Cache& cache, KernelKind kernel, bool gradients) {
  const format::VolumeInfo& info = volume.volume().info();
  const int attribute = volume.attribute();
  const std::string& file = volume.volume().name();
  const std::string& name = info.attributes[static_cast<std::size_t>(attribute)].name;
  std::vector<int> columns;
  if (kernel == KernelKind::moments) {
    columns = {info.find_column(ColumnKind::centroid), info.find_column(ColumnKind::moments),
               info.find_column(ColumnKind::value_moments, attribute)};
    if (std::ranges::min(columns) < 0)
      return fail(ErrorCode::unsupported,
                  "{}: no splat moments of '{}' in it: svbuild of this version writes them, and --kernel octant draws "
                  "without",
                  file, name);
  } else {
    columns = {info.find_column(ColumnKind::position), info.find_column(ColumnKind::value, attribute),
               info.find_column(ColumnKind::octant)};
    if (columns[1] < 0) return fail(ErrorCode::unsupported, "{}: no values of attribute '{}'", file, name);
    if (columns[2] < 0) return fail(ErrorCode::unsupported, "{}: no octants, which the octant kernel draws", file);
    if (gradients) columns.push_back(info.find_column(ColumnKind::gradient, attribute));
    if (columns.back() < 0)  // the gradients
      return fail(
          ErrorCode::unsupported,
          "{}: no gradients of '{}' in it, which --kernel octant needs for lighting: svbuild --gradients keeps them",
          file, name);
  }
  return Gatherer(volume, cache, kernel, std::move(columns));
}

const format::Column& Gatherer::column(int index) const {
  return volume_->volume().info().columns[static_cast<std::size_t>(index)];
}

// The columns of scope segment are in the group's first row.
CacheKey Gatherer::chunk_key(std::size_t resolution, std::uint64_t group, int column_index) const {
  const format::RowLayout& rows = volume_->volume().rows();
  const bool by_resolution = column(column_index).scope == format::ColumnScope::resolution;
  const std::uint64_t row = rows.row(by_resolution ? resolution : rows.group(group).segment, group);
  return volume_->chunk_key(row, column_index);
}

Result<GatherPlan> Gatherer::plan(const Cut& cut, const ValueVisibility& visibility) {
  GatherPlan plan;
  std::unordered_map<std::uint64_t, bool> shown;  // [row]
  const auto shows = [&](std::uint64_t row) -> Result<bool> {
    const auto [entry, added] = shown.try_emplace(row, false);
    if (!added) return entry->second;
    SPLATVOL_TRY_ASSIGN(location, volume_->find_chunk(row, value_column()));
    return entry->second = visibility.shows(location.entry.min, location.entry.max, location.entry.occupancy);
  };

  for (std::uint32_t i = 0; i < cut.items.size(); ++i) {
    const CutItem& item = cut.items[i];
    Status status;
    visit_groups(volume_->volume(), cut.ranges_of(item), [&](const GroupPart& part) {
      const auto visible = shows(chunk_key(item.resolution, part.group, value_column()).number);
      if (!visible) status = tl::unexpected(visible.error());
      if (!visible || !*visible) return status.has_value();
      plan.jobs.push_back({part.group, plan.splats, part.begin, part.count, i, item.resolution});
      plan.splats += part.count;
      return true;
    });
    SPLATVOL_TRY(status);
    plan.item_ends.push_back(plan.splats);
  }

  // Rows of one group follow each other for the kernel octant, because resolutions share positions and values.
  // Resolutions share nothing of the kernel moments, so its jobs are in file order.
  std::ranges::sort(plan.jobs, {}, [&](const CopyJob& job) {
    return std::tuple(kernel_ == KernelKind::moments ? job.resolution : 0, job.group, job.resolution, job.begin,
                      job.item);
  });
  return plan;
}

std::uint64_t Gatherer::working_bytes() const {
  const format::VolumeInfo& info = volume_->volume().info();
  const std::uint64_t points = info.largest_group();
  std::uint64_t bytes = 0;
  for (const int index : columns_) {
    const ColumnKind kind = column(index).kind;
    const auto payload = static_cast<std::uint32_t>(largest_payload(kind, points));
    ChunkLoad largest{kind, static_cast<std::uint32_t>(points), {}};
    largest.location.entry.packed_bytes = largest.location.entry.unpacked_bytes = payload;
    bytes += decoded_bytes(largest) + splatvol::working_bytes(volume_->volume(), largest);
  }
  return bytes;
}

std::uint64_t Gatherer::resident_bytes(const Cut& cut) const {
  const format::Volume& volume = volume_->volume();
  const auto number_of = [](std::uint64_t resolution, std::uint64_t group) { return resolution << 56 | group; };
  std::unordered_set<std::uint64_t> rows, groups, pages;
  for (const CutItem& item : cut.items)
    visit_groups(volume, cut.ranges_of(item), [&](const GroupPart& part) {
      if (rows.insert(number_of(item.resolution, part.group)).second) groups.insert(part.group);
      return true;
    });

  std::uint64_t bytes = 0;
  for (const int index : columns_) {
    const bool by_resolution = column(index).scope == format::ColumnScope::resolution;
    for (const std::uint64_t number : by_resolution ? rows : groups) {
      const std::uint64_t group = number & ~(std::uint64_t{255} << 56);
      pages.insert(volume.directory_page_of_row(chunk_key(number >> 56, group, index).number, index));
      bytes += decoded_bytes(column(index).kind, volume.rows().group(group).count);
    }
  }
  for (const std::uint64_t page : pages) bytes += volume_->directory_page_bytes(page);
  return bytes;
}

Result<SplatArray> Gatherer::gather(const Cut& cut, const GatherPlan& plan) {
  SplatArray splats(kernel_, plan.splats);
  for (std::size_t job = 0; job < plan.jobs.size();) {
    Wave wave;
    SPLATVOL_TRY_ASSIGN(end, fill_wave(plan, job, wave));
    SPLATVOL_TRY(load(wave));
    tbb::parallel_for(std::size_t{0}, wave.rows.size(),
                      [&](std::size_t row) { copy(wave.rows[row], cut, wave, splats); });
    job = end;
  }
  return splats;
}

// Adds as many rows as fit. Returns the job behind them.
Result<std::size_t> Gatherer::fill_wave(const GatherPlan& plan, std::size_t first_job, Wave& wave) {
  std::size_t job = first_job;
  while (job < plan.jobs.size() && wave.bytes < wave_bytes) {
    const auto rest = std::span(plan.jobs).subspan(job);
    const auto end = std::ranges::find_if(rest, [&](const CopyJob& j) {
      return j.group != rest.front().group || j.resolution != rest.front().resolution;
    });
    const auto of_row = rest.first(static_cast<std::size_t>(end - rest.begin()));
    const Status added = add_row(of_row, wave);
    if (!added && added.error().code == ErrorCode::out_of_budget && job > first_job) break;
    SPLATVOL_TRY(added);
    job += of_row.size();
  }
  return job;
}

// Adds all the chunks that the jobs of one row need. Fails with out_of_budget, and adds none, if they do not fit.
Status Gatherer::add_row(std::span<const CopyJob> jobs, Wave& wave) {
  const std::uint32_t points = volume_->volume().rows().group(jobs.front().group).count;
  std::vector<PartLoad> missing;
  std::map<CacheKey, Cache::Pointer> held;
  for (const int index : columns_) {
    const CacheKey key = chunk_key(jobs.front().resolution, jobs.front().group, index);
    if (wave.held.contains(key)) continue;
    if ((held[key] = cache_->find(key))) continue;
    SPLATVOL_TRY_ASSIGN(location, volume_->find_chunk(key.number, index));
    missing.push_back(chunk_load(key, {column(index).kind, points, location}));
  }

  // Reserved only now: reserving may drop the directory pages that were used above.
  std::uint64_t bytes = 0;
  for (PartLoad& part : missing) {
    auto decoded = cache_->reserve(decoded_bytes(part.chunk()));
    auto working = cache_->reserve(splatvol::working_bytes(volume_->volume(), part.chunk()));
    if (!decoded || !working)
      return fail(ErrorCode::out_of_budget, "{}: no memory to decode {} points", volume_->volume().name(), points);
    bytes += decoded->bytes() + working->bytes();
    part.decoded = std::move(*decoded);
    part.working = std::move(*working);
  }
  wave.bytes += bytes;
  std::ranges::move(missing, std::back_inserter(wave.missing));
  wave.held.merge(held);
  wave.rows.push_back(jobs);
  return {};
}

// Reads and decodes the missing chunks, in load runs.
Status Gatherer::load(Wave& wave) {
  std::vector<LoadRun> runs = runs_of(volume_->volume(), std::move(wave.missing), run_bytes);
  read_runs(volume_->volume(), volume_->attribute(), runs);

  // Of several failures, reports the first in file order, so that the message does not depend on threads.
  for (const LoadRun& run : runs)
    for (const PartLoad& part : run) SPLATVOL_TRY(part.data);
  for (LoadRun& run : runs)
    for (PartLoad& part : run)
      wave.held[part.key] = cache_->insert(part.key, std::move(*part.data), std::move(part.decoded));
  wave.missing.clear();
  return {};
}

void Gatherer::copy(std::span<const CopyJob> jobs, const Cut& cut, const Wave& wave, SplatArray& splats) const {
  const auto held = [&](std::size_t i) -> const CacheData& {
    return *wave.held.at(chunk_key(jobs.front().resolution, jobs.front().group, columns_[i]));
  };
  const double length = drawing_length(volume_->volume().info().cube.edge);
  if (kernel_ == KernelKind::moments) {
    copy_jobs(jobs, cut,
              MomentsRow{elements<dvec3>(held(0)), elements<MaterialShape>(held(1)), elements<MaterialValue>(held(2))},
              length, splats.as<MomentsSplat>());
    return;
  }
  OctantRow row{elements<dvec3>(held(0)), elements<float>(held(1)), elements<float>(held(2)), {}};
  if (columns_.size() > 3) row.gradients = elements<std::uint32_t>(held(3));
  copy_jobs(jobs, cut, row, length, splats.as<OctantSplat>());
}

}  // namespace splatvol
