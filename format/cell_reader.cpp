#include "format/cell_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace splatvol::format {
namespace {

// How many bytes at the end of a section are read at once: they hold the root, and mostly all pages of chunks.
std::uint64_t first_read_bytes(std::uint64_t section) {
  return std::min(section, std::clamp<std::uint64_t>(section / 64, std::uint64_t{1} << 16, std::uint64_t{1} << 19));
}

bool is_box(const double (&low)[3], const double (&high)[3]) {
  for (int axis = 0; axis < 3; ++axis)
    if (!(low[axis] <= high[axis] && std::abs(low[axis]) <= 1e61 && std::abs(high[axis]) <= 1e61)) return false;
  return true;
}

bool is_within(const CellChunkEntry& entry, const CellPageRef& page) {
  for (int axis = 0; axis < 3; ++axis)
    if (entry.low[axis] < page.low[axis] || entry.high[axis] > page.high[axis]) return false;
  return true;
}

bool is_area(double area) { return area >= 0 && std::isfinite(area); }

template <class Record>
std::vector<Record> take_records(std::span<const std::byte>& bytes, std::uint64_t count) {
  std::vector<Record> records;
  for (std::size_t i = 0; i < count; ++i) records.push_back(read_record<Record>(bytes, i * sizeof(Record)));
  bytes = bytes.subspan(records.size() * sizeof(Record));
  return records;
}

}  // namespace

CellReader::CellReader(const VolumeInfo& info, std::string name, std::uint64_t bytes, ReadBytes read)
    : info_(info),
      name_(std::move(name)),
      bytes_(bytes),
      read_(std::move(read)),
      attributes_(info.series ? 0 : info.attributes.size()),
      counts_(info.segment_counts()) {}

bool CellReader::has_cells(const Volume& volume) {
  return std::ranges::find(volume.sections(), SectionKind::cells, &SectionEntry::kind) != volume.sections().end();
}

Result<std::unique_ptr<const CellReader>> CellReader::open(const Volume& volume) {
  const auto section = std::ranges::find(volume.sections(), SectionKind::cells, &SectionEntry::kind);
  if (section == volume.sections().end()) return nullptr;
  const auto read = [&volume, begin = section->offset](std::uint64_t offset, std::uint64_t count) {
    return volume.read_bytes(begin + offset, count);
  };
  std::unique_ptr<CellReader> reader(new CellReader(volume.info(), volume.name(), section->packed_bytes, read));
  reader->volume_ = &volume;
  reader->begin_ = section->offset;
  SPLATVOL_TRY(reader->read_root());
  if (volume.series()) SPLATVOL_TRY(reader->read_step());
  return reader;
}

Result<std::unique_ptr<const CellReader>> CellReader::open(const VolumeInfo& info, std::string name,
                                                           std::uint64_t bytes, ReadBytes read) {
  std::unique_ptr<CellReader> reader(new CellReader(info, std::move(name), bytes, std::move(read)));
  SPLATVOL_TRY(reader->read_root());
  return reader;
}

tl::unexpected<Error> CellReader::broken(std::string_view rule) const {
  return fail(ErrorCode::invalid_data, "{}: {} [R23]", name_, rule);
}

