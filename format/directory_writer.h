// The directory of rows that are written one after another (spec/svol-1.md, section 5).
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/temp_file.h"
#include "format/codec.h"
#include "format/columns.h"
#include "format/layout.h"
#include "format/volume_info.h"

namespace splatvol::format {

/// Returns how many rows a directory page should cover, for rows of at most `columns` chunks.
[[nodiscard]] std::uint32_t choose_rows_per_page(std::size_t columns, std::uint64_t row_count);

/// Returns how long a preamble should be. `bytes`: of the file or the step; `rows_offset`: where its rows begin;
/// `resolution_ends`: where those of each resolution end.
[[nodiscard]] std::uint64_t choose_preamble_bytes(std::uint64_t bytes, std::uint64_t rows_offset,
                                                  std::span<const std::uint64_t> resolution_ends);

/// Makes the pages of a directory. Holds one page, page 0 and the references. Not thread-safe.
class DirectoryWriter {
 public:
  /// `tail`: gets the pages behind page 0.
  DirectoryWriter(RowLayout rows, std::uint32_t rows_per_page, TempFile tail)
      : rows_(std::move(rows)), rows_per_page_(rows_per_page), tail_(std::move(tail)) {}

  /// Adds the next row, whose chunks begin at `offset`. Fails if it has another number of chunks.
  [[nodiscard]] Status add_row(std::span<const ChunkEntry> entries, std::uint64_t offset);

  [[nodiscard]] const RowLayout& rows() const { return rows_; }
  [[nodiscard]] std::uint64_t next_row() const { return next_row_; }

  /// Returns the offset behind the rows of each resolution that is whole.
  [[nodiscard]] const std::vector<std::uint64_t>& resolution_ends() const { return resolution_ends_; }

  /// Returns the bytes of the root, which are known from the beginning.
  [[nodiscard]] std::uint64_t root_bytes() const;

  /// Returns the root: the references, then page 0. The root begins at `root_offset`, the tail at `tail_offset`.
  /// Called once, after the last row.
  [[nodiscard]] Bytes pack_root(std::uint64_t root_offset, std::uint64_t tail_offset);

  [[nodiscard]] TempFile& tail() { return tail_; }

  /// Reads a chunk of a group back, in the row of the resolution that adds it. `columns`: those that the rows have;
  /// `read(offset, bytes)` reads what add_row() got the offset of. Fails if there is no such column. Requires that
  /// pack_root() has not been called. Thread-safe, if `read` is.
  using ReadBytes = std::function<Status(std::uint64_t offset, std::span<std::byte> bytes)>;
  [[nodiscard]] Result<PackedChunk> read_chunk(std::span<const Column> columns, ColumnKind kind, int attribute,
                                               std::uint64_t group, const ReadBytes& read) const;

 private:
  struct Found {
    std::uint64_t offset;
    ChunkEntry entry;
  };
  [[nodiscard]] Result<Found> find_chunk(std::uint64_t row, std::uint64_t column) const;
  [[nodiscard]] Status close_page();
  [[nodiscard]] std::uint64_t refs_bytes() const;

  RowLayout rows_;
  std::uint32_t rows_per_page_;
  TempFile tail_;
  std::uint64_t next_row_ = 0;
  Bytes page_;                                  // being filled
  Bytes head_;                                  // page 0
  std::vector<DirectoryPageRef> refs_;          // until `pack_root`, offsets count from the start of the tail
  std::vector<std::uint64_t> resolution_ends_;  // [resolution]
};

/// Passes the bytes of a temporary file on, part by part, and gives the disk space of each part back. They stay if they
/// are to be read again.
template <class Append>
[[nodiscard]] Status move_bytes(TempFile& from, const Append& append, bool stay = false) {
  constexpr std::uint64_t copied_at_once = 1u << 20;
  Bytes part(static_cast<std::size_t>(std::min(from.size(), copied_at_once)));
  for (std::uint64_t offset = 0; offset < from.size(); offset += part.size()) {
    part.resize(static_cast<std::size_t>(std::min<std::uint64_t>(part.size(), from.size() - offset)));
    SPLATVOL_TRY(from.read(offset, part));
    SPLATVOL_TRY(append(std::span<const std::byte>(part)));
    if (!stay) from.release(offset, part.size());
  }
  return {};
}

}  // namespace splatvol::format
