// Rows of the file: the chunks of one group at one resolution.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "builder/output/splat_columns.h"
#include "format/codec.h"
#include "format/volume_info.h"

namespace splatvol {

/// The chunks of a row as bytes: their entries (format::ChunkEntry), then their contents.
struct PackedRow {
  format::Bytes bytes;
  std::size_t entry_bytes = 0;  // of the entries
};

/// A row on its way into a file. Levels are counted as in Member.
struct PendingRow {
  std::size_t segment = 0, level = 0;    // the segment is named by the last level that has its points
  std::unique_ptr<SplatColumns> splats;  // null: packed already
  PackedRow packed;
};

/// Packs rows. Thread-safe.
class RowPacker {
 public:
  /// `info`: attributes and columns.
  explicit RowPacker(const format::VolumeInfo& info);

  /// Packs the columns of the splats, and those of their points if it has some.
  [[nodiscard]] PackedRow pack(const SplatColumns& splats) const;

  /// Packs a row that is not packed yet.
  void pack(PendingRow& row) const;

 private:
  std::vector<format::Attribute> attributes_;
  std::vector<format::Column> all_columns_, resolution_columns_;
};

}  // namespace splatvol
