// Rows of the file: the chunks of one group at one resolution.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "base/error.h"
#include "base/temp_file.h"
#include "builder/output/density.h"
#include "builder/output/splat_columns.h"
#include "format/codec.h"
#include "format/volume_info.h"

namespace splatvol {

/// The chunks of a row as bytes: their entries (format::ChunkEntry), then their contents.
struct PackedRow {
  format::Bytes bytes;
  std::size_t entry_bytes = 0;  // of the entries
};

/// Bytes in a temporary file.
struct FilePart {
  std::uint64_t offset, bytes;
};

/// A row on its way into a file. Levels are counted as in Member.
struct PendingRow {
  std::size_t segment = 0, level = 0;    // the segment is named by the last level that has its points
  std::unique_ptr<SplatColumns> splats;  // null: packed already
  PackedRow packed;
  std::vector<format::PackedChunk> chunks = {};  // after pack_early: of all columns, but that of the moments is empty
  bool has_points = false;                       // after pack_early

  // For rows that wait for their densities.
  const std::vector<FittedSplat>* fitted = nullptr;  // [number of a splat]; null: rows have their shapes
  const TempFile* spool = nullptr;                   // holds what was written out
  std::vector<FilePart> written = {};                // in the spool: the row's first splats
  std::size_t written_splats = 0;                    // in these parts
  std::optional<std::uint64_t> chunks_at = {};       // offset in the spool: the bytes of `chunks`
};

/// Reads the splats of a row that were written out, and puts them before the others. Thread-safe for different rows.
[[nodiscard]] Status read_written(PendingRow& row);

/// Packs rows. Thread-safe.
class RowPacker {
 public:
  /// `info`: attributes and columns.
  explicit RowPacker(const format::VolumeInfo& info);

  /// Packs the columns of the splats, and those of their points if it has some.
  [[nodiscard]] PackedRow pack(const SplatColumns& splats) const;

  /// Packs a row that is not packed yet. Fails only if it cannot read what was written out.
  [[nodiscard]] Status pack(PendingRow& row) const;

  /// Packs the columns that do not depend on densities, and frees what they were packed from. Before pack(row) only
  /// the densities may change. Requires a whole row.
  void pack_early(PendingRow& row) const;

 private:
  std::vector<format::Attribute> attributes_;
  std::vector<format::Column> all_columns_, resolution_columns_;
};

}  // namespace splatvol
