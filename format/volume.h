// Reads a .svol file part by part (spec/svol-1.md). Holds the preamble, and reads everything else on demand.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "base/triangle_mesh.h"
#include "format/columns.h"
#include "format/container.h"
#include "format/layout.h"
#include "format/octree.h"
#include "format/volume_info.h"
#include "format/volume_writer.h"

namespace splatvol::format {

/// Bytes of the index that go into Volume::geometry_hash together.
inline constexpr std::uint64_t geometry_part_bytes = std::uint64_t{1} << 20;

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
  std::size_t directory = 0;  // 0: of the file; 1: of the step

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return sizeof(DirectoryPage) + chunks.size() * sizeof(ChunkLocation);
  }
};

/// A time series: its steps, and the range of each attribute over all of them (NaN: no value is present).
struct Series {
  std::vector<StepEntry> entries;  // the step directory, in file order
  std::vector<StepEntry> steps;    // without dead parts; times rise
  std::vector<StepRange> ranges;   // [attribute]
  std::uint64_t bytes_behind = 0;  // bytes of the file behind its end: an append that was interrupted
};

/// An open file; of a time series, at one of its steps. Checks every byte against its hash and its rules before using
/// it. Errors begin with the file's name. Thread-safe, as its ByteSource is.
class Volume {
 public:
  /// Reads the preamble, in one read if the writer followed the advice of the specification; of a series, then the step
  /// directory and the preamble of the last step.
  [[nodiscard]] static Result<std::shared_ptr<const Volume>> open(std::unique_ptr<ByteSource> source);

  /// Of a series, its columns and attributes are those that all steps share, then those of the step.
  [[nodiscard]] const VolumeInfo& info() const { return info_; }
  [[nodiscard]] const RowLayout& rows() const { return rows_; }

  /// Returns the columns that all steps of a series share. For other files, the same as info().
  [[nodiscard]] const VolumeInfo& file_info() const { return file_info_; }
  [[nodiscard]] const std::string& name() const { return source_->source().name(); }
  [[nodiscard]] std::uint64_t file_bytes() const { return file_->bytes(); }
  [[nodiscard]] std::uint64_t preamble_bytes() const { return file_->preamble_bytes(); }

  /// Returns the hash of superblock and section table.
  [[nodiscard]] std::uint64_t table_hash() const { return file_->table_hash(); }

  /// Sections, in file order; without those of steps.
  [[nodiscard]] const std::vector<SectionEntry>& sections() const { return file_->sections(); }

  /// Null unless the file is a time series.
  [[nodiscard]] const Series* series() const { return series_.get(); }

  /// Return the number of the step, and its time. Require a series.
  [[nodiscard]] std::size_t step() const { return step_; }
  [[nodiscard]] double time() const { return series_->steps[step_].time; }

  /// Returns PartKey::step of what the file holds once for each step: the step's number + 1; 0 unless it is a series.
  [[nodiscard]] std::uint64_t step_key() const { return series_ ? step_ + 1 : 0; }

  /// Opens the same series at another step; shares what was read. Fails if there is no such step, or it is damaged.
  [[nodiscard]] Result<std::shared_ptr<const Volume>> at_step(std::size_t step) const;

  /// Whether both are steps of one series, opened once.
  [[nodiscard]] bool is_same_file(const Volume& other) const { return file_ == other.file_; }

  /// Returns the sections of the step, with offsets from its beginning; none unless the file is a series.
  [[nodiscard]] std::vector<SectionEntry> step_sections() const;

  /// Whether the file holds a column once for each step.
  [[nodiscard]] bool is_of_step(int column) const;

  /// Bytes held: the preambles and the directory roots. For budgets.
  [[nodiscard]] std::uint64_t memory_bytes() const;

  /// Returns how many bytes were read from the source so far, at all steps.
  [[nodiscard]] std::uint64_t bytes_read() const { return source_->bytes_read(); }

  /// Returns how many reads these were; from a server, requests.
  [[nodiscard]] std::uint64_t requests() const { return source_->requests(); }

  /// Returns how many bytes had been read before.
  [[nodiscard]] std::uint64_t bytes_read_again() const { return source_->bytes_read_again(); }

  /// Reads the page with the root node, and its summaries of these attributes.
  [[nodiscard]] Result<IndexPage> read_index_root(const SummaryAttributes& attributes) const;

  /// Reads a page that a node links to. `child_mask` and `parent_counts` are those of the linking node: fails if the
  /// counts of its children do not add up to `parent_counts`.
  [[nodiscard]] Result<IndexPage> read_index_page(const IndexPageRef& ref, std::uint8_t child_mask,
                                                  std::span<const std::uint64_t> parent_counts,
                                                  const SummaryAttributes& attributes) const;

