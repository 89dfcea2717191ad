// What a .svol file says of itself: counts, cube, attributes, columns (spec/svol-1.md, sections 0 and 4).
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/columns.h"

namespace splatvol::format {

struct Attribute {
  std::string name;
  std::string unit;
  double offset = 0;                                      // value = offset + stored value
  double min = std::numeric_limits<double>::quiet_NaN();  // of the values; NaN where none is present
  double max = std::numeric_limits<double>::quiet_NaN();
  std::uint64_t missing = 0;
};

/// The bins of an attribute's stored values.
[[nodiscard]] inline ValueBins bins_of(const Attribute& attribute) {
  return {attribute.min - attribute.offset, attribute.max - attribute.offset};
}

enum class ColumnKind { position, value, octant, centroid, moments, value_moments, gradient, unknown };
enum class ColumnScope { segment, resolution };

/// As in the metadata; "unknown" for kinds that this version does not know.
[[nodiscard]] const char* column_kind_name(ColumnKind kind);

struct Column {
  ColumnKind kind = ColumnKind::unknown;
  ColumnScope scope = ColumnScope::segment;
  int attribute = -1;  // -1: of no attribute
};

struct VolumeInfo {
  Cube cube;
  std::vector<std::uint64_t> resolution_counts;  // n_0 < ... < n_R
  std::uint32_t points_per_chunk = 1024;
  std::uint32_t rows_per_directory_page = 256;
  std::string reduction_method = "octree";
  std::uint32_t leaf_points = 8;
  std::vector<Attribute> attributes;
  std::vector<Column> columns;
  std::vector<std::string> size_bounds = {"octant"};
  std::string provenance = "{}";  // a JSON object

  [[nodiscard]] std::size_t resolutions() const { return resolution_counts.size(); }
  [[nodiscard]] std::uint64_t point_count() const { return resolution_counts.back(); }

  /// Index of a column, -1 where the file has none.
  [[nodiscard]] int find_column(ColumnKind kind, int attribute = -1) const;

  /// Index of an attribute, -1 where the file has none.
  [[nodiscard]] int find_attribute(const std::string& name) const;
};

/// Index of an attribute. Fails with invalid_argument where there is none of this name; the message begins with
/// `file_name` and lists those that there are.
[[nodiscard]] Result<int> find_attribute(const VolumeInfo& info, const std::string& name, const std::string& file_name);

/// Spec section 4, both ways; both check every rule of that section, so that nothing is written which cannot be read.
/// Bytes of a name that are not UTF-8 are replaced.
[[nodiscard]] Result<std::string> metadata_to_json(const VolumeInfo& info);
[[nodiscard]] Result<VolumeInfo> metadata_from_json(const std::string& json);

/// Consecutive points of one segment: the unit that is read at once.
struct Group {
  std::size_t segment;
  std::uint64_t begin;  // position in the point array
  std::uint32_t count;
};

/// Where groups, rows and chunks lie, by arithmetic alone (spec/svol-1.md, introduction).
class RowLayout {
 public:
  RowLayout() = default;
  explicit RowLayout(const VolumeInfo& info);

  [[nodiscard]] std::uint64_t group_count() const { return first_group_.back(); }
  [[nodiscard]] std::uint64_t row_count() const { return first_row_.back(); }

  [[nodiscard]] Group group(std::uint64_t index) const;

  /// The group of the point at `offset` within a segment.
  [[nodiscard]] std::uint64_t group_at(std::size_t segment, std::uint64_t offset) const {
    return first_group_[segment] + offset / points_per_chunk_;
  }

  /// Row (resolution, group); requires the group's segment <= resolution.
  [[nodiscard]] std::uint64_t row(std::size_t resolution, std::uint64_t group) const {
    return first_row_[resolution] + group;
  }
  /// The first row of a resolution; with R + 1, the number of rows.
  [[nodiscard]] std::uint64_t first_row(std::size_t resolution) const { return first_row_[resolution]; }
  [[nodiscard]] std::size_t resolution_of_row(std::uint64_t row) const;
  [[nodiscard]] std::uint64_t group_of_row(std::uint64_t row) const { return row - first_row_[resolution_of_row(row)]; }

  /// Columns of a row, as indices into VolumeInfo::columns.
  [[nodiscard]] const std::vector<int>& columns_of_row(std::uint64_t row) const;

  /// Chunks in rows [0, row): also the number of a row's first chunk.
  [[nodiscard]] std::uint64_t chunks_before(std::uint64_t row) const;

 private:
  std::vector<std::uint64_t> counts_;
  std::uint32_t points_per_chunk_ = 1;
  std::vector<std::uint64_t> first_group_;  // [segment], and the total
  std::vector<std::uint64_t> first_row_;    // [resolution], and the total
  std::vector<int> all_columns_;
  std::vector<int> resolution_columns_;
};

}  // namespace splatvol::format
