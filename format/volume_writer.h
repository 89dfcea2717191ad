// Writes a .svol file front to back (spec/svol-1.md).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "base/temp_file.h"
#include "format/chunk_source.h"
#include "format/columns.h"
#include "format/directory_writer.h"
#include "format/layout.h"
#include "format/octree.h"
#include "format/step_writer.h"
#include "format/volume_info.h"

namespace splatvol::format {

/// [attribute]: of the values as stored.
using Histograms = std::vector<Histogram>;

/// Appends bytes to a part of a file.
using AppendBytes = std::function<Status(std::span<const std::byte>)>;

/// Writes the section of cells. `chunks`: the rows of the file, which are all there.
using WriteCells = std::function<Status(std::shared_ptr<const ChunkSource> chunks, const AppendBytes& append)>;

/// Writes a file row by row, in row order. The file gets its name in `finish`. Holds some MiB, however many rows there
/// are. Not thread-safe; the chunks may be packed on several threads beforehand.
class VolumeWriter {
 public:
  /// Writes to a file that already holds the bytes of the last rows, and nothing else. The rows before them will have
  /// `bytes_before` bytes. Moves the bytes of the last rows behind these: without copying them if they are many and the
  /// file system can do so. The finished file is the same either way. Reserves the preamble and chooses
  /// info.rows_per_directory_page. Fails if:
  /// - a temporary file cannot be created in `temporary_folder`;
  /// - `info` breaks a rule of the specification or does not fit `index`;
  /// - metadata, root index page and directory root together pass 1 MiB (thousands of attributes).
  [[nodiscard]] static Result<std::unique_ptr<VolumeWriter>> create(AtomicFile file, std::uint64_t bytes_before,
                                                                    VolumeInfo info, PackedIndex index,
                                                                    const std::string& temporary_folder);

  /// The same for a file whose rows are written by others, from first_row_offset() on. `bytes_before`: of the rows
  /// before those of the finest segment at the finest resolution; `last_bytes`: of these. All rows are added by
  /// add_written_row().
  [[nodiscard]] static Result<std::unique_ptr<VolumeWriter>> create_around(AtomicFile file, std::uint64_t bytes_before,
                                                                           std::uint64_t last_bytes, VolumeInfo info,
                                                                           PackedIndex index,
                                                                           const std::string& temporary_folder);
  [[nodiscard]] std::uint64_t first_row_offset() const { return rows_offset_; }

  /// Appends the next row: one chunk for each of its columns, in order. Their bytes are one after another in `bytes`.
  [[nodiscard]] Status append_row(std::span<const ChunkEntry> entries, std::span<const std::byte> bytes);

  /// Adds the entries of the next row, whose bytes were in the file from the beginning.
  [[nodiscard]] Status add_written_row(std::span<const ChunkEntry> entries);

  /// Adds the triangles of `info.boundary`, as pack_boundary returns them. Called before the file is finished if there
  /// is a boundary, and only then.
  void set_boundary(Bytes section) { boundary_ = std::move(section); }

  /// Adds the section of `info.cells`. Called before the file is finished if there are cells, and only then.
  void set_cells(WriteCells write) { write_cells_ = std::move(write); }

  /// How a finished file is read back and verified before it gets its name.
  struct Checking {
    std::function<void(double)> progress;  // called with the fraction that is done
    std::size_t threads = 1;
  };

  /// Writes the sections behind the rows, then the preamble, and gives the file its name. Requires all rows.
  /// Without `checking`, the file is not verified.
  [[nodiscard]] Status finish(const Histograms& histograms, const std::optional<Checking>& checking = {});

  /// The same in two steps, for a file that others check. Between them it can be read by the path that its AtomicFile
  /// has. `commit` gives it its name.
  [[nodiscard]] Status finish_unchecked(const Histograms& histograms);
  [[nodiscard]] Status commit() { return file_.commit(); }

  /// The same for a time series, with all of its steps, in the order of their times.
  [[nodiscard]] Status finish_series(std::span<const std::unique_ptr<StepWriter>> steps,
                                     const std::optional<Checking>& checking = {});

  [[nodiscard]] const RowLayout& rows() const { return directory_.rows(); }

  /// Returns the rows of the file, once all have been added and until it is finished. This must outlive it.
  [[nodiscard]] Result<std::shared_ptr<const ChunkSource>> chunks() const;

  /// Bytes of the finished file; 0 before.
  [[nodiscard]] std::uint64_t file_bytes() const { return file_bytes_; }

 private:
  class Chunks;
  VolumeWriter(AtomicFile file, VolumeInfo info, PackedIndex index, TempFile directory_tail);
  [[nodiscard]] static Result<std::unique_ptr<VolumeWriter>> begin(AtomicFile file, VolumeInfo info, PackedIndex index,
                                                                   const std::string& temporary_folder);
  [[nodiscard]] Status reserve_front(std::uint64_t bytes_before, std::uint64_t last_bytes);
  [[nodiscard]] Status finish_all(const Histograms& histograms, std::span<const std::unique_ptr<StepWriter>> steps);
  [[nodiscard]] Status check_and_commit(const std::optional<Checking>& checking);
  [[nodiscard]] Status check(const Checking& checking) const;
  void add_section(SectionKind kind, bool critical, std::uint64_t offset, std::span<const std::byte> packed,
                   std::uint64_t unpacked_bytes, Codec codec);
  void add_extent(SectionKind kind, std::uint64_t offset, std::uint64_t bytes);

  // The sections behind the rows: histograms, index pages, directory pages, boundary.
  struct Tail {
    Bytes histograms;
    Bytes directory_root = {};
    std::uint64_t histogram_bytes = 0;  // unpacked
    std::uint64_t index_offset = 0;
    std::uint64_t directory_offset = 0;
    std::uint64_t boundary_offset = 0;
    std::uint64_t cells_offset = 0;
    std::uint64_t cells_bytes = 0;
    std::uint64_t cells_hash = hash_bytes({});
  };
  [[nodiscard]] Result<Tail> append_tail(const Histograms& histograms);
  [[nodiscard]] Status append_cells(Tail& tail);
  [[nodiscard]] Status append_steps(std::span<const std::unique_ptr<StepWriter>> steps);
  void add_sections(const Tail& tail, const Bytes& padding);
  [[nodiscard]] Bytes pack_section_table() const;

  AtomicFile file_;
  VolumeInfo info_;
  DirectoryWriter directory_;
  std::uint64_t front_bytes_ = 0;  // superblock and section table
  std::uint64_t padding_offset_ = 0;
  std::uint64_t rows_offset_ = 0;
  std::uint64_t rows_end_ = 0;        // of the rows so far
  std::uint64_t shared_bytes_ = 0;    // of the file without its steps
  std::uint64_t step_directory_ = 0;  // its offset; 0: no series
  std::uint64_t file_bytes_ = 0;
  Bytes metadata_raw_;
  Bytes metadata_;
  PackedIndex index_;
  Bytes boundary_;
  WriteCells write_cells_;  // empty: none
  std::vector<SectionEntry> sections_;
};

}  // namespace splatvol::format