  /// Returns an index page as at this step: the structure of `page`, which was read at another step of the same series,
  /// and the summaries of these attributes at this one. Reads these summaries only. Requires a series.
  [[nodiscard]] Result<IndexPage> with_summaries(IndexPage page, const SummaryAttributes& attributes) const;

  /// Returns the number of the directory page that has the chunk of a column in a row. Without a column: of the first
  /// column that all steps share. The pages of a step follow those of the file.
  [[nodiscard]] std::uint64_t directory_page_of_row(std::uint64_t row, int column = 0) const;
  [[nodiscard]] std::uint64_t directory_page_count() const;

  /// Whether a directory page is one of the step.
  [[nodiscard]] bool is_page_of_step(std::uint64_t page) const { return page >= directories_[0].refs.size(); }

  /// Returns a bound on the chunks of a directory page; of a series, of one of the file and one of the step together.
  [[nodiscard]] std::uint64_t most_chunks_of_directory_pages() const;

  /// Returns how many chunks a directory page has.
  [[nodiscard]] std::uint64_t chunks_of_directory_page(std::uint64_t page) const;

  /// Returns the row behind the last one of a directory page.
  [[nodiscard]] std::uint64_t end_row(const DirectoryPage& page) const;

  /// Returns the columns of a row that a directory page has, as indices into VolumeInfo::columns.
  [[nodiscard]] std::vector<int> columns_of_row(const DirectoryPage& page, std::uint64_t row) const;

  [[nodiscard]] Result<DirectoryPage> read_directory_page(std::uint64_t page) const;
  [[nodiscard]] ByteRange range_of_directory_page(std::uint64_t page) const;

  /// Finds a chunk in the page that covers its row and column. Requires a column that the row has.
  [[nodiscard]] const ChunkLocation& find_chunk(const DirectoryPage& page, std::uint64_t row, int column) const;

  /// Reads packed bytes: from a preamble if it holds them, else from the source, which `bytes_read` counts.
  [[nodiscard]] Result<Bytes> read_bytes(std::uint64_t offset, std::uint64_t count) const;

  /// See ByteSource.
  [[nodiscard]] std::uint64_t cheap_gap() const { return source_->source().cheap_gap(); }

  /// Whether each read takes a while, whatever its length: from a web server.
  [[nodiscard]] bool is_far() const;

  /// Reads ranges of the file before they are needed, joined and several at once. While the result lives, all reads of
  /// them take them from memory. Returns null and reads nothing if the file is not far, if it has read them already,
  /// or if a quarter of the share has no room for them.
  [[nodiscard]] Result<std::shared_ptr<const BytesAhead>> read_ahead(std::vector<ByteRange> ranges,
                                                                     MemoryShare& share) const;

  /// Whether one request to the file's server may serve many ranges.
  [[nodiscard]] bool may_join_requests() const { return source_->source().may_read_parts(); }

  /// Returns the largest gap between ranges that read_together may read, too.
  [[nodiscard]] std::uint64_t read_gap() const { return source_->has_read_parts() ? bytes_of_part : cheap_gap(); }

  /// Reads ranges that are needed together, by few reads. While the result lives, all reads of them take them from
  /// memory.
  [[nodiscard]] Result<std::shared_ptr<const BytesAhead>> read_together(std::vector<ByteRange> ranges) const;

  /// Whether reads of the file wait for their bytes (ByteSource::waits).
  [[nodiscard]] bool waits() const { return source_->source().waits(); }

  /// Begins to fetch what read_together will read, as ByteSource::prefetch does.
  [[nodiscard]] bool prefetch(std::vector<ByteRange> ranges) const;

  /// Return the bytes that are read first of an index page, and of its summaries at the step of a series.
  [[nodiscard]] ByteRange range_of_index_page(const IndexPageRef& ref) const;
  [[nodiscard]] ByteRange range_of_summaries(const IndexPage& page) const;

  /// Returns the bytes that are read next, as the first ones tell. None if these cannot be read.
  [[nodiscard]] std::vector<ByteRange> ranges_behind(const IndexPageRef& ref,
                                                     const SummaryAttributes& attributes) const;

  /// Reads the counts of values for each attribute. Returns none if the file has no such section.
  [[nodiscard]] Result<Histograms> read_histograms() const;

  /// Reads triangles of the boundary: those of some patches, by their indices in info().boundary, as one mesh. Reads
  /// nothing else besides the table of all patches, and holds little besides the mesh, whose size the counts in info()
  /// tell before. Fails if there is no such patch.
  [[nodiscard]] Result<TriangleMesh> read_boundary(std::span<const std::size_t> patches) const;

  /// Returns a hash of everything that does not depend on the step: of the chunks that all steps share and the
  /// structure of the index. Reads the directory and the index pages.
  [[nodiscard]] Result<std::uint64_t> geometry_hash() const;

