#include "format/volume.h"

#include <algorithm>
#include <array>
#include <bit>
#include <numeric>

namespace splatvol::format {
namespace {

constexpr std::uint64_t max_sections = 64;
constexpr std::array required_sections = {SectionKind::metadata,       SectionKind::index_root,
                                          SectionKind::directory_root, SectionKind::rows,
                                          SectionKind::index_pages,    SectionKind::directory_pages};

// An index page up to this size is read at once. Of a larger page, only the structure and the part of one attribute are
// read.
constexpr std::uint64_t one_read_bytes = 4u << 10;

bool is_known(SectionKind kind) {
  return kind == SectionKind::histograms || std::ranges::find(required_sections, kind) != required_sections.end();
}

bool is_extent(SectionKind kind) {
  return kind == SectionKind::index_root || kind == SectionKind::rows || kind == SectionKind::index_pages ||
         kind == SectionKind::directory_pages;
}

// Checks rule R7: the bytes of a section bound the memory that it may need.
bool has_valid_codec(const SectionEntry& section) {
  switch (section.codec) {
    case Codec::extent:
      return is_extent(section.kind);
    case Codec::raw:
      return !is_extent(section.kind) && section.unpacked_bytes == section.packed_bytes;
    case Codec::zstd:
      break;
  }
  return section.codec == Codec::zstd && !is_extent(section.kind) && section.kind != SectionKind::directory_root &&
         section.unpacked_bytes > section.packed_bytes &&
         (section.kind != SectionKind::metadata || section.unpacked_bytes <= max_metadata_bytes(section.packed_bytes));
}

}  // namespace

Volume::Volume(std::unique_ptr<ByteSource> source) : source_(std::move(source)) {}

Result<std::shared_ptr<const Volume>> Volume::open(std::unique_ptr<ByteSource> source) {
  std::shared_ptr<Volume> volume(new Volume(std::move(source)));
  SPLATVOL_TRY(volume->read_preamble());
  return volume;
}

tl::unexpected<Error> Volume::broken(std::string_view rule) const {
  return fail(ErrorCode::invalid_data, "{}: {}", name(), rule);
}

Status Volume::read_preamble() {
  const std::uint64_t size = source_->size();
  if (size < sizeof(Superblock)) return broken("not a .svol file: too short");
  preamble_.resize(std::min(size, std::clamp(size / 64, min_first_read_bytes, max_first_read_bytes)));
  SPLATVOL_TRY(source_->read(0, preamble_));
  bytes_read_ += preamble_.size();

  SPLATVOL_TRY(read_section_table());
  if (preamble_bytes_ > preamble_.size()) {
    const std::size_t had = preamble_.size();
    preamble_.resize(preamble_bytes_);
    SPLATVOL_TRY(source_->read(had, std::span(preamble_).subspan(had)));
    bytes_read_ += preamble_.size() - had;
  }
  SPLATVOL_TRY(check_sections());
  SPLATVOL_TRY(read_metadata());
  return read_directory_root();
}

Status Volume::read_section_table() {
  const auto superblock = read_record<Superblock>(preamble_, 0);
  if (!std::ranges::equal(superblock.magic, magic)) return broken("not a .svol file");
  if (superblock.major_version != major_version)
    return fail(ErrorCode::unsupported, "{}: written in format {}.{}; this program reads 1.x", name(),
                superblock.major_version, superblock.minor_version);
  if (hash_bytes(std::span(preamble_).first(offsetof(Superblock, hash))) != superblock.hash)
    return broken("superblock: checksum mismatch [R4]");
  if (superblock.critical_features != 0)
    return fail(ErrorCode::unsupported, "{}: needs a feature that this program lacks", name());
  if (superblock.file_bytes != source_->size())
    return fail(ErrorCode::invalid_data, "{}: truncated or grown: {} bytes instead of {} [R2]", name(), source_->size(),
                superblock.file_bytes);
  if (superblock.section_count == 0 || superblock.section_count > max_sections)
    return broken("section count out of range [R3]");

  const std::uint64_t table_bytes = superblock.section_count * sizeof(SectionEntry);
  preamble_bytes_ = superblock.preamble_bytes;
  if (preamble_bytes_ < sizeof(Superblock) + table_bytes ||
      preamble_bytes_ > std::min(superblock.file_bytes, max_preamble_bytes) ||
      sizeof(Superblock) + table_bytes > preamble_.size())
    return broken("preamble length out of range [R1]");
  const auto table = std::span(preamble_).subspan(sizeof(Superblock), table_bytes);
  if (hash_bytes(table) != superblock.section_table_hash) return broken("section table: checksum mismatch [R4]");
  for (std::size_t i = 0; i < superblock.section_count; ++i)
    sections_.push_back(read_record<SectionEntry>(table, i * sizeof(SectionEntry)));
  return {};
}

Status Volume::check_sections() const {
  if (source_->size() < sizeof(Footer)) return broken("no footer [R6]");
  std::uint64_t end = sizeof(Superblock) + sections_.size() * sizeof(SectionEntry);
  const std::uint64_t limit = source_->size() - sizeof(Footer);
  for (const SectionEntry& section : sections_) {
    if (!is_known(section.kind) && (section.flags & 1) != 0)
      return fail(ErrorCode::unsupported, "{}: needs section kind {}, which this program lacks [R5]", name(),
                  static_cast<std::uint32_t>(section.kind));
    if (section.offset != end || end > limit || section.packed_bytes > limit - end)
      return broken("sections do not tile the file [R6]");
    if (!has_valid_codec(section)) return broken("a section has the wrong codec or length [R7]");
    end += section.packed_bytes;
  }
  if (end != limit) return broken("sections do not tile the file [R6]");
  for (const SectionKind kind : required_sections)
    if (std::ranges::count(sections_, kind, &SectionEntry::kind) != 1)
      return broken("a section is absent or appears twice [R8]");
  if (std::ranges::count(sections_, SectionKind::histograms, &SectionEntry::kind) > 1)
    return broken("histograms appear twice [R8]");
  for (const SectionKind kind : {SectionKind::metadata, SectionKind::index_root, SectionKind::directory_root}) {
    const SectionEntry& section = *find_section(kind);
    if (section.offset + section.packed_bytes > preamble_bytes_) return broken("a section passes the preamble [R1]");
  }
  const SectionEntry& root = *find_section(SectionKind::index_root);
  if (root.unpacked_bytes > root.packed_bytes) return broken("root index page out of range [R15]");
  return {};
}

const SectionEntry* Volume::find_section(SectionKind kind) const {
  const auto found = std::ranges::find(sections_, kind, &SectionEntry::kind);
  return found == sections_.end() ? nullptr : &*found;
}

Result<Bytes> Volume::read_bytes(std::uint64_t offset, std::uint64_t count) const {
  if (offset <= preamble_.size() && count <= preamble_.size() - offset)
    return Bytes(preamble_.begin() + static_cast<std::ptrdiff_t>(offset),
                 preamble_.begin() + static_cast<std::ptrdiff_t>(offset + count));
  if (offset > source_->size() || count > source_->size() - offset)
    return fail(ErrorCode::invalid_data, "{}: {} bytes at {} are past the end [R6]", name(), count, offset);
  Bytes bytes(count);
  SPLATVOL_TRY(source_->read(offset, bytes));
  bytes_read_ += count;
  return bytes;
}

Result<Bytes> Volume::read_section(const SectionEntry& section) const {
  SPLATVOL_TRY_ASSIGN(packed, read_bytes(section.offset, section.packed_bytes));
  const std::string what = fmt::format("{}: section {}", name(), static_cast<std::uint32_t>(section.kind));
  return unpack_checked(section, packed, what);
}

Status Volume::read_metadata() {
  SPLATVOL_TRY_ASSIGN(raw, read_section(*find_section(SectionKind::metadata)));
  auto info = metadata_from_json(std::string(reinterpret_cast<const char*>(raw.data()), raw.size()));
  if (!info) return fail_in(name(), info.error());
  info_ = std::move(*info);
  rows_ = RowLayout(info_);
  return {};
}

Status Volume::read_directory_root() {
  const SectionEntry& section = *find_section(SectionKind::directory_root);
  const SectionEntry& tail = *find_section(SectionKind::directory_pages);
  SPLATVOL_TRY_ASSIGN(root, read_section(section));
  const std::uint64_t pages = rows_.directory_page_count();
  const std::uint64_t fixed = sizeof(std::uint64_t) + pages * sizeof(DirectoryPageRef);
  if (root.size() < sizeof(std::uint64_t) || read_record<std::uint64_t>(root, 0) != pages ||
      pages > root.size() / sizeof(DirectoryPageRef) || root.size() < fixed)
    return broken("directory: wrong number of pages [R11]");

  std::uint64_t next = section.offset + fixed;
  for (std::uint64_t page = 0; page < pages; ++page) {
    const auto ref = read_record<DirectoryPageRef>(root, sizeof(std::uint64_t) + page * sizeof(DirectoryPageRef));
    const std::uint64_t section_end =
        page == 0 ? section.offset + section.packed_bytes : tail.offset + tail.packed_bytes;
    if (ref.offset != next || ref.bytes > section_end - next || ref.bytes < sizeof(std::uint64_t) ||
        (ref.bytes - sizeof(std::uint64_t)) / sizeof(ChunkEntry) != rows_.chunks_of_directory_page(page) ||
        ref.bytes % sizeof(ChunkEntry) != sizeof(std::uint64_t))
      return broken("directory: pages do not tile their section [R11]");
    next += ref.bytes;
    if (page == 0 && next != section_end) return broken("directory: pages do not tile their section [R11]");
    if (page == 0) next = tail.offset;
    directory_refs_.push_back(ref);
  }
  if (next != tail.offset + tail.packed_bytes) return broken("directory: pages do not tile their section [R11]");
  return {};
}

NodeShape Volume::node_shape() const {
  return {info_.resolutions(), info_.size_bounds.size(), info_.attributes.size()};
}

std::vector<std::uint64_t> Volume::segment_counts() const {
  std::vector<std::uint64_t> counts = info_.resolution_counts;
  std::adjacent_difference(counts.begin(), counts.end(), counts.begin());
  return counts;
}

Status Volume::check_top_counts(const IndexPage& page, std::span<const std::uint64_t> expected) const {
  for (std::size_t s = 0; s < info_.resolutions(); ++s) {
    std::uint64_t sum = 0;
    for (std::uint32_t node = 0; node < page.top_nodes; ++node) sum += page.nodes.counts_of(node)[s];
    if (sum != expected[s]) return broken("the points of an index page do not add up [R14]");
  }
  return {};
}

Result<IndexPage> Volume::read_page(const IndexPageRef& ref, std::uint64_t offset, std::uint32_t top_nodes,
                                    std::uint64_t links_end, int attribute) const {
  const std::string what = name() + ": index page";
  const bool whole = attribute >= 0 && ref.page_bytes <= one_read_bytes;
  SPLATVOL_TRY_ASSIGN(bytes, read_bytes(offset, whole ? ref.page_bytes : ref.front_bytes));
  const auto front = std::span<const std::byte>(bytes).first(ref.front_bytes);
  SPLATVOL_TRY_ASSIGN(page, unpack_index_page(ref, front, node_shape(), top_nodes, links_end, what));
  if (attribute < 0) return page;

  const auto [part_offset, part] = find_summary_part(front, static_cast<std::size_t>(attribute), node_shape());
  if (whole) {
    SPLATVOL_TRY(
        unpack_summaries(part, std::span<const std::byte>(bytes).subspan(part_offset, part.packed_bytes), what, page));
  } else {
    SPLATVOL_TRY_ASSIGN(packed, read_bytes(offset + part_offset, part.packed_bytes));
    SPLATVOL_TRY(unpack_summaries(part, packed, what, page));
  }
  return page;
}

IndexPageRef Volume::root_ref() const {
  const SectionEntry& section = *find_section(SectionKind::index_root);
  return {0, static_cast<std::uint32_t>(section.unpacked_bytes), static_cast<std::uint32_t>(section.packed_bytes),
          section.hash};
}

Result<IndexPage> Volume::read_index_root(int attribute) const {
  const std::uint64_t links_end = find_section(SectionKind::index_pages)->packed_bytes;
  SPLATVOL_TRY_ASSIGN(page,
                      read_page(root_ref(), find_section(SectionKind::index_root)->offset, 1, links_end, attribute));
  SPLATVOL_TRY(check_top_counts(page, segment_counts()));
  return page;
}

Result<IndexPage> Volume::read_index_page(const IndexPageRef& ref, std::uint8_t child_mask,
                                          std::span<const std::uint64_t> parent_counts, int attribute) const {
  const std::uint64_t offset = find_section(SectionKind::index_pages)->offset + ref.offset;
  const auto children = static_cast<std::uint32_t>(std::popcount(child_mask));
  SPLATVOL_TRY_ASSIGN(page, read_page(ref, offset, children, ref.offset, attribute));
  SPLATVOL_TRY(check_top_counts(page, parent_counts));
  return page;
}

Result<DirectoryPage> Volume::read_directory_page(std::uint64_t page) const {
  const DirectoryPageRef& ref = directory_refs_[page];
  SPLATVOL_TRY_ASSIGN(bytes, read_bytes(ref.offset, ref.bytes));
  if (hash_bytes(bytes) != ref.hash)
    return fail(ErrorCode::invalid_data, "{}: directory page {}: checksum mismatch", name(), page);

  DirectoryPage result;
  result.first_row = rows_.first_row_of_directory_page(page);
  result.first_chunk = rows_.chunks_before(result.first_row);
  result.chunks.reserve((bytes.size() - sizeof(std::uint64_t)) / sizeof(ChunkEntry));
  const SectionEntry& section = *find_section(SectionKind::rows);
  const std::uint64_t end = section.offset + section.packed_bytes;
  std::uint64_t offset = read_record<std::uint64_t>(bytes, 0);
  if (offset < section.offset || offset > end)
    return fail(ErrorCode::invalid_data, "{}: directory page {} points outside [R12]", name(), page);
  std::size_t at = sizeof(std::uint64_t);
  for (std::uint64_t row = result.first_row; at < bytes.size(); ++row) {
    const std::uint64_t points = rows_.group(rows_.group_of_row(row)).count;
    for (std::size_t c = 0; c < rows_.columns_of_row(row).size(); ++c, at += sizeof(ChunkEntry)) {
      const auto entry = read_record<ChunkEntry>(bytes, at);
      if (entry.packed_bytes == 0 || entry.packed_bytes > end - offset) return broken("a chunk passes the rows [R12]");
      if (entry.unpacked_bytes > 64 + 64 * points) return broken("a chunk is too large [R10]");
      result.chunks.push_back({offset, entry});
      offset += entry.packed_bytes;
    }
  }
  return result;
}

const ChunkLocation& Volume::find_chunk(const DirectoryPage& page, std::uint64_t row, int column) const {
  const auto& columns = rows_.columns_of_row(row);
  const auto index = std::ranges::find(columns, column) - columns.begin();
  return page.chunks[rows_.chunks_before(row) - page.first_chunk + static_cast<std::uint64_t>(index)];
}

Result<Histograms> Volume::read_histograms() const {
  const SectionEntry* section = find_section(SectionKind::histograms);
  if (section == nullptr) return Histograms{};
  Histograms histograms(info_.attributes.size());
  const auto out = std::as_writable_bytes(std::span(histograms));
  if (section->unpacked_bytes != out.size()) return broken("histograms have the wrong size");
  SPLATVOL_TRY_ASSIGN(raw, read_section(*section));
  std::ranges::copy(raw, out.begin());
  return histograms;
}

}  // namespace splatvol::format
