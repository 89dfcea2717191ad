#include "format/cell_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace splatvol::format {
namespace {

constexpr std::uint64_t draft = 1;  // CellsTail::version

// The root is mostly within one read of so many bytes.
constexpr std::uint64_t first_read_bytes = std::uint64_t{1} << 16;

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

std::vector<std::uint64_t> segment_counts(const VolumeInfo& info) {
  std::vector<std::uint64_t> counts;
  std::uint64_t before = 0;
  for (const std::uint64_t count : info.resolution_counts) counts.push_back(count - std::exchange(before, count));
  return counts;
}

template <class Record>
std::vector<Record> take_records(std::span<const std::byte>& bytes, std::uint64_t count) {
  std::vector<Record> records;
  for (std::uint64_t i = 0; i < count; ++i) records.push_back(read_record<Record>(bytes, i * sizeof(Record)));
  bytes = bytes.subspan(count * sizeof(Record));
  return records;
}

}  // namespace

CellReader::CellReader(const Volume& volume, const SectionEntry& section)
    : volume_(volume), section_(section), counts_(segment_counts(volume.info())) {}

bool CellReader::has_cells(const Volume& volume) {
  return std::ranges::find(volume.sections(), SectionKind::cells_draft, &SectionEntry::kind) != volume.sections().end();
}

Result<std::unique_ptr<const CellReader>> CellReader::open(const Volume& volume) {
  const auto section = std::ranges::find(volume.sections(), SectionKind::cells_draft, &SectionEntry::kind);
  if (section == volume.sections().end()) return nullptr;
  std::unique_ptr<CellReader> reader(new CellReader(volume, *section));
  SPLATVOL_TRY(reader->read_root());
  return reader;
}

tl::unexpected<Error> CellReader::broken(std::string_view rule) const {
  return fail(ErrorCode::invalid_data, "{}: {} [R23]", volume_.name(), rule);
}

Result<Bytes> CellReader::read_bytes(std::uint64_t offset, std::uint64_t count) const {
  return volume_.read_bytes(section_.offset + offset, count);
}

// Numbers that the file states take no memory before its own length backs them.
Status CellReader::read_root() {
  const std::uint64_t section = section_.packed_bytes;
  if (section < sizeof(CellsTail)) return broken("the section of cells is too short");
  const std::uint64_t first = std::min(section, first_read_bytes);
  SPLATVOL_TRY_ASSIGN(bytes, read_bytes(section - first, first));
  const auto tail = read_record<CellsTail>(bytes, bytes.size() - sizeof(CellsTail));
  if (tail.version != draft)
    return fail(ErrorCode::unsupported, "{}: its cells are of a draft that this program does not read: build it again",
                volume_.name());
  const std::uint64_t points = volume_.info().resolution_counts.back();
  const std::uint64_t rank_pages = (points + rank_page_points - 1) / rank_page_points;
  const std::uint64_t left = section - sizeof(CellsTail);
  if (tail.kinds > left / sizeof(CellKind) || tail.pages > left / sizeof(CellPageRef) ||
      rank_pages > left / sizeof(RankPageRef))
    return broken("the root of the cells has the wrong length");
  const std::uint64_t root =
      tail.kinds * sizeof(CellKind) + tail.pages * sizeof(CellPageRef) + rank_pages * sizeof(RankPageRef);
  if (root > left) return broken("the root of the cells has the wrong length");
  root_bytes_ = root + sizeof(CellsTail);
  if (root_bytes_ > bytes.size()) {
    SPLATVOL_TRY_ASSIGN(whole, read_bytes(section - root_bytes_, root_bytes_));
    bytes = std::move(whole);
  }
  return take_root(std::span<const std::byte>(bytes).last(root_bytes_), tail);
}

Status CellReader::take_root(std::span<const std::byte> root, const CellsTail& tail) {
  std::span<const std::byte> records = root.first(root.size() - sizeof(CellsTail));
  if (hash_bytes(records) != tail.hash) return broken("the root of the cells: checksum mismatch");
  kinds_ = take_records<CellKind>(records, tail.kinds);
  pages_ = take_records<CellPageRef>(records, tail.pages);
  rank_pages_ = take_records<RankPageRef>(records, records.size() / sizeof(RankPageRef));
  chunk_count_ = tail.chunks;
  return check_tiling();
}

// Pages of ranks; then the chunks of each page of chunks, and the page; then the root.
Status CellReader::check_tiling() const {
  const std::uint64_t end = section_.packed_bytes - root_bytes_;
  const std::uint64_t attributes = volume_.info().attributes.size(), table = (1 + attributes) * sizeof(IndexPagePart);
  const std::uint64_t chunk_bytes = sizeof(CellChunkEntry) + attributes * summary_bytes;
  const auto untiled = [&] { return broken("parts of the cells do not tile their section"); };
  std::uint64_t next = 0, chunks = 0;
  for (const RankPageRef& page : rank_pages_) {
    if (page.offset != next || page.packed_bytes > end - next) return untiled();
    if (page.packed_bytes > page.unpacked_bytes ||
        page.unpacked_bytes > counts_.size() * sizeof(std::uint64_t) + rank_page_points)
      return broken("a page of ranks has the wrong length");
    next += page.packed_bytes;
  }
  for (const CellPageRef& page : pages_) {
    if (page.offset < next || page.offset > end || page.page_bytes > end - page.offset || page.page_bytes < table)
      return untiled();
    if (page.chunks == 0 || page.chunks > max_page_chunks || page.page_bytes > table + page.chunks * chunk_bytes ||
        !is_box(page.low, page.high) || !is_area(page.area))
      return broken("a page of cells is out of range");
    next = page.offset + page.page_bytes;
    chunks += page.chunks;
  }
  if (chunks != chunk_count_) return broken("the chunks of cells are not as many as stated");
  return next == end ? Status{} : untiled();
}

