#include "format/container.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "base/sizes.h"

namespace splatvol::format {
namespace {

constexpr std::uint64_t max_sections = 64;
constexpr std::array required_sections = {SectionKind::metadata,       SectionKind::index_root,
                                          SectionKind::directory_root, SectionKind::rows,
                                          SectionKind::index_pages,    SectionKind::directory_pages};

bool is_raw_and_optional(SectionKind kind) {
  return kind == SectionKind::boundary || kind == SectionKind::cells || kind == SectionKind::cell_summaries;
}

bool is_known(SectionKind kind) {
  return kind == SectionKind::histograms || kind == SectionKind::summary_table || is_raw_and_optional(kind) ||
         std::ranges::find(required_sections, kind) != required_sections.end();
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
         section.kind != SectionKind::summary_table && !is_raw_and_optional(section.kind) &&
         section.unpacked_bytes > section.packed_bytes &&
         (section.kind != SectionKind::metadata || section.unpacked_bytes <= max_metadata_bytes(section.packed_bytes));
}

}  // namespace

void seal(Superblock& superblock) {
  superblock.hash = hash_bytes(std::as_bytes(std::span(&superblock, 1)).first(offsetof(Superblock, hash)));
}

Bytes pack_front(Superblock superblock, bool is_step, std::span<const SectionEntry> sections) {
  std::ranges::copy(is_step ? step_magic : magic, superblock.magic);
  superblock.major_version = major_version;
  const auto has = [&](SectionKind kind) {
    return std::ranges::find(sections, kind, &SectionEntry::kind) != sections.end();
  };
  const bool has_cells = has(SectionKind::cells) || has(SectionKind::cell_summaries);
  const std::uint16_t of_sections = has_cells                    ? cells_minor_version
                                    : has(SectionKind::boundary) ? boundary_minor_version
                                                                 : minor_version;
  superblock.minor_version = std::max(superblock.minor_version, of_sections);
  superblock.section_count = static_cast<std::uint32_t>(sections.size());
  superblock.section_table_hash = hash_bytes(std::as_bytes(sections));
  seal(superblock);
  Bytes front;
  append_record(front, superblock);
  for (const SectionEntry& section : sections) append_record(front, section);
  return front;
}

Result<std::shared_ptr<const Container>> Container::open(std::shared_ptr<CountedSource> source, Kind kind,
                                                         std::uint64_t begin, std::uint64_t bytes, std::string name) {
  std::shared_ptr<Container> container(new Container(std::move(source), kind, begin, std::move(name)));
  SPLATVOL_TRY(container->read_preamble(bytes));
  return container;
}

tl::unexpected<Error> Container::broken(std::string_view rule) const {
  return fail(ErrorCode::invalid_data, "{}: {}", name_, rule);
}

Status Container::read_preamble(std::uint64_t bytes) {
  if (bytes < sizeof(Superblock)) return broken("not a .svol file: too short");
  preamble_.resize(
      static_cast<std::size_t>(std::min(bytes, std::clamp(bytes / 64, min_first_read_bytes, max_first_read_bytes))));
  SPLATVOL_TRY(source_->read(begin_, preamble_));
  SPLATVOL_TRY(read_superblock(bytes));
  if (preamble_.size() > superblock_.file_bytes) preamble_.resize(static_cast<std::size_t>(superblock_.file_bytes));
  SPLATVOL_TRY(read_section_table());
  if (preamble_bytes() > preamble_.size()) {
    const std::size_t had = preamble_.size();
    preamble_.resize(static_cast<std::size_t>(preamble_bytes()));
    SPLATVOL_TRY(source_->read(begin_ + had, std::span(preamble_).subspan(had)));
  }
  SPLATVOL_TRY(check_sections());
  return check_section_kinds();
}

Status Container::read_superblock(std::uint64_t bytes) {
  superblock_ = read_record<Superblock>(preamble_, 0);
  const bool is_step = kind_ == Kind::step;
  if (!std::ranges::equal(superblock_.magic, is_step ? step_magic : magic))
    return broken(is_step ? "not a step [R18]" : "not a .svol file; svbuild makes one of a mesh or of points");
  if (superblock_.major_version != major_version)
    return fail(ErrorCode::unsupported, "{}: written in format {}.{}; this program reads 1.x", name_,
                superblock_.major_version, superblock_.minor_version);
  if (hash_bytes(std::span(preamble_).first(offsetof(Superblock, hash))) != superblock_.hash)
    return broken("superblock: checksum mismatch [R4]");
  if ((superblock_.critical_features & ~(is_step ? 0 : series_feature)) != 0)
    return fail(ErrorCode::unsupported, "{}: needs a feature that this program lacks", name_);
  if (((superblock_.critical_features & series_feature) != 0) != (superblock_.step_directory != 0))
    return broken("its superblock does not say whether it has steps [R18]");
  return check_size(bytes);
}

// Bytes behind the end of a series are those of an append that was interrupted.
Status Container::check_size(std::uint64_t bytes) const {
  const bool may_be_longer = superblock_.step_directory != 0 && kind_ == Kind::file;
  if (may_be_longer ? superblock_.file_bytes > bytes : superblock_.file_bytes != bytes)
    return fail(ErrorCode::invalid_data, "{}: truncated or grown: {} bytes instead of {} [R2]", name_, bytes,
                superblock_.file_bytes);
  return {};
}

Status Container::read_section_table() {
  if (superblock_.section_count == 0 || superblock_.section_count > max_sections)
    return broken("section count out of range [R3]");
  const std::uint64_t table_bytes = superblock_.section_count * sizeof(SectionEntry);
  if (preamble_bytes() < sizeof(Superblock) + table_bytes ||
      preamble_bytes() > std::min(superblock_.file_bytes, max_preamble_bytes) ||
      sizeof(Superblock) + table_bytes > preamble_.size())
    return broken("preamble length out of range [R1]");
  const auto table = std::span(preamble_).subspan(sizeof(Superblock), static_cast<std::size_t>(table_bytes));
  if (hash_bytes(table) != superblock_.section_table_hash) return broken("section table: checksum mismatch [R4]");
  for (std::size_t i = 0; i < superblock_.section_count; ++i)
    sections_.push_back(read_record<SectionEntry>(table, i * sizeof(SectionEntry)));
  return {};
}

// The sections of a step tile it. Those of a file end at the footer, or in a series where the steps begin.
Status Container::check_sections() {
  const bool is_step = kind_ == Kind::step;
  if (!is_step && bytes() < sizeof(Footer)) return broken("no footer [R6]");
  const std::uint64_t limit = bytes() - (is_step ? 0 : sizeof(Footer));
  std::uint64_t end = sizeof(Superblock) + sections_.size() * sizeof(SectionEntry);
  for (const SectionEntry& section : sections_) {
    if (!is_known(section.kind) && (section.flags & 1) != 0)
      return fail(ErrorCode::unsupported, "{}: needs section kind {}, which this program lacks [R5]", name_,
                  static_cast<std::uint32_t>(section.kind));
    if (section.offset != end || end > limit || section.packed_bytes > limit - end)
      return broken("sections do not tile the file [R6]");
    if (!has_valid_codec(section)) return broken("a section has the wrong codec or length [R7]");
    end += section.packed_bytes;
  }
  if (end != limit && superblock_.step_directory == 0) return broken("sections do not tile the file [R6]");
  sections_end_ = end;
  return {};
}

Status Container::check_section_kinds() const {
  for (const SectionKind kind : required_sections)
    if (std::ranges::count(sections_, kind, &SectionEntry::kind) != 1)
      return broken("a section is absent or appears twice [R8]");
  if (std::ranges::count(sections_, SectionKind::histograms, &SectionEntry::kind) > 1)
    return broken("histograms appear twice [R8]");
  if (std::ranges::count(sections_, SectionKind::summary_table, &SectionEntry::kind) != (kind_ == Kind::step ? 1 : 0))
    return broken("a section is absent or appears twice [R8]");
  if (std::ranges::count(sections_, SectionKind::boundary, &SectionEntry::kind) > (kind_ == Kind::step ? 0 : 1))
    return broken("a boundary appears twice, or in a step [R8]");
  if (std::ranges::count(sections_, SectionKind::cells, &SectionEntry::kind) > (kind_ == Kind::step ? 0 : 1))
    return broken("cells appear twice, or in a step [R8]");
  if (std::ranges::count(sections_, SectionKind::cell_summaries, &SectionEntry::kind) > (kind_ == Kind::step ? 1 : 0))
    return broken("summaries of cells appear twice, or in no step [R8]");
  for (const SectionKind kind : {SectionKind::metadata, SectionKind::index_root, SectionKind::directory_root}) {
    const SectionEntry& section = *find_section(kind);
    if (section.offset + section.packed_bytes > preamble_bytes()) return broken("a section passes the preamble [R1]");
  }
  const SectionEntry& root = *find_section(SectionKind::index_root);
  if (root.unpacked_bytes > root.packed_bytes) return broken("root index page out of range [R15]");
  return {};
}

const SectionEntry* Container::find_section(SectionKind kind) const {
  const auto found = std::ranges::find(sections_, kind, &SectionEntry::kind);
  return found == sections_.end() ? nullptr : &*found;
}

Result<Bytes> Container::read_bytes(std::uint64_t offset, std::uint64_t count) const {
  if (holds(offset, count))
    return Bytes(preamble_.begin() + static_cast<std::ptrdiff_t>(offset),
                 preamble_.begin() + static_cast<std::ptrdiff_t>(offset + count));
  if (offset > bytes() || count > bytes() - offset)
    return fail(ErrorCode::invalid_data, "{}: {} bytes at {} are past the end [R6]", name_, count, offset);
  SPLATVOL_TRY_ASSIGN(size, as_size(count, name_));
  Bytes read(size);
  SPLATVOL_TRY(source_->read(begin_ + offset, read));
  return read;
}

Result<std::uint64_t> Container::read_in_parts(std::uint64_t offset, std::uint64_t count, std::uint64_t record_bytes,
                                               const std::function<Status(std::span<const std::byte>)>& use) const {
  const std::uint64_t most = (std::uint64_t{1} << 20) / record_bytes * record_bytes;
  StreamHash hash;
  for (std::uint64_t at = 0; at < count; at += most) {
    SPLATVOL_TRY_ASSIGN(part, read_bytes(offset + at, std::min(most, count - at)));
    SPLATVOL_TRY(use(part));
    hash.add(part);
  }
  return hash.value();
}

Result<Bytes> Container::read_section(const SectionEntry& section) const {
  SPLATVOL_TRY_ASSIGN(packed, read_bytes(section.offset, section.packed_bytes));
  const std::string what = fmt::format("{}: section {}", name_, static_cast<std::uint32_t>(section.kind));
  return unpack_checked(section, packed, what);
}

std::uint64_t Container::table_hash() const {
  return hash_bytes(std::span(preamble_).first(sizeof(Superblock) + sections_.size() * sizeof(SectionEntry)));
}

}  // namespace splatvol::format