  /// Reads and checks every byte of the file: hashes, tiling, every column, counts of the index, values against ranges,
  /// occupancy and histograms, positions against the cube, points against the nodes of the index, footer; of a series,
  /// all steps. Calls `progress` with the share done, in [0, 1], on this thread. Memory does not grow with the number
  /// of points. Fails if an append was interrupted, and the same way with any number of threads.
  [[nodiscard]] Status verify(const std::function<void(double)>& progress, std::size_t threads = 1) const;

  /// What some chunks of values hold.
  struct CheckedValues {
    std::vector<Histogram> histograms = {};   // [attribute]
    std::vector<std::uint64_t> missing = {};  // [attribute]
  };

  /// The part of verify() that takes most of the time, divided: checks some of the chunks, and the nodes of the index
  /// round their points. The parts from 0 to `parts` - 1 together check all. Not for a series.
  [[nodiscard]] Result<CheckedValues> verify_chunks(std::uint64_t part, std::uint64_t parts,
                                                    const std::function<void(double)>& progress) const;

  /// The rest of verify(). `values`: the sums over all parts. Not for a series.
  [[nodiscard]] Status verify_rest(const CheckedValues& values, const std::function<void(double)>& progress) const;

 private:
  // The rows of the file, or those of the step.
  struct Directory {
    const Container* container = nullptr;
    RowLayout rows;
    int first_column = 0;  // of VolumeInfo::columns
    std::uint32_t rows_per_page = 1;
    std::vector<DirectoryPageRef> refs;
  };
  struct Page {
    const Directory& directory;
    std::size_t directory_number;
    std::uint64_t number;  // in the directory
  };

  Volume() = default;
  [[nodiscard]] tl::unexpected<Error> broken(std::string_view rule) const { return file_->broken(rule); }
  [[nodiscard]] Status read_metadata();
  [[nodiscard]] Result<std::vector<PatchPart>> read_patch_table() const;
  [[nodiscard]] std::string what_patch(std::size_t patch) const;
  template <class Visit>
  [[nodiscard]] Status visit_patches(std::span<const PatchPart> parts, std::span<const std::size_t> patches,
                                     const Visit& visit) const;
  [[nodiscard]] Status check_boundary() const;
  [[nodiscard]] Status read_series();
  [[nodiscard]] Status check_entries(const Series& series) const;
  [[nodiscard]] Status open_step(std::size_t step);
  [[nodiscard]] Status read_step_metadata();
  [[nodiscard]] Status read_summary_table();
  [[nodiscard]] Status add_summary_pages(std::span<const std::byte> entries, std::uint64_t count, std::uint64_t& end);
  [[nodiscard]] Status read_directory_root(Directory directory);
  [[nodiscard]] Page page_at(std::uint64_t page) const;
  [[nodiscard]] const Directory& directory_of(int column) const { return directories_[is_of_step(column) ? 1 : 0]; }
  [[nodiscard]] const Container& values() const { return step_part_ ? *step_part_ : *file_; }
  [[nodiscard]] IndexPageRef root_ref() const;
  [[nodiscard]] std::uint64_t index_page_offset(const IndexPageRef& ref) const;
  [[nodiscard]] std::uint64_t summary_page_offset(std::uint32_t number) const;
  [[nodiscard]] bool reads_at_once(std::uint64_t page_bytes) const;
  void erase_held(std::vector<ByteRange>& ranges) const;
  [[nodiscard]] Result<IndexPage> read_page(const IndexPageRef& ref, std::uint64_t offset, std::uint32_t top_nodes,
                                            std::uint64_t links_end, const SummaryAttributes& attributes) const;
  [[nodiscard]] Status add_step_summaries(const SummaryAttributes& attributes, IndexPage& page) const;
  [[nodiscard]] Result<std::vector<ValueSummary>> read_step_summaries(const IndexPage& page,
                                                                      std::size_t attribute) const;
  [[nodiscard]] Status check_top_counts(const IndexPage& page, std::span<const std::uint64_t> expected) const;
  [[nodiscard]] NodeShape node_shape() const;

  class Verifier;

  std::shared_ptr<CountedSource> source_;
  std::shared_ptr<const Container> file_;
  VolumeInfo file_info_;  // without what the step adds
  VolumeInfo info_;
  RowLayout rows_;
  std::vector<Directory> directories_;  // of the file; of a series also of the step

  // Of a series only.
  std::shared_ptr<const Series> series_;
  std::size_t step_ = 0;
  std::shared_ptr<const Container> step_part_;
  std::vector<SummaryPageRef> summaries_;  // [index page], the root last
};

}  // namespace splatvol::format
