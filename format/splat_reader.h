// Reads the splats of one resolution, group by group.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "base/part_table.h"
#include "format/volume_chunks.h"

namespace splatvol::format {

/// The part of a file to read.
struct SplatSelection {
  std::size_t resolution = 0;
  std::vector<std::size_t> attributes;  // indices into VolumeInfo::attributes
  std::vector<std::string> names;       // [attribute of the selection]: its name in the output, which may be an alias
  Box box{dvec3(-std::numeric_limits<double>::infinity()), dvec3(std::numeric_limits<double>::infinity())};

  void add(std::size_t attribute, std::string name) {
    attributes.push_back(attribute);
    names.push_back(std::move(name));
  }
};

/// Makes a selection from a resolution (none: the finest) and names of attributes or aliases (none: all of both). Fails
/// if the file does not have the resolution or an attribute (the message lists what it has), or lacks splat moments of
/// an attribute.
[[nodiscard]] Result<SplatSelection> select_splats(const Volume& volume, std::optional<std::size_t> resolution,
                                                   const std::vector<std::string>& attributes, const Box& box);

/// Points of the file with their material, in file order: [splat], or [attribute of the selection][splat].
struct SplatGroup {
  std::vector<dvec3> positions;
  std::vector<std::vector<float>> values;  // stored; NaN: missing
  std::vector<dvec3> centroids;
  std::vector<SplatShape> shapes;
  std::vector<std::vector<SplatValue>> materials;
  std::vector<std::vector<vec3>> directions;  // of the values' gradients, as stored; empty if the file has none

  [[nodiscard]] std::size_t size() const { return std::max(positions.size(), centroids.size()); }
};

/// Memory for the directory pages that reading group by group uses again.
inline constexpr std::uint64_t splat_reader_bytes = std::uint64_t{16} << 20;

/// Reads the groups of a resolution. Thread-safe.
class SplatReader {
 public:
  /// The volume and the selection must outlive the reader. `room`: for directory pages.
  SplatReader(const Volume& volume, const SplatSelection& selection, const PartRoom& room)
      : volume_(volume), selection_(selection), chunks_(volume, room) {}

  [[nodiscard]] std::uint64_t group_count() const;

  /// Selects the parts of a SplatGroup to read. The others stay empty.
  struct Parts {
    bool positions = false, values = false, material = false, directions = false;
  };
  [[nodiscard]] Result<SplatGroup> read(std::uint64_t group, Parts parts) const;

 private:
  /// Reads and unpacks a chunk of a row with unpack(entry, bytes, what).
  template <class Unpack>
  [[nodiscard]] Status read_chunk(std::uint64_t row, ColumnKind kind, int attribute, const Unpack& unpack) const;

  const Volume& volume_;
  const SplatSelection& selection_;
  VolumeChunks chunks_;
};

}  // namespace splatvol::format
