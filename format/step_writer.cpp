#include "format/step_writer.h"

#include <array>
#include <limits>

#include "format/container.h"

namespace splatvol::format {
namespace {

// A series that keeps cells has one more.
constexpr std::uint64_t least_section_count = 8;

// A longer summary table stands behind the rows: it would push coarse rows out of the preamble.
constexpr std::uint64_t most_table_bytes_in_front = 32u << 10;

}  // namespace

// The rows of a step that is being written.
class StepWriter::Chunks final : public ChunkSource {
 public:
  explicit Chunks(const StepWriter& writer) : writer_(writer) {}

  [[nodiscard]] const VolumeInfo& info() const override { return writer_.info_; }
  [[nodiscard]] const RowLayout& rows() const override { return writer_.directory_.rows(); }
  [[nodiscard]] Result<PackedChunk> read_chunk(ColumnKind kind, int attribute, std::uint64_t group) const override {
    return writer_.directory_.read_chunk(writer_.step_.columns, kind, attribute, group,
                                         [&](std::uint64_t offset, std::span<std::byte> bytes) {
                                           return writer_.row_bytes_.read(offset - writer_.rows_offset_, bytes);
                                         });
  }

 private:
  const StepWriter& writer_;
};

std::shared_ptr<const ChunkSource> StepWriter::chunks() const { return std::make_shared<const Chunks>(*this); }

Bytes pack_metadata(std::span<const std::byte> raw) {
  Bytes packed = pack(raw);
  return raw.size() <= max_metadata_bytes(packed.size()) ? packed : Bytes(raw.begin(), raw.end());
}

Result<SummaryWriter> SummaryWriter::create(const std::string& folder) {
  SPLATVOL_TRY_ASSIGN(pages, TempFile::create(folder));
  return SummaryWriter(std::move(pages));
}

Status SummaryWriter::add(std::span<const std::vector<ValueSummary>> summaries) {
  if (!refs_.empty()) {
    refs_.back().offset = pages_.size();
    SPLATVOL_TRY(pages_.append(last_));
  }
  Bytes table, parts;
  for (const std::vector<ValueSummary>& of_attribute : summaries)
    append_part(table, parts, pack_summaries(of_attribute));
  table_bytes_ = table.size();
  const auto nodes = static_cast<std::uint32_t>(summaries.front().size());
  const std::uint64_t hash = hash_bytes(table);
  last_ = std::move(table);
  last_.insert(last_.end(), parts.begin(), parts.end());
  if (last_.size() > std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::unsupported, "an index page with {} attributes would pass 4 GiB", summaries.size());
  refs_.push_back({0, static_cast<std::uint32_t>(last_.size()), nodes, hash});
  return {};
}

Result<std::unique_ptr<StepWriter>> StepWriter::create(const VolumeInfo& info, StepInfo step, SummaryWriter summaries,
                                                       std::span<const std::array<std::uint64_t, 64>> histograms,
                                                       const std::string& temporary_folder) {
  if (summaries.refs_.empty() || histograms.size() != step.attributes.size())
    return fail(ErrorCode::invalid_argument, "a step lacks summaries or histograms");
  step.rows_per_directory_page = choose_rows_per_page(step.columns.size(), RowLayout(info).row_count());
  SPLATVOL_TRY_ASSIGN(tail, TempFile::create(temporary_folder));
  SPLATVOL_TRY_ASSIGN(rows, TempFile::create(temporary_folder));
  DirectoryWriter directory(RowLayout(info, step), step.rows_per_directory_page, std::move(tail));
  std::unique_ptr<StepWriter> writer(
      new StepWriter(info, std::move(step), std::move(summaries), std::move(directory), std::move(rows)));
  const auto raw = std::as_bytes(histograms);
  writer->histogram_bytes_ = raw.size();
  writer->histograms_ = pack(raw);
  SPLATVOL_TRY(writer->lay_out(info));
  return writer;
}

// Packs what stands before the rows, so that their offset is known.
Status StepWriter::lay_out(const VolumeInfo& info) {
  SPLATVOL_TRY_ASSIGN(json, step_to_json(step_, info));
  metadata_bytes_ = json.size();
  metadata_ = pack_metadata(std::as_bytes(std::span(json)));
  for (const SummaryPageRef& ref : summaries_.refs_) append_record(summary_table_, ref);
  root_offset_ =
      sizeof(Superblock) + section_count() * sizeof(SectionEntry) + metadata_.size() + summaries_.last_.size();
  rows_offset_ = root_offset_ + directory_.root_bytes() + (table_in_front() ? summary_table_.size() : 0);
  if (rows_offset_ > max_preamble_bytes)
    return fail(ErrorCode::unsupported, "the description of {} attributes passes 1 MiB; choose fewer",
                step_.attributes.size());
  return {};
}

std::uint64_t StepWriter::section_count() const { return least_section_count + (info_.cells ? 1 : 0); }

bool StepWriter::table_in_front() const { return summary_table_.size() <= most_table_bytes_in_front; }

Status StepWriter::append_row(std::span<const ChunkEntry> entries, std::span<const std::byte> bytes) {
  SPLATVOL_TRY(directory_.add_row(entries, rows_offset_ + row_bytes_.size()));
  return row_bytes_.append(bytes);
}

void StepWriter::add_extent(SectionKind kind, std::uint64_t bytes, std::uint64_t unpacked_bytes, std::uint64_t hash) {
  sections_.push_back({kind, 1, end_, bytes, unpacked_bytes, hash, Codec::extent, 0});
  end_ += bytes;
}

void StepWriter::add_section(SectionKind kind, bool critical, std::span<const std::byte> packed,
                             std::uint64_t unpacked_bytes) {
  const Codec codec = packed.size() == unpacked_bytes ? Codec::raw : Codec::zstd;
  sections_.push_back({kind, critical ? 1u : 0u, end_, packed.size(), unpacked_bytes, hash_bytes(packed), codec, 0});
  end_ += packed.size();
}

void StepWriter::add_sections(const Bytes& directory_root) {
  const auto add_table = [&] { add_section(SectionKind::summary_table, true, summary_table_, summary_table_.size()); };
  end_ = sizeof(Superblock) + section_count() * sizeof(SectionEntry);
  add_section(SectionKind::metadata, true, metadata_, metadata_bytes_);
  add_extent(SectionKind::index_root, summaries_.last_.size(), summaries_.table_bytes_, summaries_.refs_.back().hash);
  add_section(SectionKind::directory_root, true, directory_root, directory_root.size());
  if (table_in_front()) add_table();
  add_extent(SectionKind::rows, row_bytes_.size(), 0, 0);
  add_section(SectionKind::histograms, false, histograms_, histogram_bytes_);
  if (!table_in_front()) add_table();
  add_extent(SectionKind::index_pages, summaries_.pages_.size(), 0, 0);
  add_extent(SectionKind::directory_pages, directory_.tail().size(), 0, 0);
  if (!cells_) return;
  sections_.push_back(
      {SectionKind::cell_summaries, 0, end_, cells_->size(), cells_->size(), cells_hash_, Codec::raw, 0});
  end_ += cells_->size();
}

// The superblock and the section table.
Bytes StepWriter::pack_front() const {
  Superblock superblock{};
  superblock.file_bytes = end_;
  superblock.preamble_bytes = choose_preamble_bytes(end_, rows_offset_, directory_.resolution_ends());
  return format::pack_front(superblock, true, sections_);
}

Result<StepEntry> StepWriter::write(std::uint64_t offset, const Append& append) {
  if (directory_.next_row() != directory_.rows().row_count())
    return fail(ErrorCode::invalid_argument, "{} of {} rows were written", directory_.next_row(),
                directory_.rows().row_count());
  if (cells_.has_value() != info_.cells.has_value())
    return fail(ErrorCode::invalid_argument,
                "summaries of cells that the series does not keep, or the other way round");
  const std::uint64_t tail_offset = rows_offset_ + row_bytes_.size() + histograms_.size() +
                                    (table_in_front() ? 0 : summary_table_.size()) + summaries_.pages_.size();
  const Bytes root = directory_.pack_root(root_offset_, tail_offset);
  add_sections(root);
  const Bytes front = pack_front();
  for (const Bytes* part : {&front, &std::as_const(metadata_), &std::as_const(summaries_.last_), &root})
    SPLATVOL_TRY(append(*part));
  if (table_in_front()) SPLATVOL_TRY(append(summary_table_));
  SPLATVOL_TRY(move_bytes(row_bytes_, append));
  SPLATVOL_TRY(append(histograms_));
  if (!table_in_front()) SPLATVOL_TRY(append(summary_table_));
  SPLATVOL_TRY(move_bytes(summaries_.pages_, append));
  SPLATVOL_TRY(move_bytes(directory_.tail(), append));
  if (cells_) SPLATVOL_TRY(move_bytes(*cells_, append));
  return StepEntry{step_.time, offset, end_, hash_bytes(front), StepEntryKind::step, 0};
}

}  // namespace splatvol::format