// The table of a step's pages of summaries is the last part of their section.
Status CellReader::read_step() {
  const std::vector<SectionEntry> sections = volume_->step_sections();
  const auto section = std::ranges::find(sections, SectionKind::cell_summaries, &SectionEntry::kind);
  if (section == sections.end()) return {};
  const std::size_t table = pages_.size() * sizeof(SummaryPageRef) + sizeof(std::uint64_t);
  if (table > section->packed_bytes) return broken("the summaries of cells have the wrong length");
  step_offset_ = volume_->series()->steps[volume_->step()].offset + section->offset;
  const std::uint64_t first = std::max<std::uint64_t>(table, first_read_bytes(section->packed_bytes));
  SPLATVOL_TRY_SET(step_tail_.bytes, volume_->read_bytes(step_offset_ + section->packed_bytes - first, first));
  step_tail_.begin = section->packed_bytes - first;
  const auto bytes = std::span<const std::byte>(step_tail_.bytes).last(table);
  std::span<const std::byte> records = bytes.first(table - sizeof(std::uint64_t));
  if (hash_bytes(records) != read_record<std::uint64_t>(bytes, records.size()))
    return broken("the summaries of cells: checksum mismatch");
  step_pages_ = take_records<SummaryPageRef>(records, pages_.size());
  std::uint64_t next = 0;
  for (std::size_t page = 0; page < pages_.size(); ++page) {
    const SummaryPageRef& ref = step_pages_[page];
    if (ref.offset != next || ref.page_bytes > section->packed_bytes - table - next ||
        ref.node_count != pages_[page].chunks)
      return broken("the summaries of cells do not tile their section");
    next += ref.page_bytes;
  }
  if (next != section->packed_bytes - table) return broken("the summaries of cells do not tile their section");
  step_tail_.bytes.resize(step_tail_.bytes.size() - table);
  return {};
}

// Reads a part of the section.
Result<Bytes> CellReader::read(std::uint64_t offset, std::uint64_t count) const {
  if (tail_.holds(offset, count)) return tail_.part(offset, count);
  return read_(offset, count);
}

// Numbers that the file states take no memory before its own length backs them.
Status CellReader::read_root() {
  const std::uint64_t section = bytes_;
  if (section < sizeof(CellsTail)) return broken("the section of cells is too short");
  SPLATVOL_TRY_ASSIGN(bytes, read_(section - first_read_bytes(section), first_read_bytes(section)));
  const auto tail = read_record<CellsTail>(bytes, bytes.size() - sizeof(CellsTail));
  if (tail.version != cells_version)
    return fail(ErrorCode::unsupported, "{}: its cells are laid out in a way that this program does not know [R23]",
                name_);
  const std::uint64_t points = info_.resolution_counts.back(), left = section - sizeof(CellsTail);
  const std::uint64_t rank_pages = (points + rank_page_points - 1) / rank_page_points;
  const std::uint64_t vertex_pages = tail.vertices / vertex_page_points + (tail.vertices % vertex_page_points > 0);
  if (tail.kinds > left / sizeof(CellKind) || tail.pages > left / sizeof(CellPageRef) ||
      rank_pages + vertex_pages > left / sizeof(PackedPageRef))
    return broken("the root of the cells has the wrong length");
  const std::uint64_t root = tail.kinds * sizeof(CellKind) + tail.pages * sizeof(CellPageRef) +
                             (rank_pages + vertex_pages) * sizeof(PackedPageRef);
  if (root > left) return broken("the root of the cells has the wrong length");
  vertex_count_ = tail.vertices;
  root_bytes_ = root + sizeof(CellsTail);
  if (root_bytes_ > bytes.size()) SPLATVOL_TRY_SET(bytes, read_(section - root_bytes_, root_bytes_));
  SPLATVOL_TRY(take_root(std::span<const std::byte>(bytes).last(static_cast<std::size_t>(root_bytes_)), tail));
  tail_.begin = section - bytes.size();
  bytes.resize(static_cast<std::size_t>(bytes.size() - root_bytes_));
  tail_.bytes = std::move(bytes);
  return {};
}

Status CellReader::take_root(std::span<const std::byte> root, const CellsTail& tail) {
  std::span<const std::byte> records = root.first(root.size() - sizeof(CellsTail));
  if (hash_bytes(records) != tail.hash) return broken("the root of the cells: checksum mismatch");
  kinds_ = take_records<CellKind>(records, tail.kinds);
  pages_ = take_records<CellPageRef>(records, tail.pages);
  rank_pages_ =
      take_records<PackedPageRef>(records, (info_.resolution_counts.back() + rank_page_points - 1) / rank_page_points);
  vertex_pages_ = take_records<PackedPageRef>(records, records.size() / sizeof(PackedPageRef));
  chunk_count_ = tail.chunks;
  return check_tiling();
}