std::uint64_t CellReader::rank_bytes() const {
  std::uint64_t bytes = 0;
  for (const RankPageRef& page : rank_pages_) bytes += page.packed_bytes;
  return bytes;
}

std::uint64_t CellReader::directory_bytes() const {
  std::uint64_t bytes = root_bytes_;
  for (const CellPageRef& page : pages_) bytes += page.page_bytes;
  return bytes;
}

std::uint64_t CellReader::memory_bytes() const {
  return kinds_.size() * sizeof(CellKind) + pages_.size() * sizeof(CellPageRef) +
         rank_pages_.size() * sizeof(RankPageRef);
}

Status CellReader::check_entry(const CellChunkEntry& entry) const {
  const std::size_t corners = std::max<std::size_t>(corners_of(entry.shape), 1);
  if (entry.cells == 0 || entry.cells > max_chunk_cells || entry.packed_bytes > entry.unpacked_bytes ||
      !is_box(entry.low, entry.high) || !is_area(entry.area))
    return broken("a chunk of cells is out of range");
  if (!is_known(entry.shape, entry.field)) return {};
  if (entry.unpacked_bytes > 16 + entry.cells * corners * sizeof(std::uint64_t) || entry.points < corners ||
      entry.points > entry.cells * corners)
    return broken("a chunk of cells has the wrong length");
  return {};
}

Result<CellPage> CellReader::read_page(std::size_t page, const SummaryAttributes& attributes) const {
  const CellPageRef& ref = pages_[page];
  const std::string what = fmt::format("{}: page {} of the cells", volume_.name(), page);
  const std::size_t parts = 1 + volume_.info().attributes.size(), table = parts * sizeof(IndexPagePart);
  SPLATVOL_TRY_ASSIGN(bytes, read_bytes(ref.offset, ref.page_bytes));
  if (hash_bytes(std::span(bytes).first(table)) != ref.hash)
    return fail(ErrorCode::invalid_data, "{}: checksum mismatch", what);
  std::vector<std::pair<std::uint64_t, IndexPagePart>> at;  // offset, part
  std::uint64_t end = table;
  for (std::size_t p = 0; p < parts; ++p) {
    const auto part = read_record<IndexPagePart>(bytes, p * sizeof(IndexPagePart));
    const std::uint64_t length = ref.chunks * (p == 0 ? sizeof(CellChunkEntry) : summary_bytes);
    if (part.unpacked_bytes != length || part.packed_bytes > length || part.packed_bytes > ref.page_bytes - end)
      return broken("a part of a page of cells has the wrong length");
    at.emplace_back(end, part);
    end += part.packed_bytes;
  }
  if (end != ref.page_bytes) return broken("a page of cells has bytes left over");
  const auto packed = [&](std::size_t p) {
    return std::span<const std::byte>(bytes).subspan(at[p].first, at[p].second.packed_bytes);
  };

  CellPage read;
  SPLATVOL_TRY_ASSIGN(entries, unpack_checked(at[0].second, packed(0), what));
  std::span<const std::byte> records = entries;
  read.chunks = take_records<CellChunkEntry>(records, ref.chunks);
  std::uint64_t next = page > 0 ? pages_[page - 1].offset + pages_[page - 1].page_bytes : rank_bytes();
  for (const CellChunkEntry& entry : read.chunks) {
    SPLATVOL_TRY(check_entry(entry));
    if (entry.offset != next || entry.packed_bytes > ref.offset - next || !is_within(entry, ref))
      return broken("chunks of cells do not tile their section, or pass the box of their page");
    next += entry.packed_bytes;
  }
  if (next != ref.offset) return broken("chunks of cells do not tile their section");
  const auto summaries = [&](int attribute) {
    const std::size_t p = 1 + static_cast<std::size_t>(attribute);
    return unpack_summaries(at[p].second, packed(p), ref.chunks, what);
  };
  if (attributes.values >= 0) {
    SPLATVOL_TRY_ASSIGN(values, summaries(attributes.values));
    read.summaries = std::move(values);
  }
  if (attributes.opacity >= 0) {
    SPLATVOL_TRY_ASSIGN(opacity, summaries(attributes.opacity));
    read.opacity_summaries = std::move(opacity);
  }
  return read;
}

Result<std::vector<std::uint64_t>> CellReader::read_chunk(const CellChunkEntry& entry) const {
  SPLATVOL_TRY_ASSIGN(packed, read_bytes(entry.offset, entry.packed_bytes));
  const std::string what = fmt::format("{}: cells at {}", volume_.name(), section_.offset + entry.offset);
  return unpack_cells(entry, packed, volume_.info().resolution_counts.back(), what);
}

Status CellReader::check_bytes(const CellChunkEntry& entry) const {
  SPLATVOL_TRY_ASSIGN(packed, read_bytes(entry.offset, entry.packed_bytes));
  return check_packed(entry, packed, fmt::format("{}: cells at {}", volume_.name(), section_.offset + entry.offset));
}

Result<RankPage> CellReader::read_rank_page(std::size_t page) const {
  const RankPageRef& ref = rank_pages_[page];
  SPLATVOL_TRY_ASSIGN(packed, read_bytes(ref.offset, ref.packed_bytes));
  const std::uint64_t first = page * std::uint64_t{rank_page_points};
  const std::uint64_t ranks =
      std::min<std::uint64_t>(rank_page_points, volume_.info().resolution_counts.back() - first);
  const std::string what = fmt::format("{}: page {} of ranks", volume_.name(), page);
  return unpack_rank_page(ref, packed, first, ranks, counts_, what);
}

}  // namespace splatvol::format
