// Packed rows on their way into the file.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "base/temp_file.h"
#include "builder/output/row_packer.h"
#include "format/codec.h"

namespace splatvol {

/// Calls visit(segment, level) for the rows of each segment at each level, in the order in which a file has them, until
/// a call fails. `levels`: how many there are.
template <class Visit>
[[nodiscard]] Status for_each_stream(std::size_t levels, const Visit& visit) {
  for (std::size_t level = levels; level-- > 0;)
    for (std::size_t segment = levels; segment-- > level;) SPLATVOL_TRY(visit(segment, level));
  return {};
}

/// Keeps packed rows in temporary files: one file for each segment at each level, so that each is read from its
/// beginning to its end. Where the process may have few files open, some share one. The finest rows are the last of the
/// file and more than half of it: their chunks go where they are to stay, and only their entries into a temporary file.
class RowFiles {
 public:
  /// `folder`: for the temporary files. `finest`: gets the chunks of segment 0 at level 0, side by side; must outlive
  /// this.
  RowFiles(std::string folder, AtomicFile& finest) : folder_(std::move(folder)), finest_(&finest) {}

  /// All chunks go into temporary files.
  explicit RowFiles(std::string folder) : folder_(std::move(folder)) {}
  RowFiles(const RowFiles&) = delete;
  RowFiles& operator=(const RowFiles&) = delete;

  /// Writes the next packed row of its segment and level.
  [[nodiscard]] Status write(const PendingRow& row);

  /// The same for a row that stands before all others of its segment and level.
  [[nodiscard]] Status write_first(const PendingRow& row);

  /// Bytes of the chunks of a segment at a level.
  [[nodiscard]] std::uint64_t chunk_bytes(std::size_t segment, std::size_t level) const;

  /// Bytes of all chunks that went into temporary files.
  [[nodiscard]] std::uint64_t coarse_bytes() const { return coarse_bytes_; }

  /// Gets the entries of a row's chunks, and the chunks side by side; none if they are where they are to stay.
  using Visit = std::function<Status(std::span<const format::ChunkEntry>, std::span<const std::byte>)>;

  /// Visits each row in file order, and gives its disk space back. `levels`: how many there are.
  [[nodiscard]] Status read(std::size_t levels, const Visit& visit);

  /// The same for the rows of one segment at one level.
  [[nodiscard]] Status read(std::size_t segment, std::size_t level, const Visit& visit);

 private:
  struct Extent {
    std::uint64_t offset, bytes;
  };
  // The rows of a segment at a level.
  struct Stream {
    TempFile* file = nullptr;     // null: no row yet
    std::size_t entry_bytes = 0;  // of each row
    std::vector<Extent> rows;
  };

  // Rows of a stream that were read together.
  struct RowBlock {
    format::Bytes bytes;
    std::size_t first = 0, end = 0;
  };

  [[nodiscard]] Result<Stream*> open_stream(const PendingRow& row);
  [[nodiscard]] static Status read_next(Stream& stream, std::size_t first, RowBlock& block);
  [[nodiscard]] static Status read(Stream& stream, const Visit& visit);

  std::string folder_;
  AtomicFile* finest_ = nullptr;
  std::uint64_t coarse_bytes_ = 0;
  std::deque<TempFile> files_;
  std::vector<std::vector<Stream>> streams_;  // [segment][level]
};

/// Packs rows in parallel, some at a time, and writes them in their order. Frees each row once it is written.
[[nodiscard]] Status write_rows(std::span<PendingRow> rows, const RowPacker& packer, RowFiles& files);

}  // namespace splatvol