// Pages of ranks and of vertices; then the chunks; then the pages of chunks; then the root.
Status CellReader::check_tiling() const {
  const std::uint64_t end = bytes_ - root_bytes_;
  const std::uint64_t table = (1 + attributes_) * sizeof(IndexPagePart);
  const std::uint64_t chunk_bytes = sizeof(CellChunkEntry) + attributes_ * summary_bytes;
  const auto untiled = [&] { return broken("parts of the cells do not tile their section"); };
  std::uint64_t next = 0, chunks = 0;
  for (const PackedPageRef& page : rank_pages_) {
    if (page.offset != next || page.packed_bytes > end - next) return untiled();
    if (page.packed_bytes > page.unpacked_bytes ||
        page.unpacked_bytes > counts_.size() * sizeof(std::uint64_t) + rank_page_points)
      return broken("a page of ranks has the wrong length");
    next += page.packed_bytes;
  }
  for (const PackedPageRef& page : vertex_pages_) {
    if (page.offset != next || page.packed_bytes > end - next) return untiled();
    if (page.packed_bytes > page.unpacked_bytes || page.unpacked_bytes > 64 + 24 * vertex_page_points)
      return broken("a page of vertices has the wrong length");
    next += page.packed_bytes;
  }
  const std::uint64_t chunks_end = pages_.empty() ? end : pages_.front().offset;
  if (next > chunks_end || (pages_.empty() ? end : pages_.front().chunks_offset) != next) return untiled();
  next = chunks_end;
  for (std::size_t p = 0; p < pages_.size(); ++p) {
    const CellPageRef& page = pages_[p];
    if (page.offset != next || page.offset > end || page.page_bytes > end - page.offset || page.page_bytes < table ||
        page.chunks_offset > chunks_end_of(p))
      return untiled();
    if (page.chunks == 0 || page.chunks > max_page_chunks || page.page_bytes > table + page.chunks * chunk_bytes ||
        !is_box(page.low, page.high) || !is_area(page.area))
      return broken("a page of cells is out of range");
    next += page.page_bytes;
    chunks += page.chunks;
  }
  if (chunks != chunk_count_) return broken("the chunks of cells are not as many as stated");
  return next == end ? Status{} : untiled();
}

std::uint64_t CellReader::chunks_end_of(std::size_t page) const {
  return page + 1 < pages_.size() ? pages_[page + 1].chunks_offset : pages_.front().offset;
}

std::uint64_t CellReader::rank_bytes() const {
  std::uint64_t bytes = 0;
  for (const PackedPageRef& page : rank_pages_) bytes += page.packed_bytes;
  return bytes;
}

std::uint64_t CellReader::vertex_bytes() const {
  std::uint64_t bytes = 0;
  for (const PackedPageRef& page : vertex_pages_) bytes += page.packed_bytes;
  return bytes;
}

std::uint64_t CellReader::directory_bytes() const {
  std::uint64_t bytes = root_bytes_;
  for (const CellPageRef& page : pages_) bytes += page.page_bytes;
  return bytes;
}

std::uint64_t CellReader::memory_bytes() const {
  return kinds_.size() * sizeof(CellKind) + pages_.size() * sizeof(CellPageRef) +
         (rank_pages_.size() + vertex_pages_.size()) * sizeof(PackedPageRef) + tail_.bytes.size() +
         step_pages_.size() * sizeof(SummaryPageRef) + step_tail_.bytes.size();
}

Status CellReader::check_entry(const CellChunkEntry& entry) const {
  if (entry.cells == 0 || entry.cells > max_chunk_cells || entry.packed_bytes > entry.unpacked_bytes ||
      !is_box(entry.low, entry.high) || !is_area(entry.area))
    return broken("a chunk of cells is out of range");
  if (!is_known(entry.shape, entry.field)) return {};
  const std::size_t least = entry.shape == CellShape::polyhedron ? least_polyhedron_corners : corners_of(entry.shape);
  if (entry.unpacked_bytes > most_unpacked_bytes(entry) || entry.points < least || entry.points > most_corners(entry))
    return broken("a chunk of cells has the wrong length");
  return {};
}

