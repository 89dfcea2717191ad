#include "format/splat_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>

namespace splatvol::format {

Result<SplatSelection> select_splats(const Volume& volume, std::optional<std::size_t> resolution,
                                     const std::vector<std::string>& attributes, const Box& box) {
  const VolumeInfo& info = volume.info();
  SplatSelection selection;
  selection.box = box;
  selection.resolution = resolution.value_or(info.resolutions() - 1);
  if (selection.resolution >= info.resolutions())
    return fail(ErrorCode::invalid_argument, "{}: no resolution {}; the finest is {}", volume.name(),
                selection.resolution, info.resolutions() - 1);
  for (const std::string& name : attributes) {
    SPLATVOL_TRY_ASSIGN(attribute, find_attribute(info, name, volume.name()));
    selection.add(static_cast<std::size_t>(attribute), name);
  }
  if (attributes.empty()) {
    for (std::size_t a = 0; a < info.attributes.size(); ++a) selection.add(a, info.attributes[a].name);
    for (const Alias& alias : info.aliases) selection.add(static_cast<std::size_t>(alias.attribute), alias.name);
  }
  bool complete = info.find_column(ColumnKind::centroid) >= 0 && info.find_column(ColumnKind::moments) >= 0;
  for (const std::size_t a : selection.attributes)
    complete = complete && info.find_column(ColumnKind::value_moments, static_cast<int>(a)) >= 0;
  if (!complete)
    return fail(ErrorCode::unsupported, "{}: no splat moments in it: svbuild of this version writes them",
                volume.name());
  return selection;
}

std::uint64_t SplatReader::group_count() const {
  const RowLayout& rows = volume_.rows();
  return rows.first_row(selection_.resolution + 1) - rows.first_row(selection_.resolution);
}

template <class Unpack>
Status SplatReader::read_chunk(std::uint64_t row, ColumnKind kind, int attribute, const Unpack& unpack) const {
  const int column = volume_.info().find_column(kind, attribute);
  SPLATVOL_TRY_ASSIGN(location, chunks_.locate({row, column}));
  SPLATVOL_TRY_ASSIGN(bytes, volume_.read_bytes(location.offset, location.entry.packed_bytes));
  return unpack(location.entry, bytes, fmt::format("{}: chunk at {}", volume_.name(), location.offset));
}

Result<SplatGroup> SplatReader::read(std::uint64_t number, Parts parts) const {
  const Group group = volume_.rows().group(number);
  // The columns of scope segment are in the group's first row.
  const std::uint64_t row = volume_.rows().row(selection_.resolution, number);
  const std::uint64_t segment_row = volume_.rows().row(group.segment, number);
  SplatGroup result;
  const auto into = [&](auto& out, auto unpack) {
    out.resize(group.count);
    return [&out, unpack](const ChunkEntry& entry, const Bytes& bytes, const std::string& what) {
      return unpack(entry, bytes, std::span(out), what);
    };
  };
  // Lengths are checked against the cube, or its edge.
  const auto into_lengths = [&](auto& out, auto unpack, const auto& bound) {
    return into(out, [unpack, &bound](const ChunkEntry& entry, const Bytes& bytes, auto span, const std::string& what) {
      return unpack(entry, bytes, span, bound, what);
    });
  };
  const Cube& cube = volume_.info().cube;
  if (parts.positions)
    SPLATVOL_TRY(
        read_chunk(segment_row, ColumnKind::position, -1, into_lengths(result.positions, unpack_positions, cube)));
  if (parts.material) {
    SPLATVOL_TRY(read_chunk(row, ColumnKind::centroid, -1, into_lengths(result.centroids, unpack_centroids, cube)));
    SPLATVOL_TRY(read_chunk(row, ColumnKind::moments, -1, into_lengths(result.shapes, unpack_moments, cube.edge)));
  }
  for (const std::size_t a : selection_.attributes) {
    if (parts.values)
      SPLATVOL_TRY(read_chunk(segment_row, ColumnKind::value, static_cast<int>(a),
                              into(result.values.emplace_back(), unpack_values)));
    if (parts.material)
      SPLATVOL_TRY(read_chunk(row, ColumnKind::value_moments, static_cast<int>(a),
                              into(result.materials.emplace_back(), unpack_value_moments)));
    if (!parts.directions) continue;
    std::vector<vec3>& directions = result.directions.emplace_back();
    if (volume_.info().find_column(ColumnKind::gradient, static_cast<int>(a)) >= 0)
      SPLATVOL_TRY(
          read_chunk(segment_row, ColumnKind::gradient, static_cast<int>(a), into(directions, unpack_gradients)));
  }
  return result;
}

}  // namespace splatvol::format
