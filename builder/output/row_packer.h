// Rows of the file: the chunks of one group at one resolution.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "base/error.h"
#include "base/temp_file.h"
#include "builder/output/splat_columns.h"
#include "format/codec.h"
#include "format/volume_info.h"
#include "format/volume_writer.h"

namespace splatvol {

/// The chunks of a row.
using PackedRow = std::vector<format::PackedChunk>;

/// Bytes in a temporary file.
struct FilePart {
  std::uint64_t offset, bytes, hash;
};

/// A row on its way into a file. Levels are counted as in Member.
struct PendingRow {
  std::size_t segment = 0, level = 0;    // the segment is named by the last level that has its points
  std::unique_ptr<SplatColumns> splats;  // null: packed already
  PackedRow packed;
  std::size_t absent = 0;  // the row's first splats, which are held elsewhere

  const TempFile* spool = nullptr;     // holds what was written out
  std::vector<FilePart> written = {};  // in the spool: the row's first splats
  std::size_t written_splats = 0;      // in these parts
};

/// Reads the splats of a row that were written out, and puts them before the others. Thread-safe for different rows.
[[nodiscard]] Status read_written(PendingRow& row);

/// Facts about the points of packed rows, as they are stored.
struct StoredSummary {
  double position_error = 0;                      // the largest that a chunk states, world units
  std::vector<format::StoredValues> values = {};  // [attribute]

  /// Adds the facts about other points.
  void include(const StoredSummary& other);

  [[nodiscard]] format::Histograms histograms() const;
};

/// Which columns are stored as they are given.
struct ExactColumns {
  bool positions = false;
  bool values = false;  // to the single precision of stored values
};

/// Packs rows. Thread-safe.
class RowPacker {
 public:
  /// `info`: cube, attributes and columns.
  explicit RowPacker(const format::VolumeInfo& info, ExactColumns exact = {});

  /// Packs the columns of the splats, and those of their points if it has some.
  [[nodiscard]] PackedRow pack(const SplatColumns& splats) const;

  /// Packs a row that is not packed yet. Fails only if it cannot read what was written out.
  [[nodiscard]] Status pack(PendingRow& row) const;

  /// Returns the facts about all points that were packed so far.
  [[nodiscard]] StoredSummary summary() const;

 private:
  class ChunkPacker;
  void include(const StoredSummary& row) const;

  Cube cube_;
  ExactColumns exact_;
  std::vector<format::Attribute> attributes_;
  std::vector<format::Column> all_columns_, resolution_columns_;
  mutable std::mutex mutex_;
  mutable StoredSummary summary_;
};

}  // namespace splatvol
