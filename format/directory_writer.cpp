#include "format/directory_writer.h"

#include <algorithm>
#include <cmath>

namespace splatvol::format {
namespace {

constexpr std::uint64_t page_target_bytes = 8u << 10;  // a quarter of the shortest first read

}  // namespace

// Chooses pages of about 8 KiB. Pages are larger if the references to them would crowd the preamble: it holds the
// references and page 0, and both together are smallest where they are equally long.
std::uint32_t choose_rows_per_page(std::size_t columns, std::uint64_t row_count) {
  const auto row_bytes = static_cast<double>(std::max<std::size_t>(1, columns) * sizeof(ChunkEntry));
  const double by_size = static_cast<double>(page_target_bytes) / row_bytes;
  const double balanced = std::sqrt(static_cast<double>(row_count * sizeof(DirectoryPageRef)) / row_bytes);
  return static_cast<std::uint32_t>(std::clamp(std::max(by_size, balanced), 1.0, 0x1p24));
}

// Takes in as many of the coarsest resolutions as a reader's first read holds. Takes in resolution 0 even if it is
// larger, up to 1 MiB.
std::uint64_t choose_preamble_bytes(std::uint64_t bytes, std::uint64_t rows_offset,
                                    std::span<const std::uint64_t> resolution_ends) {
  const std::uint64_t first_read = std::clamp(bytes / 64, min_first_read_bytes, max_first_read_bytes);
  std::uint64_t preamble = resolution_ends[0] <= max_preamble_bytes ? resolution_ends[0] : rows_offset;
  for (const std::uint64_t end : resolution_ends)
    if (end <= first_read) preamble = std::max(preamble, end);
  return preamble;
}

Status DirectoryWriter::add_row(std::span<const ChunkEntry> entries, std::uint64_t offset) {
  if (next_row_ >= rows_.row_count() || entries.size() != rows_.columns_of_row(next_row_).size())
    return fail(ErrorCode::invalid_argument, "row {} has {} chunks", next_row_, entries.size());
  if (page_.empty()) append_record(page_, offset);
  for (const ChunkEntry& entry : entries) {
    append_record(page_, entry);
    offset += entry.packed_bytes;
  }
  const std::size_t resolution = rows_.resolution_of_row(next_row_);
  ++next_row_;
  const bool last = next_row_ == rows_.row_count();
  if (last || next_row_ % rows_per_page_ == 0) SPLATVOL_TRY(close_page());
  if (last || rows_.resolution_of_row(next_row_) != resolution) resolution_ends_.push_back(offset);
  return {};
}

Status DirectoryWriter::close_page() {
  const bool head = refs_.empty();
  refs_.push_back({tail_.size(), page_.size(), hash_bytes(page_)});
  if (head)
    head_ = page_;
  else
    SPLATVOL_TRY(tail_.append(page_));
  page_.clear();
  return {};
}

Result<DirectoryWriter::Found> DirectoryWriter::find_chunk(std::uint64_t row, std::uint64_t column) const {
  const auto number = static_cast<std::size_t>(rows_.directory_page_of_row(row));
  Bytes read;
  std::span<const std::byte> page = number == 0 && !refs_.empty() ? std::span<const std::byte>(head_) : page_;
  if (number > 0 && number < refs_.size()) {
    read.resize(static_cast<std::size_t>(refs_[number].bytes));
    SPLATVOL_TRY(tail_.read(refs_[number].offset, read));
    if (hash_bytes(read) != refs_[number].hash) return fail_changed_temporary();
    page = read;
  }
  const auto chunk = static_cast<std::size_t>(rows_.chunks_before(row) -
                                              rows_.chunks_before(rows_.first_row_of_directory_page(number)) + column);
  Found found{read_record<std::uint64_t>(page, 0), {}};
  for (std::size_t i = 0; i <= chunk; ++i) {
    found.offset += found.entry.packed_bytes;
    found.entry = read_record<ChunkEntry>(page, sizeof(std::uint64_t) + i * sizeof(ChunkEntry));
  }
  return found;
}

Result<PackedChunk> DirectoryWriter::read_chunk(std::span<const Column> columns, ColumnKind kind, int attribute,
                                                std::uint64_t group, const ReadBytes& read) const {
  const std::uint64_t row = rows_.row(rows_.group(group).segment, group);
  const std::vector<int>& of_row = rows_.columns_of_row(row);
  const auto column = std::ranges::find_if(of_row, [&](int c) {
    const Column& present = columns[static_cast<std::size_t>(c)];
    return present.kind == kind && present.attribute == attribute;
  });
  if (column == of_row.end()) return fail(ErrorCode::invalid_argument, "a row lacks a column of positions or values");
  SPLATVOL_TRY_ASSIGN(found, find_chunk(row, static_cast<std::uint64_t>(column - of_row.begin())));
  PackedChunk chunk{found.entry, Bytes(found.entry.packed_bytes)};
  SPLATVOL_TRY(read(found.offset, chunk.bytes));
  return chunk;
}

// Bytes of the root in front of page 0.
std::uint64_t DirectoryWriter::refs_bytes() const {
  return sizeof(std::uint64_t) + rows_.directory_page_count() * sizeof(DirectoryPageRef);
}

std::uint64_t DirectoryWriter::root_bytes() const {
  return refs_bytes() + sizeof(std::uint64_t) + rows_.chunks_of_directory_page(0) * sizeof(ChunkEntry);
}

Bytes DirectoryWriter::pack_root(std::uint64_t root_offset, std::uint64_t tail_offset) {
  for (std::size_t page = 0; page < refs_.size(); ++page)
    refs_[page].offset = page == 0 ? root_offset + refs_bytes() : tail_offset + refs_[page].offset;
  Bytes root;
  append_record(root, std::uint64_t{refs_.size()});
  for (const DirectoryPageRef& ref : refs_) append_record(root, ref);
  root.insert(root.end(), head_.begin(), head_.end());
  return root;
}

}  // namespace splatvol::format
