#include "format/volume_writer.h"

#include <algorithm>
#include <array>

#include "format/container.h"
#include "format/series_writer.h"
#include "format/volume.h"

namespace splatvol::format {
namespace {

constexpr std::uint64_t section_count = 7;  // without padding; a series has no histograms of its own

// Rows of at least this many bytes are moved without being copied, which needs padding. The choice depends on the file
// alone.
constexpr std::uint64_t padded_rows_bytes = 16u << 20;

bool has_two_sided(const VolumeInfo& info) {
  return info.boundary && std::ranges::any_of(info.boundary->patches, &PatchInfo::two_sided);
}

}  // namespace

// The rows of a file that is being written.
class VolumeWriter::Chunks final : public ChunkSource {
 public:
  Chunks(const VolumeWriter& writer, std::unique_ptr<ByteSource> file) : writer_(writer), file_(std::move(file)) {}

  [[nodiscard]] const VolumeInfo& info() const override { return writer_.info_; }
  [[nodiscard]] const RowLayout& rows() const override { return writer_.rows(); }
  [[nodiscard]] Result<PackedChunk> read_chunk(ColumnKind kind, int attribute, std::uint64_t group) const override {
    return writer_.directory_.read_chunk(
        info().columns, kind, attribute, group,
        [&](std::uint64_t offset, std::span<std::byte> bytes) { return file_->read(offset, bytes); });
  }

