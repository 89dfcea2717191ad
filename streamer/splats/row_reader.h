// From a cut to rows of records: finds the rows of its nodes, and reads those that are not there.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <set>
#include <span>
#include <unordered_map>
#include <vector>

#include "base/error.h"
#include "format/volume.h"
#include "streamer/splats/cut.h"
#include "streamer/splats/paged_volume.h"
#include "streamer/splats/visibility.h"
#include "streamer/store/parts.h"

namespace splatvol {

/// Consecutive points of a group.
struct GroupPart {
  std::uint64_t group;
  std::uint32_t begin;
  std::uint32_t count;
};

/// Splits ranges[segment] at the borders of groups, and calls visit(part) for each part until it returns false. Returns
/// whether it never did.
template <class Visit>
bool visit_groups(const format::Volume& volume, std::span<const PointRange> ranges, const Visit& visit) {
  const format::RowLayout& rows = volume.rows();
  for (std::size_t segment = 0; segment < ranges.size(); ++segment) {
    const std::uint64_t segment_begin = segment == 0 ? 0 : volume.info().resolution_counts[segment - 1];
    for (PointRange left = ranges[segment]; left.count > 0;) {
      const std::uint64_t number = rows.group_at(segment, left.begin - segment_begin);
      const format::Group group = rows.group(number);
      const auto begin = static_cast<std::uint32_t>(left.begin - group.begin);
      const auto count = static_cast<std::uint32_t>(std::min<std::uint64_t>(left.count, group.count - begin));
      left = {left.begin + count, left.count - count};
      if (!visit(GroupPart{number, begin, count})) return false;
    }
  }
  return true;
}

/// Names a row of the file.
struct RowName {
  std::uint32_t resolution;
  std::uint64_t group;

  /// Different for each row of a file.
  [[nodiscard]] std::uint64_t number() const { return std::uint64_t{resolution} << 56 | group; }
};

/// Consecutive records of a row that an item of a cut draws.
struct RowPart {
  RowName row;
  std::uint32_t begin, count;
  std::uint32_t item;
};

/// A row that is there, as long as somebody holds this.
struct HeldRow {
  PartPointer shapes, values;

  [[nodiscard]] bool is_whole() const { return shapes && values; }
  [[nodiscard]] RecordRow row() const { return {*part_as<ShapePart>(shapes), *part_as<ValuePart>(values)}; }
};
using HeldRows = std::unordered_map<std::uint64_t, HeldRow>;  // [RowName::number]

/// Reads the rows of cuts. Values come with those of the volume's second attribute, if it has one. Not thread-safe;
/// reads and decodes on its own threads.
class RowReader {
 public:
  /// `gradients`: reads gradients too, for the kernel octant. Fails with unsupported if the file lacks a column that is
  /// needed.
  [[nodiscard]] static Result<RowReader> create(PagedVolume& volume, KernelKind kernel, bool gradients);

  /// Returns the parts of rows that a cut draws, item after item. Leaves out rows in which nothing is visible. Reads
  /// directory pages only, all together.
  [[nodiscard]] Result<std::vector<RowPart>> plan(const Cut& cut, const ValueVisibility& visibility);

  /// Returns the rows of a plan. Reads and decodes those that are not there. Errors name the file and the
  /// chunk. Fails with out_of_budget if they do not fit.
  [[nodiscard]] Result<HeldRows> hold(std::span<const RowPart> plan);

  /// Returns the least bytes that `hold` needs at once, besides the rows: those of one row.
  [[nodiscard]] std::uint64_t working_bytes() const;

  /// Returns the bytes of all rows of a cut and of their directory pages, as if everything were visible.
  [[nodiscard]] std::uint64_t row_bytes(const Cut& cut) const;

  /// The same for all rows of resolution 0.
  [[nodiscard]] std::uint64_t coarsest_row_bytes() const;

  /// Where a chunk is: its row in the file, which its column's scope tells, and its column.
  struct ChunkName {
    std::uint64_t row;
    int column;
  };

  /// The parts of a row: keys, and the names of the chunks.
  [[nodiscard]] PartKey shapes_key(const RowName& name) const;
  [[nodiscard]] PartKey values_key(const RowName& name) const;
  [[nodiscard]] std::array<PartKey, 2> keys(const RowName& name) const { return {shapes_key(name), values_key(name)}; }
  [[nodiscard]] std::vector<ChunkName> chunks(const RowName& name, int kind) const;

  /// The chunks that tell whether anything of a row is visible. The second one is of the opacity attribute.
  [[nodiscard]] ChunkName value_chunk(const RowName& name) const { return chunk_name(name, value_columns_.front()); }
  [[nodiscard]] std::optional<ChunkName> opacity_chunk(const RowName& name) const {
    return has_opacity() ? std::optional(chunk_name(name, value_columns_.back())) : std::nullopt;
  }

  /// Returns a part of a row, without reservations and without the locations of its chunks.
  [[nodiscard]] PartLoad load_of(const RowName& name, const PartKey& key) const;

  [[nodiscard]] KernelKind kernel() const { return kernel_; }
  [[nodiscard]] bool has_gradients() const { return gradients_; }
  [[nodiscard]] bool has_opacity() const { return volume_->attributes().opacity >= 0; }
  [[nodiscard]] const std::vector<int>& columns(int kind) const {
    return kind == format::row_shapes ? shape_columns_ : value_columns_;
  }

 private:
  struct Wave;
  [[nodiscard]] const PartRoom& room() const { return volume_->room(); }
  template <class Visit>
  void visit_rows(const Cut& cut, const Visit& visit) const;
  void add_directory_pages(const RowName& name, std::set<std::uint64_t>& pages) const;
  RowReader(PagedVolume& volume, KernelKind kernel, bool gradients, std::vector<int> shapes, std::vector<int> values)
      : volume_(&volume),
        kernel_(kernel),
        gradients_(gradients),
        shape_columns_(std::move(shapes)),
        value_columns_(std::move(values)) {}
  [[nodiscard]] const format::Column& column(int index) const;
  [[nodiscard]] ChunkName chunk_name(const RowName& name, int column) const;
  [[nodiscard]] std::uint64_t row_of(const RowName& name, int column) const;
  [[nodiscard]] Status add_row(const RowName& name, Wave& wave);
  [[nodiscard]] Status load(Wave& wave, HeldRows& rows);

  PagedVolume* volume_;
  KernelKind kernel_;
  bool gradients_;
  std::vector<int> shape_columns_;  // position, octant; or centroid, moments
  std::vector<int> value_columns_;  // value, perhaps gradient; or value_moments. Last, if there is one, of the opacity
};

}  // namespace splatvol
