// Reads a .svol file piece by piece (spec/svol-1.md). Holds the preamble; everything else is read when asked for.
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

/// Where one chunk lies.
struct ChunkPlace {
  std::uint64_t offset = 0;
  ChunkEntry entry{};
};

/// The chunk entries of consecutive rows.
struct DirectoryPage {
  std::uint64_t first_row = 0;
  std::uint64_t first_chunk = 0;  // number of the first row's first chunk in the whole file
  std::vector<ChunkPlace> chunks;

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return sizeof(DirectoryPage) + chunks.size() * sizeof(ChunkPlace);
  }
};

/// An open file. Every byte that comes in is checked against its hash and its rules before it is used; errors begin
/// with the file's name. Thread-safe as far as its ByteSource is.
class Volume {
 public:
  /// Reads the preamble: in one read, where the writer followed the specification's advice.
  [[nodiscard]] static Result<std::shared_ptr<const Volume>> open(std::unique_ptr<ByteSource> source);

  [[nodiscard]] const VolumeInfo& info() const { return info_; }
  [[nodiscard]] const RowLayout& rows() const { return rows_; }
  [[nodiscard]] const std::string& name() const { return source_->name(); }
  [[nodiscard]] std::uint64_t file_bytes() const { return source_->size(); }
  [[nodiscard]] std::uint64_t preamble_bytes() const { return preamble_bytes_; }

  /// The parts of the file, in file order.
  [[nodiscard]] const std::vector<SectionEntry>& sections() const { return sections_; }

  /// Bytes held by the preamble, for budgets.
  [[nodiscard]] std::uint64_t memory_bytes() const {
    return preamble_.size() + directory_refs_.size() * sizeof(DirectoryPageRef);
  }

  /// Bytes fetched from the source so far.
  [[nodiscard]] std::uint64_t bytes_read() const { return bytes_read_; }

  /// The page with the root node; `attribute` selects the summaries, -1 for none.
  [[nodiscard]] Result<IndexPage> read_index_root(int attribute) const;

  /// A page that a node links to. `parent_counts` are the points of the linking node's segments: its children must add
  /// up to them.
  [[nodiscard]] Result<IndexPage> read_index_page(const IndexPageRef& ref, std::uint8_t child_mask,
                                                  std::span<const std::uint64_t> parent_counts, int attribute) const;

  [[nodiscard]] std::uint64_t directory_page_of_row(std::uint64_t row) const {
    return row / info_.rows_per_directory_page;
  }
  [[nodiscard]] Result<DirectoryPage> read_directory_page(std::uint64_t page) const;

  /// Finds a chunk in the page that covers its row; `column` must be one of the row's.
  [[nodiscard]] const ChunkPlace& find_chunk(const DirectoryPage& page, std::uint64_t row, int column) const;

  /// Packed bytes, from the preamble where it holds them. Counted.
  [[nodiscard]] Result<Bytes> read_bytes(std::uint64_t offset, std::uint64_t count) const;

  /// See ByteSource.
  [[nodiscard]] std::uint64_t cheap_gap() const { return source_->cheap_gap(); }

  /// Counts of values for each attribute; empty where the file has no such section.
  [[nodiscard]] Result<Histograms> read_histograms() const;

  /// Reads and checks every byte of the file: hashes, tiling, every column, counts of the index, values against ranges,
  /// occupancy and histograms, positions against the cube, footer.
  /// `progress` is called with the share done, in [0, 1]. Memory does not grow with the number of points.
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
  Bytes preamble_;  // at least the preamble: all of the first read
  std::vector<SectionEntry> sections_;
  VolumeInfo info_;
  RowLayout rows_;
  std::vector<DirectoryPageRef> directory_refs_;
};

}  // namespace splatvol::format