 private:
  const VolumeWriter& writer_;
  std::unique_ptr<ByteSource> file_;
};

VolumeWriter::VolumeWriter(AtomicFile file, VolumeInfo info, PackedIndex index, TempFile directory_tail)
    : file_(std::move(file)),
      info_(std::move(info)),
      directory_(RowLayout(info_), info_.rows_per_directory_page, std::move(directory_tail)),
      index_(std::move(index)) {}

Result<std::unique_ptr<VolumeWriter>> VolumeWriter::create(AtomicFile file, std::uint64_t bytes_before, VolumeInfo info,
                                                           PackedIndex index, const std::string& temporary_folder) {
  SPLATVOL_TRY_ASSIGN(writer, begin(std::move(file), std::move(info), std::move(index), temporary_folder));
  SPLATVOL_TRY(writer->reserve_front(bytes_before, writer->file_.position()));
  SPLATVOL_TRY(writer->file_.insert_front(writer->rows_offset_ + bytes_before));
  return writer;
}

Result<std::unique_ptr<VolumeWriter>> VolumeWriter::create_around(AtomicFile file, std::uint64_t bytes_before,
                                                                  std::uint64_t last_bytes, VolumeInfo info,
                                                                  PackedIndex index,
                                                                  const std::string& temporary_folder) {
  SPLATVOL_TRY_ASSIGN(writer, begin(std::move(file), std::move(info), std::move(index), temporary_folder));
  SPLATVOL_TRY(writer->reserve_front(bytes_before, last_bytes));
  return writer;
}

Result<std::unique_ptr<VolumeWriter>> VolumeWriter::begin(AtomicFile file, VolumeInfo info, PackedIndex index,
                                                          const std::string& temporary_folder) {
  SPLATVOL_TRY(metadata_to_json(info));
  if (index.shape.resolutions != info.resolutions() || index.shape.size_bounds != info.size_bounds.size() ||
      index.shape.attributes != info.attributes.size())
    return fail(ErrorCode::invalid_argument, "the index is of another shape than the metadata");
  info.rows_per_directory_page = choose_rows_per_page(info.columns.size(), RowLayout(info).row_count());
  SPLATVOL_TRY_ASSIGN(directory_tail, TempFile::create(temporary_folder));
  std::unique_ptr<VolumeWriter> writer(
      new VolumeWriter(std::move(file), std::move(info), std::move(index), std::move(directory_tail)));
  return writer;
}

// Chooses where the rows begin.
Status VolumeWriter::reserve_front(std::uint64_t bytes_before, std::uint64_t last_bytes) {
  SPLATVOL_TRY_ASSIGN(json, metadata_to_json(info_));
  const auto json_bytes = std::as_bytes(std::span(json));
  metadata_raw_.assign(json_bytes.begin(), json_bytes.end());
  metadata_ = pack_metadata(metadata_raw_);

  const bool padded = last_bytes >= padded_rows_bytes;
  const std::uint64_t sections =
      section_count + (padded ? 1 : 0) - (info_.series ? 1 : 0) + (info_.boundary ? 1 : 0) + (info_.cells ? 1 : 0);
  front_bytes_ = sizeof(Superblock) + sections * sizeof(SectionEntry);
  padding_offset_ = front_bytes_ + metadata_.size() + index_.root.bytes.size() + directory_.root_bytes();
  const std::uint64_t unpadded = padding_offset_ + bytes_before, unit = AtomicFile::insertable_bytes;
  rows_offset_ = padding_offset_ + (padded ? unit - unpadded % unit : 0);
  if (rows_offset_ > max_preamble_bytes)
    return fail(ErrorCode::unsupported, "the description of {} attributes passes 1 MiB; choose fewer",
                info_.attributes.size());
  rows_end_ = rows_offset_;
  return {};
}

Status VolumeWriter::append_row(std::span<const ChunkEntry> entries, std::span<const std::byte> bytes) {
  std::uint64_t packed_bytes = 0;
  for (const ChunkEntry& entry : entries) packed_bytes += entry.packed_bytes;
  if (packed_bytes != bytes.size())
    return fail(ErrorCode::invalid_argument, "row {} has {} bytes for chunks of {}", directory_.next_row(),
                bytes.size(), packed_bytes);
  if (file_.position() != rows_end_) file_.seek(rows_end_);
  SPLATVOL_TRY(add_written_row(entries));
  return file_.append(bytes);
}

Status VolumeWriter::add_written_row(std::span<const ChunkEntry> entries) {
  SPLATVOL_TRY(directory_.add_row(entries, rows_end_));
  for (const ChunkEntry& entry : entries) rows_end_ += entry.packed_bytes;
  return {};
}

void VolumeWriter::add_section(SectionKind kind, bool critical, std::uint64_t offset, std::span<const std::byte> packed,
                               std::uint64_t unpacked_bytes, Codec codec) {
  sections_.push_back({kind, critical ? 1u : 0u, offset, packed.size(), unpacked_bytes, hash_bytes(packed), codec, 0});
}

void VolumeWriter::add_extent(SectionKind kind, std::uint64_t offset, std::uint64_t bytes) {
  sections_.push_back({kind, 1, offset, bytes, 0, 0, Codec::extent, 0});
}

Status VolumeWriter::finish(const Histograms& histograms, const std::optional<Checking>& checking) {
  SPLATVOL_TRY(finish_unchecked(histograms));
  return check_and_commit(checking);
}

Status VolumeWriter::finish_unchecked(const Histograms& histograms) {
  if (info_.series) return fail(ErrorCode::invalid_argument, "a series without steps");
  if (histograms.size() != info_.attributes.size())
    return fail(ErrorCode::invalid_argument, "{} histograms for {} attributes", histograms.size(),
                info_.attributes.size());
  return finish_all(histograms, {});
}

Status VolumeWriter::finish_series(std::span<const std::unique_ptr<StepWriter>> steps,
                                   const std::optional<Checking>& checking) {
  if (!info_.series || steps.empty()) return fail(ErrorCode::invalid_argument, "not a series, or one without steps");
  SPLATVOL_TRY(finish_all({}, steps));
  return check_and_commit(checking);
}

Status VolumeWriter::check_and_commit(const std::optional<Checking>& checking) {
  if (checking) SPLATVOL_TRY(check(*checking));
  return file_.commit();
}

Status VolumeWriter::finish_all(const Histograms& histograms, std::span<const std::unique_ptr<StepWriter>> steps) {
  if (directory_.next_row() != rows().row_count())
    return fail(ErrorCode::invalid_argument, "{} of {} rows were written", directory_.next_row(), rows().row_count());
  if (info_.boundary.has_value() == boundary_.empty())
    return fail(ErrorCode::invalid_argument, "the triangles of the boundary are not those that are described");
  if (info_.cells.has_value() != static_cast<bool>(write_cells_))
    return fail(ErrorCode::invalid_argument, "cells that are not described, or the other way round");

  // The preamble comes last: only now is every offset known.
  SPLATVOL_TRY_ASSIGN(tail, append_tail(histograms));
  const Bytes padding(static_cast<std::size_t>(rows_offset_ - padding_offset_));
  add_sections(tail, padding);
  shared_bytes_ = file_.position() + sizeof(Footer);
  if (info_.series) SPLATVOL_TRY(append_steps(steps));
  file_bytes_ = file_.position() + sizeof(Footer);
  Bytes front = pack_section_table();
  const Footer footer = make_footer(file_bytes_, hash_bytes(front));
  SPLATVOL_TRY(file_.append(std::as_bytes(std::span(&footer, 1))));
  const std::array<const Bytes*, 4> parts = {&metadata_, &index_.root.bytes, &tail.directory_root, &padding};
  for (const Bytes* part : parts) front.insert(front.end(), part->begin(), part->end());
  return file_.write_at(0, front);
}

Status VolumeWriter::check(const Checking& checking) const {
  Status checked = [&]() -> Status {
    SPLATVOL_TRY_ASSIGN(source, open_file(file_.path_to_write()));
    SPLATVOL_TRY_ASSIGN(volume, Volume::open(std::move(source)));
    return volume->verify(checking.progress, checking.threads);
  }();
  if (checked || checked.error().code == ErrorCode::cancelled) return checked;
  return fail(checked.error().code, "the finished file is not kept, as reading it back finds it wrong: {}",
              checked.error().message);
}

Result<std::shared_ptr<const ChunkSource>> VolumeWriter::chunks() const {
  SPLATVOL_TRY_ASSIGN(file, open_file(file_.path_to_write()));
  return std::make_shared<const Chunks>(*this, std::move(file));
}

Status VolumeWriter::append_cells(Tail& tail) {
  SPLATVOL_TRY_ASSIGN(chunks, this->chunks());
  StreamHash hash;
  const auto append = [&](std::span<const std::byte> bytes) {
    hash.add(bytes);
    return file_.append(bytes);
  };
  SPLATVOL_TRY(write_cells_(std::move(chunks), append));
  tail.cells_bytes = file_.position() - tail.cells_offset;
  tail.cells_hash = hash.value();
  return {};
}

Status VolumeWriter::append_steps(std::span<const std::unique_ptr<StepWriter>> steps) {
  StepDirectory directory(info_.series->size(), file_.position());
  for (const std::unique_ptr<StepWriter>& step : steps)
    SPLATVOL_TRY(directory.write(*step, [&](std::span<const std::byte> bytes) { return file_.append(bytes); }));
  step_directory_ = directory.end();
  return file_.append(directory.pack());
}

Result<VolumeWriter::Tail> VolumeWriter::append_tail(const Histograms& histograms) {
  Tail tail;
  if (!info_.series) {
    const auto raw = std::as_bytes(std::span(histograms));
    tail.histogram_bytes = raw.size();
    tail.histograms = pack(raw);
  }
  const auto append = [&](std::span<const std::byte> bytes) { return file_.append(bytes); };
  file_.seek(rows_end_);
  SPLATVOL_TRY(file_.append(tail.histograms));
  tail.index_offset = file_.position();
  SPLATVOL_TRY(move_bytes(index_.pages, append));
  tail.directory_offset = file_.position();
  SPLATVOL_TRY(move_bytes(directory_.tail(), append, static_cast<bool>(write_cells_)));
  tail.boundary_offset = file_.position();
  SPLATVOL_TRY(file_.append(boundary_));
  tail.cells_offset = file_.position();
  if (write_cells_) SPLATVOL_TRY(append_cells(tail));
  tail.directory_root =
      directory_.pack_root(front_bytes_ + metadata_.size() + index_.root.bytes.size(), tail.directory_offset);
  return tail;
}

void VolumeWriter::add_sections(const Tail& tail, const Bytes& padding) {
  const auto codec_of = [](std::uint64_t raw_bytes, std::uint64_t packed_bytes) {
    return raw_bytes == packed_bytes ? Codec::raw : Codec::zstd;
  };
  std::uint64_t offset = front_bytes_;
  add_section(SectionKind::metadata, true, offset, metadata_, metadata_raw_.size(),
              codec_of(metadata_raw_.size(), metadata_.size()));
  offset += metadata_.size();
  const IndexPageRef& root = index_.root.ref;
  sections_.push_back(
      {SectionKind::index_root, 1, offset, index_.root.bytes.size(), root.front_bytes, root.hash, Codec::extent, 0});
  offset += index_.root.bytes.size();
  add_section(SectionKind::directory_root, true, offset, tail.directory_root, tail.directory_root.size(), Codec::raw);
  if (!padding.empty()) add_section(SectionKind::padding, false, padding_offset_, padding, padding.size(), Codec::raw);
  add_extent(SectionKind::rows, rows_offset_, rows_end_ - rows_offset_);
  if (!info_.series)
    add_section(SectionKind::histograms, false, rows_end_, tail.histograms, tail.histogram_bytes,
                codec_of(tail.histogram_bytes, tail.histograms.size()));
  add_extent(SectionKind::index_pages, tail.index_offset, tail.directory_offset - tail.index_offset);
  add_extent(SectionKind::directory_pages, tail.directory_offset, tail.boundary_offset - tail.directory_offset);
  if (info_.boundary)
    add_section(SectionKind::boundary, false, tail.boundary_offset, boundary_, boundary_.size(), Codec::raw);
  if (write_cells_)
    sections_.push_back(
        {SectionKind::cells, 0, tail.cells_offset, tail.cells_bytes, tail.cells_bytes, tail.cells_hash, Codec::raw, 0});
}

// The superblock and the section table.
Bytes VolumeWriter::pack_section_table() const {
  Superblock superblock{};
  if (has_two_sided(info_)) superblock.minor_version = two_sided_minor_version;
  superblock.file_bytes = file_bytes_;
  superblock.critical_features = info_.series ? series_feature : 0;
  superblock.step_directory = step_directory_;
  superblock.preamble_bytes = choose_preamble_bytes(shared_bytes_, rows_offset_, directory_.resolution_ends());
  return pack_front(superblock, false, sections_);
}

}  // namespace splatvol::format
