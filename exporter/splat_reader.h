// The splats of one resolution, decoded a group at a time.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/volume.h"

namespace splatvol {

/// What of a file is exported.
struct ExportSelection {
  std::size_t resolution = 0;
  std::vector<std::size_t> attributes;  // indices into VolumeInfo::attributes
  Box box{dvec3(-std::numeric_limits<double>::infinity()), dvec3(std::numeric_limits<double>::infinity())};
};

/// Finds what is named: no resolution is the finest, no attributes are all. Fails where the file has no such resolution
/// or attribute (the message says what there is), or no splat moments of one.
[[nodiscard]] Result<ExportSelection> select(const format::Volume& volume, std::optional<std::size_t> resolution,
                                             const std::vector<std::string>& attributes, const Box& box);

/// Points of the file and what they stand for, in file order. [splat], or [attribute][splat] by the selection.
struct SplatGroup {
  std::vector<dvec3> positions;
  std::vector<std::vector<float>> values;  // stored; NaN: missing
  std::vector<dvec3> centroids;
  std::vector<format::SplatShape> shapes;
  std::vector<std::vector<format::SplatValue>> materials;
  std::vector<std::vector<vec3>> directions;  // of the values' gradients, as stored; empty where the file has none

  [[nodiscard]] std::size_t size() const { return std::max(positions.size(), centroids.size()); }
};

/// Reads the groups of a resolution. Holds some pages of the directory. Thread-safe.
class SplatReader {
 public:
  /// Both must outlive this.
  SplatReader(const format::Volume& volume, const ExportSelection& selection)
      : volume_(volume), selection_(selection) {}

  [[nodiscard]] std::uint64_t group_count() const;

  /// Which parts of a SplatGroup are read: the others stay empty.
  struct Parts {
    bool positions = false, values = false, material = false, directions = false;
  };
  [[nodiscard]] Result<SplatGroup> read(std::uint64_t group, Parts parts) const;

 private:
  using Page = std::shared_ptr<const format::DirectoryPage>;
  [[nodiscard]] Result<Page> page_of(std::uint64_t row) const;

  /// Reads and unpacks a chunk of a row with unpack(entry, bytes, what).
  template <class Unpack>
  [[nodiscard]] Status read_chunk(std::uint64_t row, format::ColumnKind kind, int attribute,
                                  const Unpack& unpack) const;

  const format::Volume& volume_;
  const ExportSelection& selection_;
  mutable std::mutex mutex_;
  mutable std::vector<Page> pages_;  // the last used at the end
};

/// Calls take(group), in order, with all groups of the reader, some of which are read at a time; stops where one fails.
[[nodiscard]] Status for_each_group(const SplatReader& reader, SplatReader::Parts parts,
                                    const std::function<Status(const SplatGroup&)>& take,
                                    const std::function<void(double)>& progress);

}  // namespace splatvol
