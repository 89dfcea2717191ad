#include "format/volume.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>

namespace splatvol::format {
namespace {

// An index page up to this size is read at once. Of a larger page, only the structure and the part of one attribute are
// read. A server takes about as long for another read as for these bytes.
constexpr std::uint64_t one_read_bytes = 4u << 10;
constexpr std::uint64_t one_read_bytes_from_server = 16u << 10;

constexpr const char* untiled = "the summary pages do not tile their section [R20]";

bool has_valid_range(const ChunkEntry& entry, ColumnKind kind) {
  if (kind != ColumnKind::value && kind != ColumnKind::value_moments) return true;
  return summary_of(entry).is_valid();
}

}  // namespace

Result<std::shared_ptr<const Volume>> Volume::open(std::unique_ptr<ByteSource> source) {
  std::shared_ptr<Volume> volume(new Volume());
  volume->source_ = std::make_shared<CountedSource>(std::move(source));
  const std::uint64_t size = volume->source_->source().size();
  SPLATVOL_TRY_SET(volume->file_, Container::open(volume->source_, Container::Kind::file, 0, size, volume->name()));
  SPLATVOL_TRY(volume->read_metadata());
  SPLATVOL_TRY(volume->read_directory_root(
      {volume->file_.get(), RowLayout(volume->file_info_), 0, volume->file_info_.rows_per_directory_page, {}}));
  if (!volume->file_info_.series) return volume;
  SPLATVOL_TRY(volume->read_series());
  SPLATVOL_TRY(volume->open_step(volume->series_->steps.size() - 1));
  return volume;
}

Result<std::shared_ptr<const Volume>> Volume::at_step(std::size_t step) const {
  if (!series_ || step >= series_->steps.size())
    return fail(ErrorCode::invalid_argument, "{}: no step {}", name(), step);
  std::shared_ptr<Volume> volume(new Volume());
  volume->source_ = source_;
  volume->file_ = file_;
  volume->file_info_ = file_info_;
  volume->directories_ = {directories_[0]};
  volume->series_ = series_;
  SPLATVOL_TRY(volume->open_step(step));
  return volume;
}

Status Volume::open_step(std::size_t step) {
  step_ = step;
  const StepEntry& entry = series_->steps[step];
  const std::string what = fmt::format("{}: step {}", name(), step);
  SPLATVOL_TRY_SET(step_part_, Container::open(source_, Container::Kind::step, entry.offset, entry.bytes, what));
  if (step_part_->table_hash() != entry.hash) return step_part_->broken("checksum mismatch [R18]");
  SPLATVOL_TRY(read_step_metadata());
  return read_summary_table();
}

Status Volume::read_step_metadata() {
  SPLATVOL_TRY_ASSIGN(raw, step_part_->read_section(*step_part_->find_section(SectionKind::metadata)));
  const auto info = step_from_json(std::string(reinterpret_cast<const char*>(raw.data()), raw.size()), file_info_);
  if (!info) return fail_in(name(), info.error());
  if (info->time != time()) return step_part_->broken("its time is not that of the step directory [R18]");
  info_ = format::at_step(file_info_, *info);
  rows_ = RowLayout(info_);
  return read_directory_root({step_part_.get(),
                              RowLayout(file_info_, *info),
                              static_cast<int>(file_info_.columns.size()),
                              info->rows_per_directory_page,
                              {}});
}

// The pages tile their section, and the last entry is that of the root page.
Status Volume::read_summary_table() {
  const SectionEntry& section = *step_part_->find_section(SectionKind::summary_table);
  if (section.packed_bytes == 0 || section.packed_bytes % sizeof(SummaryPageRef) != 0)
    return step_part_->broken("the summary table has the wrong length [R20]");
  const std::uint64_t count = section.packed_bytes / sizeof(SummaryPageRef);
  std::uint64_t end = 0;
  // Each entry is checked before the next part is read: only entries of pages that are there take memory.
  SPLATVOL_TRY_ASSIGN(hash, step_part_->read_in_parts(
                                section.offset, section.packed_bytes, sizeof(SummaryPageRef),
                                [&](std::span<const std::byte> part) { return add_summary_pages(part, count, end); }));
  if (hash != section.hash) return step_part_->broken("summary table: checksum mismatch [R20]");
  if (end != step_part_->find_section(SectionKind::index_pages)->packed_bytes) return step_part_->broken(untiled);
  return {};
}

// `count`: entries of the whole table; `end`: of the pages so far.
Status Volume::add_summary_pages(std::span<const std::byte> entries, std::uint64_t count, std::uint64_t& end) {
  const std::uint64_t pages_bytes = step_part_->find_section(SectionKind::index_pages)->packed_bytes;
  const std::uint64_t root_bytes = step_part_->find_section(SectionKind::index_root)->packed_bytes;
  const std::uint64_t attributes = info_.attributes.size(), table_bytes = attributes * sizeof(IndexPagePart);
  for (std::size_t at = 0; at < entries.size(); at += sizeof(SummaryPageRef)) {
    const auto ref = read_record<SummaryPageRef>(entries, at);
    const bool last = summaries_.size() + 1 == count;
    if (ref.node_count < 1 || ref.node_count > max_page_nodes || ref.page_bytes < table_bytes ||
        ref.page_bytes - table_bytes > attributes * ref.node_count * summary_bytes)
      return step_part_->broken("a summary page has the wrong length [R20]");
    if (last ? ref.offset != 0 || ref.page_bytes != root_bytes
             : ref.offset != end || ref.page_bytes > pages_bytes - end)
      return step_part_->broken(untiled);
    if (!last) end += ref.page_bytes;
    summaries_.push_back(ref);
  }
  return {};
}

Status Volume::read_metadata() {
  SPLATVOL_TRY_ASSIGN(raw, file_->read_section(*file_->find_section(SectionKind::metadata)));
  auto info = metadata_from_json(std::string(reinterpret_cast<const char*>(raw.data()), raw.size()));
  if (!info) return fail_in(name(), info.error());
  if (info->series.has_value() != (file_->superblock().step_directory != 0))
    return broken("its superblock does not say whether it has steps [R18]");
  if (info->boundary.has_value() != (file_->find_section(SectionKind::boundary) != nullptr))
    return broken("its metadata do not say whether it has a boundary [R21]");
  if (info->cells.has_value() != (file_->find_section(SectionKind::cells) != nullptr))
    return broken("its metadata do not say whether it has cells [R23]");
  info_ = file_info_ = std::move(*info);
  rows_ = RowLayout(info_);
  return {};
}

Status Volume::read_series() {
  const std::uint64_t begin = file_->superblock().step_directory;
  const std::uint64_t limit = file_->bytes() - sizeof(Footer), attributes = file_info_.series->size();
  const std::uint64_t ranges = attributes * sizeof(StepRange);
  if (begin < file_->sections_end() || begin > limit || limit - begin < sizeof(StepDirectoryHead) + ranges)
    return broken("the step directory is out of range [R18]");
  SPLATVOL_TRY_ASSIGN(front, file_->read_bytes(begin, sizeof(StepDirectoryHead)));
  const auto head = read_record<StepDirectoryHead>(front, 0);
  if (head.entries > max_step_entries || head.attributes != attributes ||
      limit - begin != sizeof(head) + head.entries * sizeof(StepEntry) + ranges)
    return broken("the step directory has the wrong length [R18]");
  SPLATVOL_TRY_ASSIGN(bytes, file_->read_bytes(begin, limit - begin));
  if (hash_bytes(std::span(bytes).subspan(sizeof(head.hash))) != head.hash)
    return broken("step directory: checksum mismatch [R18]");

  auto series = std::make_shared<Series>();
  for (std::size_t at = sizeof(head); at < bytes.size() - ranges; at += sizeof(StepEntry))
    series->entries.push_back(read_record<StepEntry>(bytes, at));
  for (std::size_t at = bytes.size() - static_cast<std::size_t>(ranges); at < bytes.size(); at += sizeof(StepRange))
    series->ranges.push_back(read_record<StepRange>(bytes, at));
  std::ranges::copy_if(series->entries, std::back_inserter(series->steps),
                       [](const StepEntry& entry) { return entry.kind == StepEntryKind::step; });
  SPLATVOL_TRY(check_entries(*series));
  series->bytes_behind = source_->source().size() - file_->bytes();
  series_ = std::move(series);
  return {};
}

Status Volume::check_entries(const Series& series) const {
  std::uint64_t end = file_->sections_end();
  for (const StepEntry& entry : series.entries) {
    if (entry.kind != StepEntryKind::step && entry.kind != StepEntryKind::dead)
      return broken("the step directory has an entry of an unknown kind [R18]");
    if (entry.offset != end || entry.bytes > file_->superblock().step_directory - end)
      return broken("the steps do not tile the file [R18]");
    end += entry.bytes;
  }
  if (end != file_->superblock().step_directory) return broken("the steps do not tile the file [R18]");
  if (series.steps.empty()) return broken("a series without steps [R18]");
  for (std::size_t i = 0; i < series.steps.size(); ++i)
    if (!(std::abs(series.steps[i].time) <= largest_time) ||
        (i > 0 && !(series.steps[i].time > series.steps[i - 1].time)))
      return broken("the times of the steps do not rise, or are out of range [R19]");
  for (const StepRange& range : series.ranges)
    if (!(std::isnan(range.min) && std::isnan(range.max)) && !is_range(range.min, range.max))
      return broken("the step directory has a range that is none [R18]");
  return {};
}

std::uint64_t Volume::memory_bytes() const {
  std::uint64_t bytes = file_->memory_bytes() + summaries_.size() * sizeof(SummaryPageRef);
  for (const Directory& directory : directories_) bytes += directory.refs.size() * sizeof(DirectoryPageRef);
  if (series_) bytes += step_part_->memory_bytes() + 2 * series_->entries.size() * sizeof(StepEntry);
  return bytes;
}

std::vector<SectionEntry> Volume::step_sections() const {
  return step_part_ ? step_part_->sections() : std::vector<SectionEntry>();
}

bool Volume::is_of_step(int column) const { return series_ && column >= static_cast<int>(file_info_.columns.size()); }

Result<Bytes> Volume::read_bytes(std::uint64_t offset, std::uint64_t count) const {
  if (step_part_ && offset >= step_part_->begin() && offset - step_part_->begin() < step_part_->bytes())
    return step_part_->read_bytes(offset - step_part_->begin(), count);
  return file_->read_bytes(offset, count);
}

bool Volume::is_far() const { return cheap_gap() >= std::uint64_t{16} << 10; }

Result<std::shared_ptr<const BytesAhead>> Volume::read_ahead(std::vector<ByteRange> ranges, MemoryShare& share) const {
  if (!is_far()) return nullptr;
  erase_held(ranges);
  return ranges.empty() ? nullptr : BytesAhead::read(source_, std::move(ranges), share);
}

Result<std::shared_ptr<const BytesAhead>> Volume::read_together(std::vector<ByteRange> ranges) const {
  erase_held(ranges);
  return ranges.empty() ? nullptr : BytesAhead::read_together(source_, std::move(ranges), cheap_gap());
}

bool Volume::prefetch(std::vector<ByteRange> ranges) const {
  erase_held(ranges);
  return source_->prefetch(join_ranges(std::move(ranges), cheap_gap()));
}

// Leaves out what the preambles hold, and what was read ahead.
void Volume::erase_held(std::vector<ByteRange>& ranges) const {
  std::erase_if(ranges, [&](const ByteRange& range) {
    const std::uint64_t count = range.end - range.begin;
    return source_->holds(range) || file_->holds(range.begin, count) ||
           (step_part_ && range.begin >= step_part_->begin() &&
            step_part_->holds(range.begin - step_part_->begin(), count));
  });
}

Status Volume::read_directory_root(Directory directory) {
  const Container& container = *directory.container;
  const SectionEntry& section = *container.find_section(SectionKind::directory_root);
  const SectionEntry& tail = *container.find_section(SectionKind::directory_pages);
  SPLATVOL_TRY_ASSIGN(root, container.read_section(section));
  const std::uint64_t pages = directory.rows.directory_page_count();
  const std::uint64_t fixed = sizeof(std::uint64_t) + pages * sizeof(DirectoryPageRef);
  if (root.size() < sizeof(std::uint64_t) || read_record<std::uint64_t>(root, 0) != pages ||
      pages > root.size() / sizeof(DirectoryPageRef) || root.size() < fixed)
    return container.broken("directory: wrong number of pages [R11]");

  std::uint64_t next = section.offset + fixed;
  for (std::uint64_t page = 0; page < pages; ++page) {
    const auto ref = read_record<DirectoryPageRef>(
        root, static_cast<std::size_t>(sizeof(std::uint64_t) + page * sizeof(DirectoryPageRef)));
    const std::uint64_t section_end =
        page == 0 ? section.offset + section.packed_bytes : tail.offset + tail.packed_bytes;
    if (ref.offset != next || ref.bytes > section_end - next || ref.bytes < sizeof(std::uint64_t) ||
        (ref.bytes - sizeof(std::uint64_t)) / sizeof(ChunkEntry) != directory.rows.chunks_of_directory_page(page) ||
        ref.bytes % sizeof(ChunkEntry) != sizeof(std::uint64_t))
      return container.broken("directory: pages do not tile their section [R11]");
    next += ref.bytes;
    if (page == 0 && next != section_end) return container.broken("directory: pages do not tile their section [R11]");
    if (page == 0) next = tail.offset;
    directory.refs.push_back(ref);
  }
  if (next != tail.offset + tail.packed_bytes)
    return container.broken("directory: pages do not tile their section [R11]");
  directories_.push_back(std::move(directory));
  return {};
}

// Index pages of a series have no summaries.
NodeShape Volume::node_shape() const {
  return {info_.resolutions(), info_.size_bounds.size(), file_info_.attributes.size()};
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
                                    std::uint64_t links_end, const SummaryAttributes& attributes) const {
  const std::string what = name() + ": index page";
  const bool in_page = attributes.values >= 0 && !series_;
  const bool whole = in_page && reads_at_once(ref.page_bytes);
  SPLATVOL_TRY_ASSIGN(bytes, file_->read_bytes(offset, whole ? ref.page_bytes : ref.front_bytes));
  const auto front = std::span<const std::byte>(bytes).first(ref.front_bytes);
  SPLATVOL_TRY_ASSIGN(page, unpack_index_page(ref, front, node_shape(), top_nodes, links_end, what));
  if (series_) SPLATVOL_TRY(add_step_summaries(attributes, page));
  if (!in_page) return page;

  const auto read = [&](int attribute) -> Result<std::vector<ValueSummary>> {
    const auto [part_offset, part] = find_summary_part(front, static_cast<std::size_t>(attribute), node_shape());
    if (whole)
      return unpack_summaries(
          part, std::span<const std::byte>(bytes).subspan(static_cast<std::size_t>(part_offset), part.packed_bytes),
          page.nodes.size(), what);
    SPLATVOL_TRY_ASSIGN(packed, file_->read_bytes(offset + part_offset, part.packed_bytes));
    return unpack_summaries(part, packed, page.nodes.size(), what);
  };
  SPLATVOL_TRY_SET(page.nodes.summaries, read(attributes.values));
  if (attributes.opacity < 0) return page;
  SPLATVOL_TRY_SET(page.nodes.opacity_summaries, read(attributes.opacity));
  return page;
}

std::uint64_t Volume::index_page_offset(const IndexPageRef& ref) const {
  return file_->find_section(SectionKind::index_pages)->offset + ref.offset;
}

ByteRange Volume::range_of_index_page(const IndexPageRef& ref) const {
  const std::uint64_t begin = index_page_offset(ref);
  return {begin, begin + (!series_ && reads_at_once(ref.page_bytes) ? ref.page_bytes : ref.front_bytes)};
}

// The table of parts is not checked yet: whoever uses these bytes checks it.
std::vector<ByteRange> Volume::ranges_behind(const IndexPageRef& ref, const SummaryAttributes& attributes) const {
  std::vector<ByteRange> ranges;
  if (series_ || reads_at_once(ref.page_bytes)) return ranges;
  const std::uint64_t begin = index_page_offset(ref);
  const auto front = file_->read_bytes(begin, ref.front_bytes);
  if (!front || front->size() < index_table_bytes(node_shape().attributes)) return ranges;
  for (const int attribute : {attributes.values, attributes.opacity}) {
    if (attribute < 0) continue;
    const auto [offset, part] = find_summary_part(*front, static_cast<std::size_t>(attribute), node_shape());
    if (offset + part.packed_bytes <= ref.page_bytes)
      ranges.push_back({begin + offset, begin + offset + part.packed_bytes});
  }
  return ranges;
}

// Of the step.
std::uint64_t Volume::summary_page_offset(std::uint32_t number) const {
  const bool root = number + 1 == summaries_.size();
  const SectionEntry& section = *step_part_->find_section(root ? SectionKind::index_root : SectionKind::index_pages);
  return section.offset + summaries_[number].offset;
}

ByteRange Volume::range_of_summaries(const IndexPage& page) const {
  if (page.number >= summaries_.size()) return {};
  const SummaryPageRef& ref = summaries_[page.number];
  const std::uint64_t begin = step_part_->begin() + summary_page_offset(page.number);
  return {begin, begin + (reads_at_once(ref.page_bytes) ? ref.page_bytes : 0)};
}

// Whether a page is read as a whole, and not its front and then the summaries that are needed.
bool Volume::reads_at_once(std::uint64_t page_bytes) const {
  return page_bytes <= (is_far() ? one_read_bytes_from_server : one_read_bytes);
}

Status Volume::add_step_summaries(const SummaryAttributes& attributes, IndexPage& page) const {
  if (attributes.values < 0) return {};
  SPLATVOL_TRY_SET(page.nodes.summaries, read_step_summaries(page, static_cast<std::size_t>(attributes.values)));
  if (attributes.opacity < 0) return {};
  SPLATVOL_TRY_SET(page.nodes.opacity_summaries,
                   read_step_summaries(page, static_cast<std::size_t>(attributes.opacity)));
  return {};
}

// Reads the part of an attribute from the step's summaries of an index page.
Result<std::vector<ValueSummary>> Volume::read_step_summaries(const IndexPage& page, std::size_t attribute) const {
  const std::uint32_t number = page.number;
  const std::string what = fmt::format("{}: summaries of index page {}", name(), number);
  if (number >= summaries_.size() || summaries_[number].node_count != page.nodes.size())
    return fail(ErrorCode::invalid_data, "{}: not there [R20]", what);
  const SummaryPageRef& ref = summaries_[number];
  const std::uint64_t offset = summary_page_offset(number);
  const std::uint64_t table_bytes = info_.attributes.size() * sizeof(IndexPagePart);
  const bool whole = reads_at_once(ref.page_bytes);
  SPLATVOL_TRY_ASSIGN(bytes, step_part_->read_bytes(offset, whole ? ref.page_bytes : table_bytes));
  if (hash_bytes(std::span(bytes).first(static_cast<std::size_t>(table_bytes))) != ref.hash)
    return fail(ErrorCode::invalid_data, "{}: checksum mismatch", what);

  std::uint64_t part_offset = table_bytes, end = table_bytes;
  for (std::size_t a = 0; a < info_.attributes.size(); ++a) {
    const auto part = read_record<IndexPagePart>(bytes, a * sizeof(IndexPagePart));
    if (part.packed_bytes > ref.page_bytes - end || part.unpacked_bytes != ref.node_count * summary_bytes ||
        part.packed_bytes > part.unpacked_bytes)
      return fail(ErrorCode::invalid_data, "{}: a part has the wrong length [R20]", what);
    end += part.packed_bytes;
    if (a < attribute) part_offset = end;
  }
  if (end != ref.page_bytes) return fail(ErrorCode::invalid_data, "{}: bytes left over [R20]", what);

  const auto part = read_record<IndexPagePart>(bytes, attribute * sizeof(IndexPagePart));
  if (whole)
    return unpack_summaries(
        part, std::span<const std::byte>(bytes).subspan(static_cast<std::size_t>(part_offset), part.packed_bytes),
        page.nodes.size(), what);
  SPLATVOL_TRY_ASSIGN(packed, step_part_->read_bytes(offset + part_offset, part.packed_bytes));
  return unpack_summaries(part, packed, page.nodes.size(), what);
}

IndexPageRef Volume::root_ref() const {
  const SectionEntry& section = *file_->find_section(SectionKind::index_root);
  return {0, static_cast<std::uint32_t>(section.unpacked_bytes), static_cast<std::uint32_t>(section.packed_bytes),
          section.hash};
}

Result<IndexPage> Volume::read_index_root(const SummaryAttributes& attributes) const {
  const std::uint64_t links_end = file_->find_section(SectionKind::index_pages)->packed_bytes;
  SPLATVOL_TRY_ASSIGN(
      page, read_page(root_ref(), file_->find_section(SectionKind::index_root)->offset, 1, links_end, attributes));
  SPLATVOL_TRY(check_top_counts(page, info_.segment_counts()));
  return page;
}

Result<IndexPage> Volume::read_index_page(const IndexPageRef& ref, std::uint8_t child_mask,
                                          std::span<const std::uint64_t> parent_counts,
                                          const SummaryAttributes& attributes) const {
  const std::uint64_t offset = index_page_offset(ref);
  const auto children = static_cast<std::uint32_t>(std::popcount(child_mask));
  SPLATVOL_TRY_ASSIGN(page, read_page(ref, offset, children, ref.offset, attributes));
  SPLATVOL_TRY(check_top_counts(page, parent_counts));
  return page;
}

Result<IndexPage> Volume::with_summaries(IndexPage page, const SummaryAttributes& attributes) const {
  SPLATVOL_TRY(add_step_summaries(attributes, page));
  return page;
}

Volume::Page Volume::page_at(std::uint64_t page) const {
  const std::size_t of_file = directories_[0].refs.size();
  return page < of_file ? Page{directories_[0], 0, page} : Page{directories_[1], 1, page - of_file};
}

std::uint64_t Volume::directory_page_of_row(std::uint64_t row, int column) const {
  const std::uint64_t before = is_of_step(column) ? directories_[0].refs.size() : 0;
  return before + directory_of(column).rows.directory_page_of_row(row);
}

std::uint64_t Volume::directory_page_count() const {
  std::uint64_t count = 0;
  for (const Directory& directory : directories_) count += directory.refs.size();
  return count;
}

std::uint64_t Volume::most_chunks_of_directory_pages() const {
  std::uint64_t chunks = 0;
  for (const Directory& directory : directories_) {
    const std::uint64_t columns = directory.rows.columns_of_row(0).size();  // all: the row is its group's first
    chunks += std::min<std::uint64_t>(rows_.row_count(), directory.rows_per_page) * columns;
  }
  return chunks;
}

std::uint64_t Volume::chunks_of_directory_page(std::uint64_t page) const {
  const Page found = page_at(page);
  return found.directory.rows.chunks_of_directory_page(found.number);
}

std::uint64_t Volume::end_row(const DirectoryPage& page) const {
  return std::min(rows_.row_count(), page.first_row + directories_[page.directory].rows_per_page);
}

std::vector<int> Volume::columns_of_row(const DirectoryPage& page, std::uint64_t row) const {
  const Directory& directory = directories_[page.directory];
  std::vector<int> columns = directory.rows.columns_of_row(row);
  for (int& column : columns) column += directory.first_column;
  return columns;
}

ByteRange Volume::range_of_directory_page(std::uint64_t page) const {
  const auto [directory, directory_number, number] = page_at(page);
  const DirectoryPageRef& ref = directory.refs[static_cast<std::size_t>(number)];
  const std::uint64_t begin = directory.container->begin() + ref.offset;
  return {begin, begin + ref.bytes};
}

Result<DirectoryPage> Volume::read_directory_page(std::uint64_t page) const {
  const auto [directory, directory_number, number] = page_at(page);
  const Container& container = *directory.container;
  const RowLayout& rows = directory.rows;
  const DirectoryPageRef& ref = directory.refs[static_cast<std::size_t>(number)];
  SPLATVOL_TRY_ASSIGN(bytes, container.read_bytes(ref.offset, ref.bytes));
  if (hash_bytes(bytes) != ref.hash)
    return container.broken(fmt::format("directory page {}: checksum mismatch", number));

  DirectoryPage result;
  result.directory = directory_number;
  result.first_row = rows.first_row_of_directory_page(number);
  result.first_chunk = rows.chunks_before(result.first_row);
  result.chunks.reserve((bytes.size() - sizeof(std::uint64_t)) / sizeof(ChunkEntry));
  const SectionEntry& section = *container.find_section(SectionKind::rows);
  const std::uint64_t end = section.offset + section.packed_bytes;
  std::uint64_t offset = read_record<std::uint64_t>(bytes, 0);
  if (offset < section.offset || offset > end)
    return container.broken(fmt::format("directory page {} points outside [R12]", number));
  std::size_t at = sizeof(std::uint64_t);
  for (std::uint64_t row = result.first_row; at < bytes.size(); ++row) {
    const std::uint64_t points = rows.group(rows.group_of_row(row)).count;
    for (const int column : rows.columns_of_row(row)) {
      const auto entry = read_record<ChunkEntry>(bytes, at);
      at += sizeof(ChunkEntry);
      if (entry.packed_bytes == 0 || entry.packed_bytes > end - offset)
        return container.broken("a chunk passes the rows [R12]");
      if (entry.unpacked_bytes > 64 + 64 * points || entry.packed_bytes > entry.unpacked_bytes)
        return container.broken("a chunk is too large [R10]");
      if (!has_valid_range(entry, info_.columns[static_cast<std::size_t>(directory.first_column + column)].kind))
        return container.broken("a chunk states a range of values that is out of range [R10]");
      result.chunks.push_back({container.begin() + offset, entry});
      offset += entry.packed_bytes;
    }
  }
  return result;
}

const ChunkLocation& Volume::find_chunk(const DirectoryPage& page, std::uint64_t row, int column) const {
  const Directory& directory = directories_[page.directory];
  const auto& columns = directory.rows.columns_of_row(row);
  const auto index = std::ranges::find(columns, column - directory.first_column) - columns.begin();
  return page.chunks[static_cast<std::size_t>(directory.rows.chunks_before(row) - page.first_chunk) +
                     static_cast<std::size_t>(index)];
}

Result<Histograms> Volume::read_histograms() const {
  const SectionEntry* section = values().find_section(SectionKind::histograms);
  if (section == nullptr) return Histograms{};
  Histograms histograms(info_.attributes.size());
  const auto out = std::as_writable_bytes(std::span(histograms));
  if (section->unpacked_bytes != out.size()) return broken("histograms have the wrong size");
  SPLATVOL_TRY_ASSIGN(raw, values().read_section(*section));
  std::ranges::copy(raw, out.begin());
  return histograms;
}

Result<std::uint64_t> Volume::geometry_hash() const {
  PartsHash hash;
  for (std::uint64_t page = 0; page < directories_[0].refs.size(); ++page) {
    SPLATVOL_TRY_ASSIGN(directory, read_directory_page(page));
    for (const ChunkLocation& chunk : directory.chunks) hash.add(chunk.entry.hash);
  }
  PartsHash index;
  for (const SectionKind kind : {SectionKind::index_pages, SectionKind::index_root}) {
    const SectionEntry& section = *file_->find_section(kind);
    for (std::uint64_t at = 0; at < section.packed_bytes; at += geometry_part_bytes) {
      const std::uint64_t count = std::min(geometry_part_bytes, section.packed_bytes - at);
      SPLATVOL_TRY_ASSIGN(bytes, file_->read_bytes(section.offset + at, count));
      index.add(bytes);
    }
  }
  hash.add(index.value());
  return hash.value();
}

}  // namespace splatvol::format