// Finds the parts of a page. The first has `first_bytes` for each chunk, the others are summaries.
Result<CellReader::Parts> CellReader::read_parts(Bytes bytes, std::uint64_t hash, std::size_t count,
                                                 std::size_t first_bytes, std::uint32_t chunks,
                                                 const std::string& what) const {
  Parts parts{std::move(bytes), {}};
  const std::size_t table = count * sizeof(IndexPagePart);
  if (parts.bytes.size() < table || hash_bytes(std::span(parts.bytes).first(table)) != hash)
    return fail(ErrorCode::invalid_data, "{}: checksum mismatch", what);
  std::uint64_t end = table;
  for (std::size_t p = 0; p < count; ++p) {
    const auto part = read_record<IndexPagePart>(parts.bytes, p * sizeof(IndexPagePart));
    const std::uint64_t length = chunks * (p == 0 ? first_bytes : summary_bytes);
    if (part.unpacked_bytes != length || part.packed_bytes > length || part.packed_bytes > parts.bytes.size() - end)
      return broken("a part of a page of cells has the wrong length");
    parts.at.emplace_back(end, part);
    end += part.packed_bytes;
  }
  if (end != parts.bytes.size()) return broken("a page of cells has bytes left over");
  return parts;
}

ByteRange CellReader::range_of(const CellChunkEntry& entry) const {
  return {begin_ + entry.offset, begin_ + entry.offset + entry.packed_bytes};
}

Result<std::shared_ptr<const BytesAhead>> CellReader::read_pages_ahead(std::span<const std::size_t> pages,
                                                                       MemoryShare& share) const {
  std::vector<ByteRange> ranges;
  const auto add = [&](const Tail& tail, std::uint64_t begin, std::uint64_t offset, std::uint64_t count) {
    if (!tail.holds(offset, count)) ranges.push_back({begin + offset, begin + offset + count});
  };
  for (const std::size_t page : pages) {
    add(tail_, begin_, pages_[page].offset, pages_[page].page_bytes);
    if (!step_pages_.empty()) add(step_tail_, step_offset_, step_pages_[page].offset, step_pages_[page].page_bytes);
  }
  return volume_->read_ahead(std::move(ranges), share);
}

Result<CellPage> CellReader::read_page(std::size_t page, const SummaryAttributes& attributes) const {
  const CellPageRef& ref = pages_[page];
  const std::string what = fmt::format("{}: page {} of the cells", name_, page);
  SPLATVOL_TRY_ASSIGN(bytes, this->read(ref.offset, ref.page_bytes));
  SPLATVOL_TRY_ASSIGN(
      parts, read_parts(std::move(bytes), ref.hash, 1 + attributes_, sizeof(CellChunkEntry), ref.chunks, what));
  CellPage read;
  const auto packed = std::span<const std::byte>(parts.bytes)
                          .subspan(static_cast<std::size_t>(parts.at[0].first), parts.at[0].second.packed_bytes);
  SPLATVOL_TRY_ASSIGN(entries, unpack_checked(parts.at[0].second, packed, what));
  std::span<const std::byte> records = entries;
  read.chunks = take_records<CellChunkEntry>(records, ref.chunks);
  std::uint64_t next = ref.chunks_offset;
  const std::uint64_t end = chunks_end_of(page);
  for (const CellChunkEntry& entry : read.chunks) {
    SPLATVOL_TRY(check_entry(entry));
    if (entry.offset != next || entry.packed_bytes > end - next || !is_within(entry, ref))
      return broken("chunks of cells do not tile their section, or pass the box of their page");
    next += entry.packed_bytes;
  }
  if (next != end) return broken("chunks of cells do not tile their section");
  if (attributes.values >= 0) SPLATVOL_TRY_SET(read.summaries, read_summaries(page, attributes.values, parts));
  if (attributes.opacity >= 0)
    SPLATVOL_TRY_SET(read.opacity_summaries, read_summaries(page, attributes.opacity, parts));
  return read;
}

