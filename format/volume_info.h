// The metadata of a .svol file: counts, cube, attributes, columns (spec/svol-1.md, introduction and section 4).
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/columns.h"

namespace splatvol::format {

/// Bounds of numbers in a file (spec 4): their products stay in the range of double precision.
inline constexpr double largest_value = 1e102;  // magnitude of values, offsets and scales
inline constexpr double largest_length = 1e60;  // magnitude of coordinates of the cube, and its edge
inline constexpr double least_length = 1e-60;   // of the edge
inline constexpr double largest_time = 1e300;   // magnitude

/// Bytes of a point, and of a triangle, in the payload of a patch (spec 13).
inline constexpr std::uint64_t patch_element_bytes = 12;

/// Bounds of VolumeInfo::points_per_chunk (spec 4).
inline constexpr std::uint32_t min_points_per_chunk = 64, max_points_per_chunk = 65536;

/// Whether two numbers are the ends of a range of values.
[[nodiscard]] inline bool is_range(double min, double max) {
  return -largest_value <= min && min <= max && max <= largest_value;
}

struct Attribute {
  std::string name;
  std::string unit;
  double offset = 0;                                      // value = offset + scale x stored value
  double scale = 1;                                       // > 0; a power of two
  double min = std::numeric_limits<double>::quiet_NaN();  // of the values; NaN if none is present
  double max = std::numeric_limits<double>::quiet_NaN();
  std::uint64_t missing = 0;
  double error = 0;  // no value differs by more from the input's, besides rounding to single precision of stored values

  /// Convert between values and stored values.
  [[nodiscard]] double value(double stored) const { return offset + scale * stored; }
  [[nodiscard]] double stored(double value) const { return (value - offset) / scale; }
};

/// Returns what stands beside its values: the name, and the unit in brackets if there is one.
[[nodiscard]] inline std::string label_of(const Attribute& attribute) {
  return attribute.unit.empty() ? attribute.name : attribute.name + " [" + attribute.unit + "]";
}

/// Returns the bins of an attribute's stored values.
[[nodiscard]] inline ValueBins bins_of(const Attribute& attribute) {
  return {attribute.stored(attribute.min), attribute.stored(attribute.max)};
}

/// Another name of an attribute: the input has the same values, bit by bit, under both.
struct Alias {
  std::string name;
  int attribute = 0;  // index

  [[nodiscard]] bool operator==(const Alias&) const = default;
};

/// An attribute of a time series. Ranges and offsets are those of each step.
struct SeriesAttribute {
  std::string name;
  std::string unit;

  [[nodiscard]] bool operator==(const SeriesAttribute&) const = default;
};

/// A part of the mesh's boundary that has a name.
struct PatchInfo {
  std::string name;
  std::uint64_t points = 0;
  std::uint64_t triangles = 0;
  std::uint64_t two_sided = 0;  // of the triangles: the last ones

  [[nodiscard]] bool operator==(const PatchInfo&) const = default;
};

/// The mesh's boundary (spec 13). Its triangles are read on demand.
struct BoundaryInfo {
  dvec3 origin{0};               // of the grid that positions are on
  double quantisation_step = 0;  // of this grid; >= 0
  double error = 0;              // no point of the input's boundary is farther from the triangles
  std::vector<PatchInfo> patches;

  [[nodiscard]] bool operator==(const BoundaryInfo&) const = default;
};

/// The mesh's cells (spec 14). They are read on demand.
struct CellsInfo {
  std::uint64_t hash = 0;     // of all cells in any order: tells whether another input has the same ones
  bool blocks_apart = false;  // in a series: only vertices of one block of the input are joined

  [[nodiscard]] bool operator==(const CellsInfo&) const = default;
};

enum class ColumnKind { position, value, octant, centroid, moments, value_moments, gradient, unknown };
enum class ColumnScope { segment, resolution };

/// Returns the name of a kind as in the metadata; "unknown" for unknown kinds.
[[nodiscard]] const char* column_kind_name(ColumnKind kind);

struct Column {
  ColumnKind kind = ColumnKind::unknown;
  ColumnScope scope = ColumnScope::segment;
  int attribute = -1;  // index; -1: none
};

struct VolumeInfo {
  Cube cube;
  std::vector<std::uint64_t> resolution_counts;  // n_0 < ... < n_R
  std::vector<std::uint32_t> points_per_chunk;   // [segment]: most points of its groups
  std::uint32_t rows_per_directory_page = 256;
  std::string reduction_method = "octree";
  std::uint32_t leaf_points = 8;
  double position_error = 0;  // no coordinate of a point differs by more from the input's
  std::vector<Attribute> attributes;
  std::vector<Alias> aliases;
  std::vector<Column> columns;
  std::vector<std::string> size_bounds = {"octant"};
  std::string provenance = "{}";  // a JSON object
  std::optional<BoundaryInfo> boundary = std::nullopt;
  std::optional<CellsInfo> cells = std::nullopt;
  int up = -1;  // axis that points upwards in pictures: 0 x, 1 y, 2 z; -1: not known

  // Of a time series: the attributes that every step has. The file's own `attributes` are then empty, and its columns
  // are those that all steps share.
  std::optional<std::vector<SeriesAttribute>> series = std::nullopt;

