// Reads the cells of a file part by part (spec/svol-1.md, section 14).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "format/cells.h"
#include "format/octree.h"
#include "format/volume.h"

namespace splatvol::format {

/// Chunk entries of cells that follow each other.
struct CellPage {
  std::vector<CellChunkEntry> chunks;
  std::vector<ValueSummary> summaries;          // [chunk]: of the attribute that was read
  std::vector<ValueSummary> opacity_summaries;  // [chunk]: of SummaryAttributes::opacity; empty: none
};

/// The cells of an open file. Holds the root of their section, and reads everything else on demand. Checks every byte
/// as Volume does. Thread-safe.
class CellReader {
 public:
  /// Reads the root and the pages of chunks that one read at the end of the section brings in, mostly all. Returns null
  /// if the file keeps no cells. The volume must outlive the reader.
  [[nodiscard]] static Result<std::unique_ptr<const CellReader>> open(const Volume& volume);

  /// The same for a section that is not in a file yet. `info`: of the file it will be in, which must outlive the
  /// reader; `bytes`: of the section; `read`: reads some of them, by the offset in the section.
  using ReadBytes = std::function<Result<Bytes>(std::uint64_t offset, std::uint64_t count)>;
  [[nodiscard]] static Result<std::unique_ptr<const CellReader>> open(const VolumeInfo& info, std::string name,
                                                                      std::uint64_t bytes, ReadBytes read);

  /// Whether a file keeps cells.
  [[nodiscard]] static bool has_cells(const Volume& volume);

  /// Requires a reader of a file.
  [[nodiscard]] const Volume& volume() const { return *volume_; }

  /// Counts for each shape and field.
  [[nodiscard]] const std::vector<CellKind>& kinds() const { return kinds_; }

  /// Pages of chunk entries, in the order of the file.
  [[nodiscard]] const std::vector<CellPageRef>& pages() const { return pages_; }
  [[nodiscard]] std::uint64_t chunk_count() const { return chunk_count_; }

  /// Bytes of the section, of the pages of ranks, of the vertices, and of the pages of chunks with the root.
  [[nodiscard]] std::uint64_t section_bytes() const { return bytes_; }
  [[nodiscard]] std::uint64_t rank_bytes() const;
  [[nodiscard]] std::uint64_t vertex_bytes() const;
  [[nodiscard]] std::uint64_t directory_bytes() const;

  /// Bytes held.
  [[nodiscard]] std::uint64_t memory_bytes() const;

  /// Reads the entries of a page, and their summaries of these attributes. Of a step without summaries, each chunk may
  /// have any value.
  [[nodiscard]] Result<CellPage> read_page(std::size_t page, const SummaryAttributes& attributes) const;

  /// Reads pages ahead (Volume::read_ahead). Requires a reader of a file.
  [[nodiscard]] Result<std::shared_ptr<const BytesAhead>> read_pages_ahead(std::span<const std::size_t> pages,
                                                                           MemoryShare& share) const;

  /// Whether a step has summaries. Without, its chunks count as visible.
  [[nodiscard]] bool has_step_summaries() const { return !step_pages_.empty(); }

  /// Reads a chunk. Requires an entry of this file of a known shape and field.
  [[nodiscard]] Result<CellChunk> read_chunk(const CellChunkEntry& entry) const;

  /// Checks the bytes of a chunk whatever its shape and field.
  [[nodiscard]] Status check_bytes(const CellChunkEntry& entry) const;

  /// Corners of cells whose field is constant, and their positions page by page.
  [[nodiscard]] std::uint64_t vertex_count() const { return vertex_count_; }
  [[nodiscard]] std::size_t vertex_page_count() const { return vertex_pages_.size(); }
  [[nodiscard]] Result<std::vector<dvec3>> read_vertex_page(std::size_t page) const;

  /// Where parts are in the file. Require a reader of a file.
  [[nodiscard]] ByteRange range_of(const CellChunkEntry& entry) const;
  [[nodiscard]] ByteRange range_of_rank_page(std::size_t page) const { return range_of(rank_pages_[page]); }
  [[nodiscard]] ByteRange range_of_vertex_page(std::size_t page) const { return range_of(vertex_pages_[page]); }

  [[nodiscard]] std::size_t rank_page_count() const { return rank_pages_.size(); }
  [[nodiscard]] Result<RankPage> read_rank_page(std::size_t page) const;

 private:
  CellReader(const VolumeInfo& info, std::string name, std::uint64_t bytes, ReadBytes read);
  [[nodiscard]] Status read_root();
  [[nodiscard]] Status take_root(std::span<const std::byte> root, const CellsTail& tail);
  [[nodiscard]] Status check_tiling() const;
  [[nodiscard]] std::uint64_t chunks_end_of(std::size_t page) const;
  [[nodiscard]] ByteRange range_of(const PackedPageRef& ref) const {
    return {begin_ + ref.offset, begin_ + ref.offset + ref.packed_bytes};
  }
  [[nodiscard]] Result<Bytes> read(std::uint64_t offset, std::uint64_t count) const;
  [[nodiscard]] Status check_entry(const CellChunkEntry& entry) const;
  [[nodiscard]] Status read_step();
  // The end of a section, without its root.
  struct Tail {
    std::uint64_t begin = 0;  // offset in the section
    Bytes bytes = {};

    [[nodiscard]] bool holds(std::uint64_t offset, std::uint64_t count) const {
      return offset >= begin && offset - begin <= bytes.size() && count <= bytes.size() - (offset - begin);
    }
    [[nodiscard]] Bytes part(std::uint64_t offset, std::uint64_t count) const {
      const auto first = bytes.begin() + static_cast<std::ptrdiff_t>(offset - begin);
      return {first, first + static_cast<std::ptrdiff_t>(count)};
    }
  };
  struct Parts {
    Bytes bytes;                                              // of the page
    std::vector<std::pair<std::uint64_t, IndexPagePart>> at;  // offset in the page, part
  };
  [[nodiscard]] Result<Parts> read_parts(Bytes bytes, std::uint64_t hash, std::size_t count, std::size_t first_bytes,
                                         std::uint32_t chunks, const std::string& what) const;
  [[nodiscard]] Result<std::vector<ValueSummary>> read_summaries(std::size_t page, int attribute,
                                                                 const Parts& parts) const;
  [[nodiscard]] tl::unexpected<Error> broken(std::string_view rule) const;

  const Volume* volume_ = nullptr;
  const VolumeInfo& info_;
  std::string name_;
  std::uint64_t begin_ = 0;  // of the section in the file
  std::uint64_t bytes_;
  ReadBytes read_;
  Tail tail_;
  std::size_t attributes_;                  // of which pages of chunks have summaries
  std::uint64_t step_offset_ = 0;           // in the file, of the summaries of a step
  std::vector<SummaryPageRef> step_pages_;  // [page of chunks]
  Tail step_tail_;
  std::vector<std::uint64_t> counts_;  // [segment]: points
  std::uint64_t root_bytes_ = 0;
  std::uint64_t chunk_count_ = 0;
  std::vector<CellKind> kinds_;
  std::vector<CellPageRef> pages_;
  std::vector<PackedPageRef> rank_pages_;
  std::uint64_t vertex_count_ = 0;
  std::vector<PackedPageRef> vertex_pages_;
};

}  // namespace splatvol::format
