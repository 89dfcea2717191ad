#include "format/volume_writer.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace splatvol::format {
namespace {

constexpr std::uint64_t section_count = 7;  // without padding

// Rows of at least this many bytes are moved without being copied, which needs padding. The choice depends on the file
// alone.
constexpr std::uint64_t padded_rows_bytes = 16u << 20;

constexpr std::uint64_t copied_at_once = 1u << 20;
constexpr std::uint64_t directory_page_target_bytes = 8u << 10;  // a quarter of the shortest first read

// Chooses pages of about 8 KiB. Pages are larger if the references to them would crowd the preamble: it holds the
// references and page 0, and both together are smallest where they are equally long.
std::uint32_t choose_rows_per_page(const VolumeInfo& info, const RowLayout& rows) {
  const auto row_bytes = static_cast<double>(std::max<std::size_t>(1, info.columns.size()) * sizeof(ChunkEntry));
  const double by_size = static_cast<double>(directory_page_target_bytes) / row_bytes;
  const double balanced = std::sqrt(static_cast<double>(rows.row_count() * sizeof(DirectoryPageRef)) / row_bytes);
  return static_cast<std::uint32_t>(std::clamp(std::max(by_size, balanced), 1.0, 0x1p24));
}

// Keeps to rule R7, which keeps a reader's memory in proportion to the bytes that it was given.
Bytes pack_metadata(const Bytes& raw) {
  Bytes packed = pack(raw);
  return raw.size() <= max_metadata_bytes(packed.size()) ? packed : raw;
}

// Copies part by part, and gives the disk space of each part back.
Status move_bytes(TempFile& from, AtomicFile& to) {
  Bytes part(std::min(from.size(), copied_at_once));
  for (std::uint64_t offset = 0; offset < from.size(); offset += part.size()) {
    part.resize(std::min<std::uint64_t>(part.size(), from.size() - offset));
    SPLATVOL_TRY(from.read(offset, part));
    SPLATVOL_TRY(to.append(part));
    from.release(offset, part.size());
  }
  return {};
}

}  // namespace

VolumeWriter::VolumeWriter(AtomicFile file, VolumeInfo info, PackedIndex index, TempFile directory_tail)
    : file_(std::move(file)),
      info_(std::move(info)),
      rows_(info_),
      index_(std::move(index)),
      directory_tail_(std::move(directory_tail)) {}

Result<std::unique_ptr<VolumeWriter>> VolumeWriter::create(const std::string& path, VolumeInfo info, PackedIndex index,
                                                           const std::string& temporary_folder) {
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path));
  return create(std::move(file), 0, std::move(info), std::move(index), temporary_folder);
}

Result<std::unique_ptr<VolumeWriter>> VolumeWriter::create(AtomicFile file, std::uint64_t bytes_before, VolumeInfo info,
                                                           PackedIndex index, const std::string& temporary_folder) {
  SPLATVOL_TRY(metadata_to_json(info));
  if (index.shape.resolutions != info.resolutions() || index.shape.size_bounds != info.size_bounds.size() ||
      index.shape.attributes != info.attributes.size())
    return fail(ErrorCode::invalid_argument, "the index is of another shape than the metadata");
  info.rows_per_directory_page = choose_rows_per_page(info, RowLayout(info));
  SPLATVOL_TRY_ASSIGN(directory_tail, TempFile::create(temporary_folder));
  std::unique_ptr<VolumeWriter> writer(
      new VolumeWriter(std::move(file), std::move(info), std::move(index), std::move(directory_tail)));
  SPLATVOL_TRY(writer->reserve_front(bytes_before));
  return writer;
}

Status VolumeWriter::reserve_front(std::uint64_t bytes_before) {
  SPLATVOL_TRY_ASSIGN(json, metadata_to_json(info_));
  const auto json_bytes = std::as_bytes(std::span(json));
  metadata_raw_.assign(json_bytes.begin(), json_bytes.end());
  metadata_ = pack_metadata(metadata_raw_);

  const std::uint64_t page_bytes = sizeof(std::uint64_t) + rows_.chunks_of_directory_page(0) * sizeof(ChunkEntry);
  const std::uint64_t root_bytes = directory_refs_bytes() + page_bytes;
  const bool padded = file_.position() >= padded_rows_bytes;
  front_bytes_ = sizeof(Superblock) + (section_count + (padded ? 1 : 0)) * sizeof(SectionEntry);
  padding_offset_ = front_bytes_ + metadata_.size() + index_.root.bytes.size() + root_bytes;
  const std::uint64_t unpadded = padding_offset_ + bytes_before, unit = AtomicFile::insertable_bytes;
  rows_offset_ = padding_offset_ + (padded ? unit - unpadded % unit : 0);
  if (rows_offset_ > max_preamble_bytes)
    return fail(ErrorCode::unsupported, "the description of {} attributes passes 1 MiB; choose fewer",
                info_.attributes.size());
  SPLATVOL_TRY(file_.insert_front(rows_offset_ + bytes_before));
  rows_end_ = rows_offset_;
  return {};
}