  [[nodiscard]] std::size_t resolutions() const { return resolution_counts.size(); }
  [[nodiscard]] std::uint64_t point_count() const { return resolution_counts.back(); }

  /// Returns the finest resolution of at most so many points, or the coarsest if all have more.
  [[nodiscard]] std::size_t finest_within(std::uint64_t most_points) const;

  /// Returns the number of points of each segment.
  [[nodiscard]] std::vector<std::uint64_t> segment_counts() const;

  /// Returns the most points that a group has.
  [[nodiscard]] std::uint64_t largest_group() const;

  /// Returns the index of a column, -1 if the file does not have it.
  [[nodiscard]] int find_column(ColumnKind kind, int attribute = -1) const;

  /// Returns the index of an attribute, by its name or an alias; -1 if the file does not have it.
  [[nodiscard]] int find_attribute(const std::string& name) const;
};

/// Returns the index of an attribute, by its name or an alias. Fails with invalid_argument if there is none of this
/// name; the message begins with `file_name` and lists the attributes and aliases of the file.
[[nodiscard]] Result<int> find_attribute(const VolumeInfo& info, const std::string& name, const std::string& file_name);

/// Write and read the metadata (spec section 4). Both check every rule of this section, so that everything written can
/// be read. Bytes of a name that are not UTF-8 are replaced.
[[nodiscard]] Result<std::string> metadata_to_json(const VolumeInfo& info);
[[nodiscard]] Result<VolumeInfo> metadata_from_json(const std::string& json);

/// The metadata of a time step (spec section 11).
struct StepInfo {
  double time = 0;
  std::vector<Attribute> attributes;
  std::vector<Column> columns;  // each of one attribute
  std::uint32_t rows_per_directory_page = 256;
  std::string provenance = "{}";  // a JSON object
};

/// As metadata_to_json and metadata_from_json, for a step of the series that `info` describes.
[[nodiscard]] Result<std::string> step_to_json(const StepInfo& step, const VolumeInfo& info);
[[nodiscard]] Result<StepInfo> step_from_json(const std::string& json, const VolumeInfo& info);

/// Returns the description of a series at a step: the columns of the step behind those of the series, and the step's
/// attributes.
[[nodiscard]] VolumeInfo at_step(VolumeInfo info, const StepInfo& step);

/// Consecutive points of one segment, whose columns are chunks.
struct Group {
  std::size_t segment;
  std::uint64_t begin;  // number of its first point
  std::uint32_t count;
};

/// The numbering of groups, rows, chunks and directory pages, by arithmetic alone (spec/svol-1.md, introduction).
class RowLayout {
 public:
  RowLayout() = default;
  explicit RowLayout(const VolumeInfo& info);

  /// The layout of the rows of a step: its columns are numbered from 0.
  RowLayout(const VolumeInfo& info, const StepInfo& step);

  [[nodiscard]] std::uint64_t group_count() const { return first_group_.back(); }
  [[nodiscard]] std::uint64_t row_count() const { return first_row_.back(); }

  [[nodiscard]] Group group(std::uint64_t index) const;

  /// Returns the group of point `index` of a segment.
  [[nodiscard]] std::uint64_t group_at(std::size_t segment, std::uint64_t index) const {
    return first_group_[segment] + index / points_per_chunk_[segment];
  }

  /// Returns the number of row (resolution, group). Requires that the group's segment <= resolution.
  [[nodiscard]] std::uint64_t row(std::size_t resolution, std::uint64_t group) const {
    return first_row_[resolution] + group;
  }
  /// Returns the first row of a resolution; of R + 1, the number of rows.
  [[nodiscard]] std::uint64_t first_row(std::size_t resolution) const { return first_row_[resolution]; }
  [[nodiscard]] std::size_t resolution_of_row(std::uint64_t row) const;
  [[nodiscard]] std::uint64_t group_of_row(std::uint64_t row) const { return row - first_row_[resolution_of_row(row)]; }

  /// Returns the columns of a row, as indices into VolumeInfo::columns.
  [[nodiscard]] const std::vector<int>& columns_of_row(std::uint64_t row) const;

  /// Returns how many chunks the rows [0, row) have, which is the number of the row's first chunk.
  [[nodiscard]] std::uint64_t chunks_before(std::uint64_t row) const;

  [[nodiscard]] std::uint64_t directory_page_count() const;
  [[nodiscard]] std::uint64_t directory_page_of_row(std::uint64_t row) const { return row / rows_per_page_; }
  [[nodiscard]] std::uint64_t first_row_of_directory_page(std::uint64_t page) const { return page * rows_per_page_; }

  /// Returns how many chunks the rows of a directory page have.
  [[nodiscard]] std::uint64_t chunks_of_directory_page(std::uint64_t page) const;

 private:
  std::vector<std::uint64_t> counts_;
  std::vector<std::uint32_t> points_per_chunk_;  // [segment]
  std::uint32_t rows_per_page_ = 1;
  std::vector<std::uint64_t> first_group_;  // [segment], and the total
  std::vector<std::uint64_t> first_row_;    // [resolution], and the total
  std::vector<int> all_columns_;
  std::vector<int> resolution_columns_;
};

}  // namespace splatvol::format