// `parts`: of the page of chunks; those of a series have their summaries in the step.
Result<std::vector<ValueSummary>> CellReader::read_summaries(std::size_t page, int attribute,
                                                             const Parts& parts) const {
  const std::uint32_t chunks = pages_[page].chunks;
  const std::string what = fmt::format("{}: summaries of page {} of the cells", name_, page);
  const auto unpack = [&](const Parts& from, std::size_t p) {
    const auto [offset, part] = from.at[p];
    return unpack_summaries(
        part, std::span<const std::byte>(from.bytes).subspan(static_cast<std::size_t>(offset), part.packed_bytes),
        chunks, what);
  };
  if (!info_.series) return unpack(parts, 1 + static_cast<std::size_t>(attribute));
  if (step_pages_.empty()) {
    constexpr float all = largest_stored_value;
    return std::vector<ValueSummary>(chunks, {-all, all, ~std::uint64_t{0}});
  }
  const SummaryPageRef& ref = step_pages_[page];
  SPLATVOL_TRY_ASSIGN(bytes, step_tail_.holds(ref.offset, ref.page_bytes)
                                 ? step_tail_.part(ref.offset, ref.page_bytes)
                                 : volume_->read_bytes(step_offset_ + ref.offset, ref.page_bytes));
  SPLATVOL_TRY_ASSIGN(step_parts,
                      read_parts(std::move(bytes), ref.hash, info_.attributes.size(), summary_bytes, chunks, what));
  return unpack(step_parts, static_cast<std::size_t>(attribute));
}

Result<CellChunk> CellReader::read_chunk(const CellChunkEntry& entry) const {
  SPLATVOL_TRY_ASSIGN(packed, read(entry.offset, entry.packed_bytes));
  const std::string what = fmt::format("{}: cells at {}", name_, entry.offset);
  return unpack_cells(entry, packed, info_.resolution_counts.back(), vertex_count_, what);
}

Result<std::vector<dvec3>> CellReader::read_vertex_page(std::size_t page) const {
  const PackedPageRef& ref = vertex_pages_[page];
  SPLATVOL_TRY_ASSIGN(packed, read(ref.offset, ref.packed_bytes));
  const std::uint64_t first = page * std::uint64_t{vertex_page_points};
  std::vector<dvec3> vertices(
      static_cast<std::size_t>(std::min<std::uint64_t>(vertex_page_points, vertex_count_ - first)));
  ChunkEntry entry{};
  entry.hash = ref.hash;
  entry.packed_bytes = ref.packed_bytes;
  entry.unpacked_bytes = ref.unpacked_bytes;
  const std::string what = fmt::format("{}: page {} of vertices", name_, page);
  SPLATVOL_TRY(unpack_vertices(entry, packed, vertices, info_.cube, what));
  return vertices;
}

Status CellReader::check_bytes(const CellChunkEntry& entry) const {
  SPLATVOL_TRY_ASSIGN(packed, read(entry.offset, entry.packed_bytes));
  return check_packed(entry, packed, fmt::format("{}: cells at {}", name_, entry.offset));
}

Result<RankPage> CellReader::read_rank_page(std::size_t page) const {
  const PackedPageRef& ref = rank_pages_[page];
  SPLATVOL_TRY_ASSIGN(packed, read(ref.offset, ref.packed_bytes));
  const std::uint64_t first = page * std::uint64_t{rank_page_points};
  const auto ranks =
      static_cast<std::size_t>(std::min<std::uint64_t>(rank_page_points, info_.resolution_counts.back() - first));
  const std::string what = fmt::format("{}: page {} of ranks", name_, page);
  return unpack_rank_page(ref, packed, first, ranks, counts_, what);
}

}  // namespace splatvol::format
