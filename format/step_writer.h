// Writes a step of a time series (spec/svol-1.md, section 11).
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/temp_file.h"
#include "format/chunk_source.h"
#include "format/directory_writer.h"
#include "format/layout.h"
#include "format/octree.h"
#include "format/volume_info.h"

namespace splatvol::format {

/// Packs the summaries of the index pages for one step, page by page. Not thread-safe.
class SummaryWriter {
 public:
  /// Fails if no temporary file can be made in `folder`.
  [[nodiscard]] static Result<SummaryWriter> create(const std::string& folder);

  /// Adds the summaries of the next page: [attribute][node]. The root page comes last.
  [[nodiscard]] Status add(std::span<const std::vector<ValueSummary>> summaries);

 private:
  friend class StepWriter;
  explicit SummaryWriter(TempFile pages) : pages_(std::move(pages)) {}

  TempFile pages_;  // all but the last
  Bytes last_;
  std::uint64_t table_bytes_ = 0;  // of its part table
  std::vector<SummaryPageRef> refs_;
};

/// Takes the rows of a step in row order, and writes the step as a whole. Holds some MiB. Not thread-safe.
class StepWriter {
 public:
  /// Receives the bytes of a step from front to back.
  using Append = std::function<Status(std::span<const std::byte>)>;

  /// `info` describes the series. Chooses step.rows_per_directory_page. Fails if `step` does not fit `info`, and as
  /// VolumeWriter::create. Requires summaries of all index pages, and a histogram for each attribute.
  [[nodiscard]] static Result<std::unique_ptr<StepWriter>> create(
      const VolumeInfo& info, StepInfo step, SummaryWriter summaries,
      std::span<const std::array<std::uint64_t, 64>> histograms, const std::string& temporary_folder);

  /// Appends the next row: the chunks of the step's columns, side by side in `bytes`.
  [[nodiscard]] Status append_row(std::span<const ChunkEntry> entries, std::span<const std::byte> bytes);

  [[nodiscard]] const StepInfo& step() const { return step_; }

  /// Returns the rows of the step, once all have been added and until it is written. This must outlive it.
  [[nodiscard]] std::shared_ptr<const ChunkSource> chunks() const;

  /// Adds the summaries of the series' cells, as pack_cell_summaries makes them. Called before write() if the series
  /// keeps cells, and only then.
  void set_cell_summaries(TempFile section, std::uint64_t hash) {
    cells_.emplace(std::move(section));
    cells_hash_ = hash;
  }

  /// Writes the step. Returns its entry in the step directory, with `offset` for where it begins in the file. Requires
  /// all rows. Called once.
  [[nodiscard]] Result<StepEntry> write(std::uint64_t offset, const Append& append);

 private:
  class Chunks;
  StepWriter(const VolumeInfo& info, StepInfo step, SummaryWriter summaries, DirectoryWriter directory, TempFile rows)
      : info_(info),
        step_(std::move(step)),
        summaries_(std::move(summaries)),
        directory_(std::move(directory)),
        row_bytes_(std::move(rows)) {}
  [[nodiscard]] Status lay_out(const VolumeInfo& info);
  [[nodiscard]] std::uint64_t section_count() const;
  [[nodiscard]] bool table_in_front() const;
  void add_sections(const Bytes& directory_root);
  void add_extent(SectionKind kind, std::uint64_t bytes, std::uint64_t unpacked_bytes, std::uint64_t hash);
  void add_section(SectionKind kind, bool critical, std::span<const std::byte> packed, std::uint64_t unpacked_bytes);
  [[nodiscard]] Bytes pack_front() const;

  VolumeInfo info_;  // of the series
  StepInfo step_;
  SummaryWriter summaries_;
  DirectoryWriter directory_;
  TempFile row_bytes_;
  Bytes metadata_, histograms_, summary_table_;
  std::uint64_t metadata_bytes_ = 0, histogram_bytes_ = 0;  // unpacked
  std::uint64_t root_offset_ = 0;                           // of the directory
  std::uint64_t rows_offset_ = 0;
  std::uint64_t end_ = 0;  // of the sections so far
  std::optional<TempFile> cells_;
  std::uint64_t cells_hash_ = 0;
  std::vector<SectionEntry> sections_;
};

/// Returns `raw` packed, within the bounds that keep a reader's memory in proportion to the bytes of metadata (rule
/// R7).
[[nodiscard]] Bytes pack_metadata(std::span<const std::byte> raw);

}  // namespace splatvol::format
