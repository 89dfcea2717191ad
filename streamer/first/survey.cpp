#include "streamer/first/survey.h"

#include <algorithm>
#include <set>
#include <span>
#include <utility>

#include "format/volume_chunks.h"

namespace splatvol {
namespace {

constexpr std::uint64_t room_for_pages = std::uint64_t{1} << 20;

// Reads chunks of one row after another.
class RowReader {
 public:
  explicit RowReader(const format::Volume& volume) : volume_(volume), chunks_(volume, own_room(room_for_pages)) {}

  // Appends a column of a row to `all`. `unpack` is one of format's functions for it.
  template <class Element, class Unpack>
  Status append(std::uint64_t row, std::uint32_t count, int column, const Unpack& unpack, std::vector<Element>& all) {
    SPLATVOL_TRY_ASSIGN(location, chunks_.locate({row, column}));
    SPLATVOL_TRY_ASSIGN(packed, volume_.read_bytes(location.offset, location.entry.packed_bytes));
    all.resize(all.size() + count);
    return unpack(location.entry, packed, std::span(all).last(count), volume_.name());
  }

 private:
  const format::Volume& volume_;
  const format::VolumeChunks chunks_;
};

SurveySplat splat_of(const dvec3& centroid, const SplatShape& shape, const SplatValue& value,
                     const format::Attribute& attribute) {
  SurveySplat splat{.center = centroid, .axes = glm::mat3_cast(shape.orientation)};
  for (int k = 0; k < 3; ++k) splat.axes[k] *= shape.deviations[k];
  splat.volume = shape.mass * value.coverage;
  splat.value = std::clamp(attribute.value(value.mean), attribute.min, attribute.max);  // steps of means round
  splat.deviation = attribute.scale * value.deviation;
  splat.has_value = value.coverage > 0 && shape.mass > 0;
  return splat;
}

tl::unexpected<Error> no_moments(const format::Volume& volume) {
  return fail(ErrorCode::unsupported,
              "{}: has no splat moments, which a first scene needs: build it again with svbuild", volume.name());
}

}  // namespace

Result<SurveyBytes> read_survey_ahead(const format::Volume& volume, const std::vector<int>& attributes,
                                      std::uint64_t most_splats) {
  using format::ColumnKind;
  if (!volume.is_far()) return SurveyBytes();
  const format::VolumeInfo& info = volume.info();
  std::vector<int> columns{info.find_column(ColumnKind::centroid), info.find_column(ColumnKind::moments)};
  for (const int attribute : attributes) columns.push_back(info.find_column(ColumnKind::value_moments, attribute));
  if (std::ranges::min(columns) < 0) return no_moments(volume);
  const std::size_t resolution = info.finest_within(most_splats);
  std::vector<format::ChunkName> chunks;
  std::set<std::uint64_t> pages;
  for (std::uint64_t group = 0, points = 0; points < info.resolution_counts[resolution]; ++group) {
    points += volume.rows().group(group).count;
    for (const int column : columns) {
      chunks.push_back({volume.rows().row(resolution, group), column});
      pages.insert(volume.directory_page_of_row(chunks.back().row, column));
    }
  }
  std::vector<ByteRange> of_pages;
  for (const std::uint64_t page : pages) of_pages.push_back(volume.range_of_directory_page(page));
  SPLATVOL_TRY_ASSIGN(page_bytes, volume.read_together(std::move(of_pages)));
  SPLATVOL_TRY_ASSIGN(ranges, format::VolumeChunks(volume, own_room(room_for_pages)).ranges_of(chunks));
  SPLATVOL_TRY_ASSIGN(chunk_bytes, volume.read_together(std::move(ranges)));
  return SurveyBytes{std::move(page_bytes), std::move(chunk_bytes)};
}

Result<SurveyShapes> survey_shapes(const format::Volume& volume, std::uint64_t most_splats) {
  using format::ColumnKind;
  const format::VolumeInfo& info = volume.info();
  const int centroid = info.find_column(ColumnKind::centroid), moments = info.find_column(ColumnKind::moments);
  if (std::min(centroid, moments) < 0) return no_moments(volume);
  SurveyShapes found;
  found.resolution = info.finest_within(most_splats);
  const auto unpack_centroids = [&](const format::ChunkEntry& entry, const format::Bytes& packed, std::span<dvec3> out,
                                    const std::string& what) {
    return format::unpack_centroids(entry, packed, out, info.cube, what);
  };
  const auto unpack_shapes = [&](const format::ChunkEntry& entry, const format::Bytes& packed,
                                 std::span<SplatShape> out, const std::string& what) {
    return format::unpack_moments(entry, packed, out, info.cube.edge, what);
  };
  RowReader reader(volume);
  for (std::uint64_t group = 0; found.centroids.size() < info.resolution_counts[found.resolution]; ++group) {
    const std::uint64_t row = volume.rows().row(found.resolution, group);
    const std::uint32_t count = volume.rows().group(group).count;
    SPLATVOL_TRY(reader.append(row, count, centroid, unpack_centroids, found.centroids));
    SPLATVOL_TRY(reader.append(row, count, moments, unpack_shapes, found.shapes));
  }
  return found;
}

Result<std::vector<SurveySplat>> survey_material(const format::Volume& volume, int attribute,
                                                 const SurveyShapes& shapes) {
  const format::VolumeInfo& info = volume.info();
  const int value_moments = info.find_column(format::ColumnKind::value_moments, attribute);
  if (value_moments < 0) return no_moments(volume);
  std::vector<SplatValue> values;
  // Of a function by its address, clang 19 loses the parameters for WebAssembly.
  const auto unpack = [](const auto&... arguments) { return format::unpack_value_moments(arguments...); };
  RowReader reader(volume);
  for (std::uint64_t group = 0; values.size() < shapes.centroids.size(); ++group)
    SPLATVOL_TRY(reader.append(volume.rows().row(shapes.resolution, group), volume.rows().group(group).count,
                               value_moments, unpack, values));
  const format::Attribute& described = info.attributes[static_cast<std::size_t>(attribute)];
  std::vector<SurveySplat> splats;
  splats.reserve(values.size());
  for (std::size_t i = 0; i < values.size(); ++i)
    splats.push_back(splat_of(shapes.centroids[i], shapes.shapes[i], values[i], described));
  return splats;
}

Result<std::vector<SurveySplat>> survey_material(const format::Volume& volume, int attribute,
                                                 std::uint64_t most_splats) {
  SPLATVOL_TRY_ASSIGN(shapes, survey_shapes(volume, most_splats));
  return survey_material(volume, attribute, shapes);
}

Result<std::vector<double>> survey_values(const format::Volume& volume, int attribute, std::uint64_t most_points) {
  const format::VolumeInfo& info = volume.info();
  const int column = info.find_column(format::ColumnKind::value, attribute);
  if (column < 0) return fail(ErrorCode::invalid_data, "{}: lacks a column that a scene needs", volume.name());
  const std::size_t resolution = info.finest_within(most_points);
  std::vector<float> stored;
  const auto unpack = [](const auto&... arguments) { return format::unpack_values(arguments...); };
  RowReader reader(volume);
  for (std::uint64_t index = 0; stored.size() < info.resolution_counts[resolution]; ++index) {
    const format::Group group = volume.rows().group(index);
    SPLATVOL_TRY(reader.append(volume.rows().row(group.segment, index), group.count, column, unpack, stored));
  }
  const format::Attribute& described = info.attributes[static_cast<std::size_t>(attribute)];
  std::vector<double> values;
  values.reserve(stored.size());
  for (const float value : stored) values.push_back(described.value(value));
  return values;
}

Box bounds_of(const std::vector<SurveySplat>& splats) {
  Box box;
  for (const SurveySplat& splat : splats) {
    const dvec3 half(splat.reach({1, 0, 0}), splat.reach({0, 1, 0}), splat.reach({0, 0, 1}));
    box.include({splat.center - half, splat.center + half});
  }
  return box;
}

}  // namespace splatvol
