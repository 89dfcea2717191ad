// Reads a .svol file part by part (spec/svol-1.md). Holds the preamble, and reads everything else on demand.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "format/columns.h"
#include "format/layout.h"
#include "format/octree.h"
#include "format/volume_info.h"
#include "format/volume_writer.h"

namespace splatvol::format {

/// The offset of a chunk, with its directory entry.
struct ChunkLocation {
  std::uint64_t offset = 0;
  ChunkEntry entry{};
};

/// The chunk entries of consecutive rows.
struct DirectoryPage {
  std::uint64_t first_row = 0;
  std::uint64_t first_chunk = 0;  // number of its first chunk
  std::vector<ChunkLocation> chunks;

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return sizeof(DirectoryPage) + chunks.size() * sizeof(ChunkLocation);
  }
};

/// An open file. Checks every byte against its hash and its rules before using it. Errors begin with the file's name.
/// Thread-safe, as its ByteSource is.
class Volume {
 public:
  /// Reads the preamble, in one read if the writer followed the advice of the specification.
  [[nodiscard]] static Result<std::shared_ptr<const Volume>> open(std::unique_ptr<ByteSource> source);

  [[nodiscard]] const VolumeInfo& info() const { return info_; }
  [[nodiscard]] const RowLayout& rows() const { return rows_; }
  [[nodiscard]] const std::string& name() const { return source_->name(); }
  [[nodiscard]] std::uint64_t file_bytes() const { return source_->size(); }
  [[nodiscard]] std::uint64_t preamble_bytes() const { return preamble_bytes_; }

  /// Sections, in file order.
  [[nodiscard]] const std::vector<SectionEntry>& sections() const { return sections_; }

  /// Bytes held: the preamble and the directory root. For budgets.
  [[nodiscard]] std::uint64_t memory_bytes() const {
    return preamble_.size() + directory_refs_.size() * sizeof(DirectoryPageRef);
  }

  /// Returns how many bytes were read from the source so far.
  [[nodiscard]] std::uint64_t bytes_read() const { return bytes_read_; }

  /// Reads the page with the root node, and its summaries of `attribute`; -1: no summaries.
  [[nodiscard]] Result<IndexPage> read_index_root(int attribute) const;

  /// Reads a page that a node links to. `child_mask` and `parent_counts` are those of the linking node: fails if the
  /// counts of its children do not add up to `parent_counts`.
  [[nodiscard]] Result<IndexPage> read_index_page(const IndexPageRef& ref, std::uint8_t child_mask,
                                                  std::span<const std::uint64_t> parent_counts, int attribute) const;

  [[nodiscard]] std::uint64_t directory_page_of_row(std::uint64_t row) const {
    return rows_.directory_page_of_row(row);
  }
  [[nodiscard]] Result<DirectoryPage> read_directory_page(std::uint64_t page) const;

  /// Finds a chunk in the page that covers its row. Requires a column that the row has.
  [[nodiscard]] const ChunkLocation& find_chunk(const DirectoryPage& page, std::uint64_t row, int column) const;

  /// Reads packed bytes: from the preamble if it holds them, else from the source, which `bytes_read` counts.
  [[nodiscard]] Result<Bytes> read_bytes(std::uint64_t offset, std::uint64_t count) const;

  /// See ByteSource.
  [[nodiscard]] std::uint64_t cheap_gap() const { return source_->cheap_gap(); }

  /// Reads the counts of values for each attribute. Returns none if the file has no such section.
  [[nodiscard]] Result<Histograms> read_histograms() const;

  /// Reads and checks every byte of the file: hashes, tiling, every column, counts of the index, values against ranges,
  /// occupancy and histograms, positions against the cube, footer. Calls `progress` with the share done, in [0, 1].
  /// Memory does not grow with the number of points.
  [[nodiscard]] Status verify(const std::function<void(double)>& progress) const;

 private:
  explicit Volume(std::unique_ptr<ByteSource> source);
  [[nodiscard]] Status read_preamble();
  [[nodiscard]] Status read_section_table();
  [[nodiscard]] Status check_sections() const;
  [[nodiscard]] tl::unexpected<Error> broken(std::string_view rule) const;
  [[nodiscard]] Status read_metadata();
  [[nodiscard]] Status read_directory_root();
  [[nodiscard]] const SectionEntry* find_section(SectionKind kind) const;
  [[nodiscard]] Result<Bytes> read_section(const SectionEntry& section) const;
  [[nodiscard]] IndexPageRef root_ref() const;
  [[nodiscard]] Result<IndexPage> read_page(const IndexPageRef& ref, std::uint64_t offset, std::uint32_t top_nodes,
                                            std::uint64_t links_end, int attribute) const;
  [[nodiscard]] Status check_top_counts(const IndexPage& page, std::span<const std::uint64_t> expected) const;
  [[nodiscard]] std::vector<std::uint64_t> segment_counts() const;
  [[nodiscard]] NodeShape node_shape() const;

  class Verifier;

  std::unique_ptr<ByteSource> source_;
  mutable std::atomic<std::uint64_t> bytes_read_ = 0;
  std::uint64_t preamble_bytes_ = 0;
  Bytes preamble_;  // the first read, which is at least the preamble
  std::vector<SectionEntry> sections_;
  VolumeInfo info_;
  RowLayout rows_;
  std::vector<DirectoryPageRef> directory_refs_;
};

}  // namespace splatvol::format
