// Writes a .svol file front to back (spec/svol-1.md).
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "base/temp_file.h"
#include "format/columns.h"
#include "format/layout.h"
#include "format/octree.h"
#include "format/volume_info.h"

namespace splatvol::format {

/// Counts of values in each of the 64 bins, for each attribute.
using Histograms = std::vector<std::array<std::uint64_t, 64>>;

/// A file in the making. Rows are appended in row order; nothing stands under the final name before `finish`. Holds
/// some MiB, however many rows there are. Not thread-safe; packing the chunks beforehand may be spread over threads.
class VolumeWriter {
 public:
  /// Reserves the preamble. Fails where the file cannot be created, or a temporary one in `temporary_folder`, where
  /// `info` breaks a rule of the specification or does not fit `index`, or where metadata, root index page and
  /// directory root alone pass 1 MiB (thousands of attributes). Chooses info.rows_per_directory_page.
  [[nodiscard]] static Result<std::unique_ptr<VolumeWriter>> create(const std::string& path, VolumeInfo info,
                                                                    PackedIndex index,
                                                                    const std::string& temporary_folder);

  /// The same of a file that holds the bytes of the last rows already, and nothing else; those of the rows before them
  /// will be `bytes_before`. They are moved to their place without being copied, if there are many and the file system
  /// can; the file is the same however.
  [[nodiscard]] static Result<std::unique_ptr<VolumeWriter>> create(AtomicFile file, std::uint64_t bytes_before,
                                                                    VolumeInfo info, PackedIndex index,
                                                                    const std::string& temporary_folder);

  /// Appends the next row: one chunk for each of its columns, in order.
  [[nodiscard]] Status append_row(std::span<const PackedChunk> chunks);

  /// The same of chunks whose bytes lie side by side.
  [[nodiscard]] Status append_row(std::span<const ChunkEntry> entries, std::span<const std::byte> bytes);

  /// Names the chunks of the next row, whose bytes were in the file before.
  [[nodiscard]] Status add_written_row(std::span<const ChunkEntry> entries);

  /// Writes what follows the rows, then the preamble, and gives the file its name. Requires all rows.
  [[nodiscard]] Status finish(const Histograms& histograms);

  [[nodiscard]] const RowLayout& rows() const { return rows_; }

  /// Bytes of the finished file; 0 before.
  [[nodiscard]] std::uint64_t file_bytes() const { return file_bytes_; }

 private:
  VolumeWriter(AtomicFile file, VolumeInfo info, PackedIndex index, TempFile directory_tail);
  [[nodiscard]] Status reserve_front(std::uint64_t bytes_before);
  [[nodiscard]] std::uint64_t directory_page_bytes(std::uint64_t page) const;
  [[nodiscard]] Status close_directory_page();
  void add_section(SectionKind kind, bool critical, std::uint64_t offset, std::span<const std::byte> packed,
                   std::uint64_t unpacked_bytes, Codec codec);
  void add_extent(SectionKind kind, std::uint64_t offset, std::uint64_t bytes);
  [[nodiscard]] std::uint64_t choose_preamble_bytes() const;

  AtomicFile file_;
  VolumeInfo info_;
  RowLayout rows_;
  std::uint64_t page_count_ = 0;
  std::uint64_t front_bytes_ = 0;  // superblock and section table
  std::uint64_t padding_offset_ = 0;
  std::uint64_t rows_offset_ = 0;
  std::uint64_t rows_end_ = 0;  // of those that are appended or named
  std::uint64_t next_row_ = 0;
  std::uint64_t file_bytes_ = 0;
  Bytes metadata_raw_;
  Bytes metadata_;
  PackedIndex index_;
  Bytes directory_page_;                          // the one being filled
  Bytes directory_head_;                          // page 0, kept for the preamble
  TempFile directory_tail_;                       // the other pages
  std::vector<DirectoryPageRef> directory_refs_;  // offsets of the tail's pages from its start until `finish`
  std::vector<std::uint64_t> resolution_ends_;    // where each resolution's rows end
  std::vector<SectionEntry> sections_;
};

}  // namespace splatvol::format