// Bytes of the directory root in front of page 0.
std::uint64_t VolumeWriter::directory_refs_bytes() const {
  return sizeof(std::uint64_t) + rows_.directory_page_count() * sizeof(DirectoryPageRef);
}

Status VolumeWriter::append_row(std::span<const PackedChunk> chunks) {
  std::vector<ChunkEntry> entries;
  Bytes bytes;
  for (const PackedChunk& chunk : chunks) {
    entries.push_back(chunk.entry);
    bytes.insert(bytes.end(), chunk.bytes.begin(), chunk.bytes.end());
  }
  return append_row(entries, bytes);
}

Status VolumeWriter::append_row(std::span<const ChunkEntry> entries, std::span<const std::byte> bytes) {
  std::uint64_t packed_bytes = 0;
  for (const ChunkEntry& entry : entries) packed_bytes += entry.packed_bytes;
  if (packed_bytes != bytes.size())
    return fail(ErrorCode::invalid_argument, "row {} has {} bytes for chunks of {}", next_row_, bytes.size(),
                packed_bytes);
  if (file_.position() != rows_end_) file_.seek(rows_end_);
  SPLATVOL_TRY(add_written_row(entries));
  return file_.append(bytes);
}

Status VolumeWriter::add_written_row(std::span<const ChunkEntry> entries) {
  if (next_row_ >= rows_.row_count() || entries.size() != rows_.columns_of_row(next_row_).size())
    return fail(ErrorCode::invalid_argument, "row {} has {} chunks", next_row_, entries.size());
  if (directory_page_.empty()) append_record(directory_page_, rows_end_);
  for (const ChunkEntry& entry : entries) {
    append_record(directory_page_, entry);
    rows_end_ += entry.packed_bytes;
  }
  const std::size_t resolution = rows_.resolution_of_row(next_row_);
  ++next_row_;
  const bool last = next_row_ == rows_.row_count();
  if (last || next_row_ % info_.rows_per_directory_page == 0) SPLATVOL_TRY(close_directory_page());
  if (last || rows_.resolution_of_row(next_row_) != resolution) resolution_ends_.push_back(rows_end_);
  return {};
}

Status VolumeWriter::close_directory_page() {
  const bool head = directory_refs_.empty();
  directory_refs_.push_back({directory_tail_.size(), directory_page_.size(), hash_bytes(directory_page_)});
  if (head)
    directory_head_ = directory_page_;
  else
    SPLATVOL_TRY(directory_tail_.append(directory_page_));
  directory_page_.clear();
  return {};
}

void VolumeWriter::add_section(SectionKind kind, bool critical, std::uint64_t offset, std::span<const std::byte> packed,
                               std::uint64_t unpacked_bytes, Codec codec) {
  sections_.push_back({kind, critical ? 1u : 0u, offset, packed.size(), unpacked_bytes, hash_bytes(packed), codec, 0});
}

void VolumeWriter::add_extent(SectionKind kind, std::uint64_t offset, std::uint64_t bytes) {
  sections_.push_back({kind, 1, offset, bytes, 0, 0, Codec::extent, 0});
}

// Takes in as many of the coarsest resolutions as a reader's first read holds. Takes in resolution 0 even if it is
// larger, up to 1 MiB.
std::uint64_t VolumeWriter::choose_preamble_bytes() const {
  const std::uint64_t first_read = std::clamp(file_bytes_ / 64, min_first_read_bytes, max_first_read_bytes);
  std::uint64_t preamble = resolution_ends_[0] <= max_preamble_bytes ? resolution_ends_[0] : rows_offset_;
  for (const std::uint64_t end : resolution_ends_)
    if (end <= first_read) preamble = std::max(preamble, end);
  return preamble;
}

