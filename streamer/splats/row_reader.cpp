#include "streamer/splats/row_reader.h"

#include <iterator>
#include <unordered_set>

#include "streamer/store/row_bytes.h"

namespace splatvol {

using format::ColumnKind;

namespace {

// Enough rows for every processor to decode, and small against any budget. From a server, what several requests bring.
constexpr std::uint64_t wave_bytes = 16u << 20, wave_bytes_from_server = 64u << 20;
constexpr std::uint64_t run_bytes = 512u << 10;

// The most bytes that the payload of a chunk can have.
std::uint64_t largest_payload(ColumnKind kind, std::uint64_t points) {
  switch (kind) {
    case ColumnKind::position:
    case ColumnKind::centroid:
      return sizeof(format::PositionHeader) + points * sizeof(dvec3);
    case ColumnKind::moments:
      return sizeof(format::MomentsHeader) + points * 23;  // mass 2, deviations 6, orientation 8, boundary 6, density 1
    case ColumnKind::value_moments:
      return sizeof(format::ValueMomentsHeader) + points * 10;  // mean 4, deviation 2, a byte each
    case ColumnKind::value:
      return sizeof(format::ValueHeader) + points * sizeof(float);
    default:
      return points * sizeof(float);
  }
}

}  // namespace

// Parts of rows that are read at once.
struct RowReader::Wave {
  std::vector<RowName> rows;
  std::vector<PartLoad> missing;
  std::map<PartKey, PartPointer> held;  // null: the part is missing
  std::uint64_t bytes = 0;
};

Result<RowReader> RowReader::create(PagedVolume& volume, KernelKind kernel, bool gradients) {
  const format::VolumeInfo& info = volume.volume().info();
  const auto [attribute, opacity] = volume.attributes();
  const std::string& file = volume.volume().name();
  const auto name_of = [&](int index) { return info.attributes[static_cast<std::size_t>(index)].name; };
  if (kernel == KernelKind::moments) {
    const std::vector<int> shapes{info.find_column(ColumnKind::centroid), info.find_column(ColumnKind::moments)};
    std::vector<int> values;
    for (const int shown : {attribute, opacity}) {
      if (shown < 0) continue;
      values.push_back(info.find_column(ColumnKind::value_moments, shown));
      if (std::min(std::ranges::min(shapes), values.back()) < 0)
        return fail(ErrorCode::unsupported,
                    "{}: no splat moments of '{}' in it: svbuild of this version writes them, and --kernel octant "
                    "draws without",
                    file, name_of(shown));
    }
    return RowReader(volume, kernel, false, shapes, std::move(values));
  }
  const std::vector<int> shapes{info.find_column(ColumnKind::position), info.find_column(ColumnKind::octant)};
  std::vector<int> values;
  const auto add_values = [&](int shown) -> Status {
    values.push_back(info.find_column(ColumnKind::value, shown));
    if (values.back() >= 0) return {};
    return fail(ErrorCode::unsupported, "{}: no values of attribute '{}'", file, name_of(shown));
  };
  SPLATVOL_TRY(add_values(attribute));
  if (shapes.back() < 0) return fail(ErrorCode::unsupported, "{}: no octants, which the octant kernel draws", file);
  if (gradients) values.push_back(info.find_column(ColumnKind::gradient, attribute));
  if (values.back() < 0)  // the gradients
    return fail(
        ErrorCode::unsupported,
        "{}: no gradients of '{}' in it, which --kernel octant needs for lighting: svbuild --gradients keeps them",
        file, name_of(attribute));
  if (opacity >= 0) SPLATVOL_TRY(add_values(opacity));
  return RowReader(volume, kernel, gradients, shapes, std::move(values));
}

const format::Column& RowReader::column(int index) const {
  return volume_->volume().info().columns[static_cast<std::size_t>(index)];
}

// The columns of scope segment are in the group's first row.
std::uint64_t RowReader::row_of(const RowName& name, int column_index) const {
  const format::RowLayout& rows = volume_->volume().rows();
  const bool by_resolution = column(column_index).scope == format::ColumnScope::resolution;
  return rows.row(by_resolution ? name.resolution : rows.group(name.group).segment, name.group);
}

RowReader::ChunkName RowReader::chunk_name(const RowName& name, int column_index) const {
  return {row_of(name, column_index), column_index};
}

PartKey RowReader::shapes_key(const RowName& name) const {
  return volume_->row_key(format::row_shapes, row_of(name, shape_columns_.back()), shape_columns_);
}

PartKey RowReader::values_key(const RowName& name) const {
  return volume_->row_key(format::row_values, row_of(name, value_columns_.front()), value_columns_);
}

std::vector<RowReader::ChunkName> RowReader::chunks(const RowName& name, int kind) const {
  std::vector<ChunkName> names;
  for (const int column : columns(kind)) names.push_back(chunk_name(name, column));
  return names;
}

PartLoad RowReader::load_of(const RowName& name, const PartKey& key) const {
  RowLoad load{kernel_, volume_->volume().rows().group(name.group).count, has_opacity(), {}};
  for (const ChunkName& chunk : chunks(name, key.kind)) load.chunks.push_back({chunk.row, chunk.column, {}});
  return load_part(key, std::move(load));
}

Result<std::vector<RowPart>> RowReader::plan(const Cut& cut, const ValueVisibility& visibility) {
  std::set<std::uint64_t> pages;
  visit_rows(cut, [&](const RowName& name, std::uint64_t /*points*/) { add_directory_pages(name, pages); });
  SPLATVOL_TRY(volume_->read_directory_pages(pages));
  std::vector<RowPart> parts;
  std::unordered_map<std::uint64_t, bool> shown;  // [RowName::number]
  const auto shows = [&](const RowName& name) -> Result<bool> {
    const auto [entry, added] = shown.try_emplace(name.number(), false);
    if (!added) return entry->second;
    const auto summary_of = [&](const ChunkName& chunk) -> Result<format::ValueSummary> {
      SPLATVOL_TRY_ASSIGN(location, volume_->find_chunk(chunk.row, chunk.column));
      return format::summary_of(location.entry);
    };
    SPLATVOL_TRY_ASSIGN(values, summary_of(value_chunk(name)));
    const std::optional<ChunkName> opacity_chunk = this->opacity_chunk(name);
    if (!opacity_chunk) return entry->second = visibility.shows_row({values});
    SPLATVOL_TRY_ASSIGN(opacity, summary_of(*opacity_chunk));
    return entry->second = visibility.shows_row({values, &opacity});
  };

  for (std::uint32_t i = 0; i < cut.items.size(); ++i) {
    const CutItem& item = cut.items[i];
    Status status;
    visit_groups(volume_->volume(), cut.ranges_of(item), [&](const GroupPart& part) {
      const RowName name{item.resolution, part.group};
      const auto visible = shows(name);
      if (!visible) status = tl::unexpected(visible.error());
      if (!visible || !*visible) return status.has_value();
      parts.push_back({name, part.begin, part.count, i});
      return true;
    });
    SPLATVOL_TRY(status);
  }
  return parts;
}

std::uint64_t RowReader::working_bytes() const {
  const std::uint64_t points = volume_->volume().info().largest_group();
  std::uint64_t bytes = 0;
  for (const int kind : {format::row_shapes, format::row_values}) {
    RowLoad load{kernel_, static_cast<std::uint32_t>(points), has_opacity(), {}};
    for (const int index : columns(kind)) {
      ChunkLoad chunk{0, index, {}};
      const auto payload = static_cast<std::uint32_t>(largest_payload(column(index).kind, points));
      chunk.location.entry.packed_bytes = chunk.location.entry.unpacked_bytes = payload;
      load.chunks.push_back(chunk);
    }
    const PartLoad part = load_part({0, kind, 0}, std::move(load));
    bytes += decoded_bytes(part) + splatvol::working_bytes(volume_->volume(), part);
  }
  return bytes;
}

// Calls visit(name, points) for each row of a cut.
template <class Visit>
void RowReader::visit_rows(const Cut& cut, const Visit& visit) const {
  const format::Volume& volume = volume_->volume();
  std::unordered_set<std::uint64_t> rows;
  for (const CutItem& item : cut.items)
    visit_groups(volume, cut.ranges_of(item), [&](const GroupPart& part) {
      const RowName name{item.resolution, part.group};
      if (rows.insert(name.number()).second) visit(name, volume.rows().group(part.group).count);
      return true;
    });
}

// Adds the pages that name the chunks of a row.
void RowReader::add_directory_pages(const RowName& name, std::set<std::uint64_t>& pages) const {
  for (const int kind : {format::row_shapes, format::row_values})
    for (const int index : columns(kind))
      pages.insert(volume_->volume().directory_page_of_row(row_of(name, index), index));
}

std::uint64_t RowReader::row_bytes(const Cut& cut) const {
  std::unordered_set<std::uint64_t> values;
  std::set<std::uint64_t> pages;
  std::uint64_t bytes = 0;
  visit_rows(cut, [&](const RowName& name, std::uint64_t points) {
    bytes += shape_row_bytes(kernel_, points);
    if (values.insert(row_of(name, value_columns_.front())).second)
      bytes += value_row_bytes(kernel_, points, has_opacity());
    add_directory_pages(name, pages);
  });
  for (const std::uint64_t page : pages) bytes += volume_->directory_page_bytes(page);
  return bytes;
}

std::uint64_t RowReader::coarsest_row_bytes() const {
  Cut cut;
  cut.items.push_back({{}, 0, 0, 0});
  cut.ranges.push_back({0, volume_->volume().info().resolution_counts[0]});
  return row_bytes(cut);
}

Result<HeldRows> RowReader::hold(std::span<const RowPart> plan) {
  // In file order. Resolutions share values of the kernel octant, and so do waves.
  HeldRows held;
  std::vector<RowName> missing;
  for (const RowPart& part : plan) {
    const auto [row, added] = held.try_emplace(part.row.number());
    if (!added) continue;
    row->second = {room().find<void>(shapes_key(part.row)), room().find<void>(values_key(part.row))};
    if (!row->second.is_whole()) missing.push_back(part.row);
  }
  std::set<std::uint64_t> pages;
  for (const RowName& name : missing) add_directory_pages(name, pages);
  SPLATVOL_TRY(volume_->read_directory_pages(pages));
  const bool by_resolution = kernel_ == KernelKind::moments;
  std::ranges::sort(missing, {}, [&](const RowName& name) {
    return std::tuple(by_resolution ? name.resolution : 0, name.group, name.resolution);
  });
  const std::uint64_t most_bytes = volume_->volume().is_far() ? wave_bytes_from_server : wave_bytes;
  for (std::size_t next = 0; next < missing.size();) {
    Wave wave;
    while (next < missing.size() && wave.bytes < most_bytes) {
      const Status added = add_row(missing[next], wave);
      if (!added && added.error().code == ErrorCode::out_of_budget && !wave.rows.empty()) break;
      SPLATVOL_TRY(added);
      ++next;
    }
    SPLATVOL_TRY(load(wave, held));
  }
  return held;
}

// Adds the parts of a row that are missing. Fails with out_of_budget, and adds none, if they do not fit.
Status RowReader::add_row(const RowName& name, Wave& wave) {
  std::vector<PartLoad> missing;
  std::map<PartKey, PartPointer> held;
  for (const PartKey& key : keys(name)) {
    if (wave.held.contains(key)) continue;
    if ((held[key] = room().find<void>(key))) continue;
    PartLoad part = load_of(name, key);
    for (ChunkLoad& chunk : std::get<RowLoad>(part.what).chunks)
      SPLATVOL_TRY_SET(chunk.location, volume_->find_chunk(chunk.row, chunk.column));
    missing.push_back(std::move(part));
  }

  // Reserved only now: reserving may drop the directory pages that were used above.
  std::uint64_t bytes = 0;
  for (PartLoad& part : missing) {
    auto decoded = room().share->reserve(decoded_bytes(part));
    auto working = room().share->reserve(splatvol::working_bytes(volume_->volume(), part));
    if (!decoded || !working)
      return fail(ErrorCode::out_of_budget, "{}: no memory to decode {} points", volume_->volume().name(),
                  part.row().points);
    bytes += decoded->bytes() + working->bytes();
    part.decoded = std::move(*decoded);
    part.working = std::move(*working);
  }
  wave.bytes += bytes;
  std::ranges::move(missing, std::back_inserter(wave.missing));
  wave.held.merge(held);
  wave.rows.push_back(name);
  return {};
}

// Reads and decodes the missing parts, in load runs.
Status RowReader::load(Wave& wave, HeldRows& rows) {
  const std::uint64_t most_bytes = volume_->volume().is_far() ? most_part_bytes : run_bytes;
  std::vector<LoadRun> runs = runs_of(volume_->volume(), std::move(wave.missing), most_bytes);
  read_runs(volume_->volume(), volume_->attributes(), runs);

  // Of several failures, reports the first in file order, so that the message does not depend on threads.
  for (const LoadRun& run : runs)
    for (const PartLoad& part : run) SPLATVOL_TRY(part.data);
  for (LoadRun& run : runs)
    for (PartLoad& part : run) {
      part.working = Reservation();
      if (!part.decoded.grow(held_bytes(*part.data)))
        return fail(ErrorCode::out_of_budget, "{}: no memory to decode {} points", volume_->volume().name(),
                    part.row().points);
      wave.held[part.key] = insert(room(), std::move(part));
    }
  for (const RowName& name : wave.rows)
    rows[name.number()] = {wave.held.at(shapes_key(name)), wave.held.at(values_key(name))};
  return {};
}

}  // namespace splatvol