Status VolumeWriter::finish(const Histograms& histograms) {
  if (histograms.size() != info_.attributes.size())
    return fail(ErrorCode::invalid_argument, "{} histograms for {} attributes", histograms.size(),
                info_.attributes.size());
  if (next_row_ != rows_.row_count())
    return fail(ErrorCode::invalid_argument, "{} of {} rows were written", next_row_, rows_.row_count());

  // The preamble comes last: only now is every offset known.
  SPLATVOL_TRY_ASSIGN(tail, append_tail(histograms));
  const Bytes directory_root = pack_directory_root(tail.directory_offset);
  const Bytes padding(rows_offset_ - padding_offset_);
  add_sections(tail, directory_root, padding);
  file_bytes_ = tail.end + sizeof(Footer);
  Bytes front = pack_section_table();
  SPLATVOL_TRY(append_footer(hash_bytes(front)));
  const std::array<const Bytes*, 4> parts = {&metadata_, &index_.root.bytes, &directory_root, &padding};
  for (const Bytes* part : parts) front.insert(front.end(), part->begin(), part->end());
  SPLATVOL_TRY(file_.write_at(0, front));
  return file_.commit();
}

Result<VolumeWriter::Tail> VolumeWriter::append_tail(const Histograms& histograms) {
  Tail tail;
  const auto raw = std::as_bytes(std::span(histograms));
  tail.histogram_bytes = raw.size();
  tail.histograms = pack(raw);
  file_.seek(rows_end_);
  SPLATVOL_TRY(file_.append(tail.histograms));
  tail.index_offset = file_.position();
  SPLATVOL_TRY(move_bytes(index_.pages, file_));
  tail.directory_offset = file_.position();
  SPLATVOL_TRY(move_bytes(directory_tail_, file_));
  tail.end = file_.position();
  return tail;
}

// The references, then page 0. The other pages lie in the file from `tail_offset` on.
Bytes VolumeWriter::pack_directory_root(std::uint64_t tail_offset) {
  const std::uint64_t head_offset = front_bytes_ + metadata_.size() + index_.root.bytes.size() + directory_refs_bytes();
  for (std::size_t page = 0; page < directory_refs_.size(); ++page)
    directory_refs_[page].offset = page == 0 ? head_offset : tail_offset + directory_refs_[page].offset;
  Bytes root;
  append_record(root, std::uint64_t{directory_refs_.size()});
  for (const DirectoryPageRef& ref : directory_refs_) append_record(root, ref);
  root.insert(root.end(), directory_head_.begin(), directory_head_.end());
  return root;
}

void VolumeWriter::add_sections(const Tail& tail, const Bytes& directory_root, const Bytes& padding) {
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
  add_section(SectionKind::directory_root, true, offset, directory_root, directory_root.size(), Codec::raw);
  if (!padding.empty()) add_section(SectionKind::padding, false, padding_offset_, padding, padding.size(), Codec::raw);
  add_extent(SectionKind::rows, rows_offset_, rows_end_ - rows_offset_);
  add_section(SectionKind::histograms, false, rows_end_, tail.histograms, tail.histogram_bytes,
              codec_of(tail.histogram_bytes, tail.histograms.size()));
  add_extent(SectionKind::index_pages, tail.index_offset, tail.directory_offset - tail.index_offset);
  add_extent(SectionKind::directory_pages, tail.directory_offset, tail.end - tail.directory_offset);
}

// The superblock and the section table.
Bytes VolumeWriter::pack_section_table() const {
  Superblock superblock{};
  std::ranges::copy(magic, superblock.magic);
  superblock.major_version = major_version;
  superblock.minor_version = minor_version;
  superblock.file_bytes = file_bytes_;
  superblock.preamble_bytes = choose_preamble_bytes();
  superblock.section_count = static_cast<std::uint32_t>(sections_.size());
  superblock.section_table_hash = hash_bytes(std::as_bytes(std::span(sections_)));
  superblock.hash = hash_bytes(std::as_bytes(std::span(&superblock, 1)).first(offsetof(Superblock, hash)));
  Bytes table;
  append_record(table, superblock);
  for (const SectionEntry& section : sections_) append_record(table, section);
  return table;
}

Status VolumeWriter::append_footer(std::uint64_t table_hash) {
  Footer footer{};
  std::ranges::copy(footer_magic, footer.magic);
  footer.file_bytes = file_bytes_;
  footer.table_hash = table_hash;
  footer.hash = hash_bytes(std::as_bytes(std::span(&footer, 1)).first(offsetof(Footer, hash)));
  return file_.append(std::as_bytes(std::span(&footer, 1)));
}

}  // namespace splatvol::format
