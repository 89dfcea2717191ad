#include "tests/support/surgery.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <sstream>
#include <string>
#include <utility>

#include "format/volume_info.h"
#include "tests/support/require.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {

using namespace format;

namespace {

using View = std::span<const std::byte>;

// Finds the offsets of the links in a structure part: spec 6, node by node. Ends where the structure does.
std::vector<std::size_t> find_links(const Bytes& structure, std::uint32_t nodes, std::size_t resolutions,
                                    std::size_t size_bounds) {
  std::vector<std::size_t> links;
  std::size_t at = 0;
  for (std::uint32_t node = 0; node < nodes && at + 3 <= structure.size(); ++node) {
    const bool linked = structure[at + 1] == std::byte{1};
    const auto first = std::min(static_cast<std::size_t>(structure[at + 2]), resolutions);
    at += 3;
    for (std::size_t s = 0; s < resolutions; ++s, ++at)
      while (at < structure.size() && (structure[at] & std::byte{0x80}) != std::byte{0}) ++at;
    at += size_bounds * (resolutions - first);
    if (!linked) continue;
    if (at + sizeof(IndexPageRef) > structure.size()) break;
    links.push_back(at);
    at += sizeof(IndexPageRef);
  }
  return links;
}

template <class T>
void overwrite(Bytes& bytes, std::size_t offset, const T& record) {
  if (offset <= bytes.size() && sizeof(T) <= bytes.size() - offset)
    std::memcpy(bytes.data() + offset, &record, sizeof(T));
}

void append(Bytes& bytes, View more) { bytes.insert(bytes.end(), more.begin(), more.end()); }

Bytes copy_of(View bytes) { return {bytes.begin(), bytes.end()}; }

// Returns a part of `bytes`; nothing if it is not within them.
std::optional<View> range_of(View bytes, std::uint64_t offset, std::uint64_t count) {
  if (offset > bytes.size() || count > bytes.size() - offset) return {};
  return bytes.subspan(offset, count);
}

template <class T>
std::optional<T> record_at(View bytes, std::uint64_t offset) {
  const auto range = range_of(bytes, offset, sizeof(T));
  return range ? std::optional(read_record<T>(*range, 0)) : std::nullopt;
}

}  // namespace

void harm_number(Bytes& json, const std::function<std::size_t(std::size_t below)>& draw) {
  std::istringstream texts(
      "0 1 -1 2 3 63 64 65 128 0.5 1.5 -0.0 1e-60 1e60 1e102 -1e102 1e300 -1e308 1e-320 65535 65536 16777216 "
      "4294967295 4294967296 281474976710655 281474976710656 18446744073709551615 null [] {} \"a\" true");
  const std::vector<std::string> numbers{std::istream_iterator<std::string>(texts), {}};
  std::string text = text_of(json);
  const std::size_t begin = text.find_first_of("0123456789", draw(text.size() + 1));
  if (begin == std::string::npos) return;
  const std::size_t end = std::min(text.find_first_not_of("0123456789.e-+", begin), text.size());
  json = bytes_of(text.replace(begin, end - begin, numbers[draw(numbers.size())]));
}

// Fills a body, part by part. Functions return false if they do not find a part.
class Dissected::Reader {
 public:
  Reader(View bytes, Body& body, std::map<std::uint64_t, Bytes>& packed)
      : bytes_(bytes), body_(body), packed_(packed) {}

  bool read(bool is_step) {
    body_.is_step = is_step;
    const auto superblock = record_at<Superblock>(bytes_, 0);
    if (!superblock || superblock->section_count > 64) return false;
    body_.superblock = *superblock;
    for (std::size_t i = 0; i < superblock->section_count; ++i) {
      const auto section = record_at<SectionEntry>(bytes_, sizeof(Superblock) + i * sizeof(SectionEntry));
      if (!section || find(section->kind) || !range_of(bytes_, section->offset, section->packed_bytes)) return false;
      body_.sections.push_back(*section);
    }
    for (const SectionEntry& section : body_.sections)
      if (section.codec == Codec::raw || section.codec == Codec::zstd)
        body_.plain[section.kind] = section.codec == Codec::raw
                                        ? copy_of(bytes_of(section))
                                        : unpack_or_copy(bytes_of(section), section.unpacked_bytes);
    read_patches();
    read_cells();
    return find(SectionKind::metadata) && find(SectionKind::rows) && read_pages() && read_directory();
  }

 private:
  // Unpacks a part; one that is damaged stays packed.
  Bytes unpack_or_copy(View packed, std::uint64_t unpacked_bytes) {
    auto bytes = unpack(packed, unpacked_bytes, "test");
    if (!bytes) return copy_of(packed);
    packed_.emplace(hash_bytes(*bytes), copy_of(packed));
    return std::move(*bytes);
  }

  [[nodiscard]] const SectionEntry* find(SectionKind kind) const {
    const auto found = std::ranges::find(body_.sections, kind, &SectionEntry::kind);
    return found == body_.sections.end() ? nullptr : &*found;
  }

  [[nodiscard]] View bytes_of(const SectionEntry& section) const {
    return bytes_.subspan(section.offset, section.packed_bytes);
  }

  // A boundary whose patches are not found stays one section.
  void read_patches() {
    const SectionEntry* const section = find(SectionKind::boundary);
    const Bytes& metadata = body_.plain[SectionKind::metadata];
    const auto info = metadata_from_json({reinterpret_cast<const char*>(metadata.data()), metadata.size()});
    if (!section || body_.is_step || !info || !info->boundary) return;
    const View bytes = bytes_of(*section);
    const std::size_t count = info->boundary->patches.size();
    std::uint64_t at = sizeof(std::uint64_t) + count * sizeof(PatchPart);
    std::vector<Bytes> patches;
    for (std::size_t i = 0; i < count; ++i) {
      const auto part = record_at<PatchPart>(bytes, sizeof(std::uint64_t) + i * sizeof(PatchPart));
      const auto packed = part ? range_of(bytes, at, part->packed_bytes) : std::nullopt;
      if (!packed) return;
      patches.push_back(unpack_or_copy(*packed, part->unpacked_bytes));
      at += packed->size();
    }
    body_.patches = std::move(patches);
    body_.plain.erase(SectionKind::boundary);
  }

  // Cells whose parts are not found stay one section.
  void read_cells() {
    const SectionEntry* const section = find(SectionKind::cells);
    if (!section || body_.is_step) return;
    Cells cells;
    if (!read_cells(bytes_of(*section), cells)) return;
    body_.cells = std::move(cells);
    body_.plain.erase(SectionKind::cells);
  }

  bool read_cells(View bytes, Cells& cells) {
    const std::uint64_t end = bytes.size();
    const auto tail = end < sizeof(CellsTail) ? std::nullopt : record_at<CellsTail>(bytes, end - sizeof(CellsTail));
    if (!tail || tail->kinds > end / sizeof(CellKind) || tail->pages > end / sizeof(CellPageRef)) return false;
    cells.tail = *tail;
    // The root follows the last page. Pages of ranks are as many as it has room for.
    const std::uint64_t stated = tail->kinds * sizeof(CellKind) + tail->pages * sizeof(CellPageRef);
    for (std::uint64_t ranks = 0; stated + ranks * sizeof(PackedPageRef) + sizeof(CellsTail) <= end; ++ranks) {
      const std::uint64_t root_bytes = stated + ranks * sizeof(PackedPageRef);
      const View root = bytes.subspan(end - sizeof(CellsTail) - root_bytes, root_bytes);
      if (hash_bytes(root) == tail->hash) return read_cells(bytes, root, ranks, cells);
      if (ranks > 1000) break;
    }
    return false;
  }

  bool read_cells(View bytes, View root, std::uint64_t ranks, Cells& cells) {
    cells.kinds = copy_of(root.first(cells.tail.kinds * sizeof(CellKind)));
    root = root.subspan(cells.kinds.size());
    const View rank_refs = root.subspan(cells.tail.pages * sizeof(CellPageRef));
    std::uint64_t next = 0;  // offset of the next chunk
    for (std::uint64_t page = 0; page < ranks; ++page) {
      const auto ref = read_record<PackedPageRef>(rank_refs, page * sizeof(PackedPageRef));
      const auto packed = range_of(bytes, ref.offset, ref.packed_bytes);
      if (!packed) return false;
      cells.rank_pages.push_back(unpack_or_copy(*packed, ref.unpacked_bytes));
      next = std::max(next, ref.offset + ref.packed_bytes);
    }
    for (std::uint64_t page = 0; page < cells.tail.pages; ++page) {
      cells.pages.emplace_back().ref = read_record<CellPageRef>(root, page * sizeof(CellPageRef));
      if (!read_cell_page(bytes, next, cells.pages.back(), cells)) return false;
    }
    return true;
  }

  // Parts are as many as the bytes in front of the first have room for: it has the entries.
  bool read_cell_page(View bytes, std::uint64_t& next, Cells::Page& page, Cells& cells) {
    const auto whole = range_of(bytes, page.ref.offset, page.ref.page_bytes);
    if (!whole || page.ref.chunks > 4096) return false;
    std::size_t parts = 0;
    for (std::uint64_t after = whole->size(); parts * sizeof(IndexPagePart) < after; ++parts) {
      const auto part = record_at<IndexPagePart>(*whole, parts * sizeof(IndexPagePart));
      if (!part || part->packed_bytes > after) return false;
      after -= part->packed_bytes;
    }
    std::uint64_t at = parts * sizeof(IndexPagePart);
    for (std::size_t p = 0; p < parts; ++p) {
      const auto part = read_record<IndexPagePart>(*whole, p * sizeof(IndexPagePart));
      const auto packed = range_of(*whole, at, part.packed_bytes);
      if (!packed) return false;
      page.parts.push_back(unpack_or_copy(*packed, part.unpacked_bytes));
      at += packed->size();
    }
    for (std::size_t c = 0; c < page.ref.chunks; ++c) {
      const auto entry =
          page.parts.empty() ? std::nullopt : record_at<CellChunkEntry>(page.parts[0], c * sizeof(CellChunkEntry));
      const auto packed = entry ? range_of(bytes, next, entry->packed_bytes) : std::nullopt;
      if (!packed || entry->unpacked_bytes > (std::uint32_t{1} << 24)) return false;
      page.chunks.push_back(cells.chunks.size());
      cells.chunks.push_back(unpack_or_copy(*packed, entry->unpacked_bytes));
      next += packed->size();
    }
    return true;
  }

  // Reads the pages in file order: each tells its length.
  bool read_pages() {
    const SectionEntry* const pages = find(SectionKind::index_pages);
    const SectionEntry* const root = find(SectionKind::index_root);
    if (!pages || !root) return false;
    const std::size_t head = body_.is_step ? 0 : sizeof(std::uint64_t);
    std::uint64_t table_bytes = root->unpacked_bytes;
    if (!body_.is_step) {
      const auto structure = record_at<IndexPagePart>(bytes_of(*root), head);
      if (!structure || structure->packed_bytes > root->unpacked_bytes) return false;
      table_bytes = root->unpacked_bytes - structure->packed_bytes - head;
    }
    if (table_bytes > root->packed_bytes) return false;
    const std::size_t parts = table_bytes / sizeof(IndexPagePart);
    if (parts == 0 && !body_.is_step) return false;

    std::map<std::uint64_t, std::size_t> page_at;  // offset in the section: number
    for (View rest = bytes_of(*pages); !rest.empty() && parts > 0;) {
      page_at[pages->packed_bytes - rest.size()] = body_.pages.size();
      if (!read_page(rest, parts)) return false;
    }
    View rest = bytes_of(*root);
    if (!read_page(rest, parts)) return false;
    return body_.is_step ? read_summary_table() : find_all_links(page_at);
  }

  bool read_page(View& rest, std::size_t parts) {
    Page page;
    const std::size_t head = body_.is_step ? 0 : sizeof(std::uint64_t);
    if (!body_.is_step) {
      if (rest.size() < head) return false;
      page.node_count = read_record<std::uint32_t>(rest, 0);
      page.number = read_record<std::uint32_t>(rest, 4);
    }
    std::uint64_t at = head + sizeof(IndexPagePart) * parts;
    for (std::size_t p = 0; p < parts; ++p) {
      const auto part = record_at<IndexPagePart>(rest, head + p * sizeof(IndexPagePart));
      const auto bytes = part ? range_of(rest, at, part->packed_bytes) : std::nullopt;
      if (!bytes) return false;
      page.parts.push_back(unpack_or_copy(*bytes, part->unpacked_bytes));
      at += bytes->size();
    }
    rest = rest.subspan(std::min<std::size_t>(at, rest.size()));
    body_.pages.push_back(std::move(page));
    return true;
  }

  bool find_all_links(const std::map<std::uint64_t, std::size_t>& page_at) {
    const Bytes& metadata = body_.plain[SectionKind::metadata];
    const auto info = metadata_from_json({reinterpret_cast<const char*>(metadata.data()), metadata.size()});
    if (!info) return true;  // the links stay as they are
    for (Page& page : body_.pages)
      for (const std::size_t link :
           find_links(page.parts[0], page.node_count, info->resolutions(), info->size_bounds.size())) {
        const auto found = page_at.find(read_record<IndexPageRef>(page.parts[0], link).offset);
        if (found == page_at.end() || found->second >= static_cast<std::size_t>(&page - body_.pages.data())) continue;
        page.links.push_back(link);
        page.linked_pages.push_back(found->second);
      }
    return true;
  }

  bool read_summary_table() {
    const Bytes& table = body_.plain[SectionKind::summary_table];
    for (std::size_t p = 0; p < body_.pages.size(); ++p)
      if (const auto ref = record_at<SummaryPageRef>(table, p * sizeof(SummaryPageRef)))
        body_.pages[p].node_count = ref->node_count;
    return true;
  }

  bool read_directory() {
    const SectionEntry* const root = find(SectionKind::directory_root);
    if (!root || !find(SectionKind::directory_pages)) return false;
    const auto pages = record_at<std::uint64_t>(bytes_of(*root), 0);
    if (!pages || *pages == 0 || *pages > bytes_.size()) return false;
    for (std::uint64_t page = 0; page < *pages; ++page) {
      const auto ref = record_at<DirectoryPageRef>(bytes_of(*root), 8 + page * sizeof(DirectoryPageRef));
      const auto bytes = ref ? range_of(bytes_, ref->offset, ref->bytes) : std::nullopt;
      if (!bytes || bytes->size() < 8) return false;
      body_.directory_pages.push_back((bytes->size() - 8) / sizeof(ChunkEntry));
      auto offset = read_record<std::uint64_t>(*bytes, 0);
      for (std::size_t c = 0; c < body_.directory_pages.back(); ++c) {
        const auto entry = read_record<ChunkEntry>(*bytes, 8 + c * sizeof(ChunkEntry));
        const auto chunk = range_of(bytes_, offset, entry.packed_bytes);
        if (!chunk) return false;
        body_.chunks.push_back({entry, unpack_or_copy(*chunk, entry.unpacked_bytes)});
        offset += entry.packed_bytes;
      }
      // Pages that overlap would become longer and longer.
      if (body_.chunks.size() > bytes_.size() / sizeof(ChunkEntry)) return false;
    }
    return true;
  }

  View bytes_;
  Body& body_;
  std::map<std::uint64_t, Bytes>& packed_;
};

std::optional<Dissected> Dissected::take_apart(View file) {
  Dissected parts;
  if (file.size() < sizeof(Superblock) + sizeof(Footer) || !Reader(file, parts.file_, parts.packed_).read(false))
    return {};
  parts.footer_ = read_record<Footer>(file, file.size() - sizeof(Footer));
  if (const std::uint64_t directory = parts.file_.superblock.step_directory; directory != 0) {
    const auto head = record_at<StepDirectoryHead>(file, directory);
    if (!head || head->entries > file.size() / sizeof(StepEntry)) return {};
    std::uint64_t at = directory + sizeof(StepDirectoryHead);
    std::uint64_t bytes = 0;  // of all entries: parts that overlap would become longer and longer
    for (std::uint64_t i = 0; i < head->entries; ++i, at += sizeof(StepEntry)) {
      const auto entry = record_at<StepEntry>(file, at);
      const auto range = entry ? range_of(file, entry->offset, entry->bytes) : std::nullopt;
      if (!range || (bytes += range->size()) > file.size()) return {};
      SeriesPart& part = parts.series_.emplace_back();
      part.entry = *entry;
      if (entry->kind != StepEntryKind::step)
        part.dead = copy_of(*range);
      else if (!Reader(*range, part.step, parts.packed_).read(true))
        return {};
    }
    if (at > file.size() - sizeof(Footer)) return {};
    parts.step_attributes_ = head->attributes;
    parts.step_ranges_ = copy_of(file.subspan(at, file.size() - sizeof(Footer) - at));
  }
  static_cast<void>(parts.assemble(
      [&](Part part, std::size_t, Bytes&) { ++parts.counts_[static_cast<std::size_t>(part)]; }, Packing::raw));
  return parts;
}

Dissected::Dissected(const Bytes& file) {
  auto parts = take_apart(file);
  if (!parts) std::abort();
  *this = std::move(*parts);
}

// Puts a file together.
class Dissected::Assembler {
 public:
  Assembler(const Dissected& parts, const Surgeon& surgeon, Packing packing)
      : packed_(parts.packed_), surgeon_(surgeon), packing_(packing) {}

  Bytes assemble(const Dissected& parts) {
    Bytes table;
    Bytes body = pack_body(parts.file_, table);
    Superblock superblock = parts.file_.superblock;
    superblock.preamble_bytes = std::min<std::uint64_t>(max_preamble_bytes, front_bytes(table) + body.size());
    if (superblock.step_directory != 0) superblock.step_directory = append_series(parts, front_bytes(table), body);
    superblock.file_bytes = front_bytes(table) + body.size() + sizeof(Footer);

    Bytes file = pack_front(superblock, table);
    Footer footer = parts.footer_;
    footer.file_bytes = superblock.file_bytes;
    footer.table_hash = hash_bytes(file);
    seal(footer, Part::footer);
    append(file, body);
    append_record(file, footer);
    return file;
  }

 private:
  using Packed = std::map<SectionKind, Bytes>;

  static std::uint64_t front_bytes(const Bytes& table) { return sizeof(Superblock) + table.size(); }

  void operate(Part part, Bytes& bytes) { surgeon_(part, next_[static_cast<std::size_t>(part)]++, bytes); }

  Bytes packed(const Bytes& raw) const {
    if (packing_ == Packing::raw) return raw;
    const auto before = packing_ == Packing::as_before ? packed_.find(hash_bytes(raw)) : packed_.end();
    return before == packed_.end() ? pack(raw) : before->second;
  }

  // Gives all of a record but its hash, which it then sets, to the surgeon.
  template <class Record>
  void seal(Record& record, Part part) {
    constexpr std::size_t bytes = offsetof(Record, hash);
    const auto raw = std::as_writable_bytes(std::span(&record, 1)).first(bytes);
    Bytes copy(raw.begin(), raw.end());
    operate(part, copy);
    std::copy_n(copy.begin(), std::min(bytes, copy.size()), raw.begin());
    record.hash = hash_bytes(raw);
  }

  Bytes pack_front(Superblock superblock, const Bytes& table) {
    superblock.section_count = static_cast<std::uint32_t>(table.size() / sizeof(SectionEntry));
    superblock.section_table_hash = hash_bytes(table);
    seal(superblock, Part::superblock);
    Bytes front;
    append_record(front, superblock);
    append(front, table);
    return front;
  }

  // Appends steps and the step directory to a body; returns the offset of the directory.
  std::uint64_t append_series(const Dissected& parts, std::uint64_t begin, Bytes& body) {
    Bytes directory;
    append_record(directory, static_cast<std::uint64_t>(parts.series_.size()));
    append_record(directory, parts.step_attributes_);
    for (const SeriesPart& part : parts.series_) {
      StepEntry entry = part.entry;
      entry.offset = begin + body.size();
      if (entry.kind == StepEntryKind::step) {
        append_step(part.step, entry, body);
      } else {
        Bytes dead = part.dead;
        operate(Part::dead_part, dead);
        entry.hash = hash_bytes(dead);
        append(body, dead);
      }
      entry.bytes = begin + body.size() - entry.offset;
      append_record(directory, entry);
    }
    append(directory, parts.step_ranges_);
    operate(Part::step_directory, directory);
    const std::uint64_t offset = begin + body.size();
    append_record(body, hash_bytes(directory));
    append(body, directory);
    return offset;
  }

  void append_step(const Body& step, StepEntry& entry, Bytes& body) {
    Bytes table;
    const Bytes sections = pack_body(step, table);
    Superblock superblock = step.superblock;
    superblock.file_bytes = front_bytes(table) + sections.size();
    superblock.preamble_bytes = std::min(max_preamble_bytes, superblock.file_bytes);
    const Bytes front = pack_front(superblock, table);
    entry.hash = hash_bytes(front);
    append(body, front);
    append(body, sections);
  }

  // Returns the sections; `table` becomes their table.
  Bytes pack_body(const Body& body, Bytes& table) {
    Packed sections;
    std::map<SectionKind, std::uint64_t> unpacked_bytes;
    for (const auto& [kind, plain] : body.plain) {
      if (kind == SectionKind::directory_root || kind == SectionKind::summary_table) continue;
      Bytes bytes = plain;
      operate(kind == SectionKind::metadata     ? Part::metadata
              : kind == SectionKind::histograms ? Part::histograms
                                                : Part::other_section,
              bytes);
      // These are raw, whatever a file packs otherwise [R7].
      const bool is_raw = kind == SectionKind::cells || kind == SectionKind::cell_summaries;
      sections[kind] = is_raw ? bytes : packed(bytes);
      unpacked_bytes[kind] = bytes.size();
    }
    if (!body.patches.empty()) unpacked_bytes[SectionKind::boundary] = pack_patches(body, sections);
    if (body.cells) unpacked_bytes[SectionKind::cells] = pack_cells(*body.cells, sections);
    const IndexPageRef root = pack_pages(body, sections);
    const std::vector<ChunkEntry> entries = pack_chunks(body, sections);
    pack_directory(body, entries, sections);
    return pack_sections(body, sections, unpacked_bytes, root, table);
  }

  // Returns the bytes of the section, which is not packed as a whole.
  std::uint64_t pack_patches(const Body& body, Packed& sections) {
    Bytes table, parts;
    for (const Bytes& patch : body.patches) {
      Bytes payload = patch;
      operate(Part::patch, payload);
      const Bytes bytes = packed(payload);
      append_record(table, PatchPart{hash_bytes(bytes), static_cast<std::uint32_t>(bytes.size()),
                                     static_cast<std::uint32_t>(payload.size())});
      append(parts, bytes);
    }
    operate(Part::patch_table, table);
    Bytes& section = sections[SectionKind::boundary];
    append_record(section, hash_bytes(table));
    append(section, table);
    append(section, parts);
    return section.size();
  }

  // Returns the bytes of the section, which is not packed as a whole.
  std::uint64_t pack_cells(const Cells& cells, Packed& sections) {
    Bytes& section = sections[SectionKind::cells];
    Bytes root = cells.kinds, rank_refs;
    for (const Bytes& page : cells.rank_pages) {
      Bytes payload = page;
      operate(Part::rank_page, payload);
      const Bytes bytes = packed(payload);
      append_record(rank_refs, PackedPageRef{section.size(), static_cast<std::uint32_t>(bytes.size()),
                                             static_cast<std::uint32_t>(payload.size()), hash_bytes(bytes)});
      append(section, bytes);
    }
    Bytes pages;  // which follow the chunks
    for (const Cells::Page& page : cells.pages) append_record(root, pack_cell_page(cells, page, section, pages));
    for (std::size_t at = cells.kinds.size(); at < root.size(); at += sizeof(CellPageRef)) {
      auto ref = read_record<CellPageRef>(root, at);
      ref.offset += section.size();
      overwrite(root, at, ref);
    }
    append(section, pages);
    for (std::size_t at = 0; at < cells.kinds.size(); at += sizeof(CellKind)) {
      auto kind = read_record<CellKind>(root, at);
      kind.packed_bytes = cell_bytes_[{kind.shape, kind.field}];
      overwrite(root, at, kind);
    }
    append(root, rank_refs);
    append_record(root, cells.tail);
    // The hash is not the surgeon's.
    const auto tail = [&] { return root.end() - sizeof(CellsTail); };
    root.erase(tail(), tail() + sizeof(std::uint64_t));
    operate(Part::cell_root, root);
    constexpr std::size_t behind = sizeof(CellsTail) - sizeof(std::uint64_t);
    const std::size_t records = root.size() - std::min(root.size(), behind);
    const std::uint64_t hash = hash_bytes(std::span(root).first(records));
    const auto raw = std::as_bytes(std::span(&hash, 1));
    root.insert(root.begin() + static_cast<std::ptrdiff_t>(records), raw.begin(), raw.end());
    append(section, root);
    return section.size();
  }

  CellPageRef pack_cell_page(const Cells& cells, const Cells::Page& page, Bytes& section, Bytes& pages) {
    std::vector<Bytes> parts = page.parts;
    CellPageRef ref = page.ref;
    ref.chunks_offset = section.size();
    for (std::size_t c = 0; c < page.chunks.size(); ++c) {
      Bytes payload = cells.chunks[page.chunks[c]];
      operate(Part::cells, payload);
      const Bytes bytes = packed(payload);
      auto entry = read_record<CellChunkEntry>(parts[0], c * sizeof(CellChunkEntry));
      entry.offset = section.size();
      entry.hash = hash_bytes(bytes);
      entry.packed_bytes = static_cast<std::uint32_t>(bytes.size());
      entry.unpacked_bytes = static_cast<std::uint32_t>(payload.size());
      overwrite(parts[0], c * sizeof(CellChunkEntry), entry);
      cell_bytes_[{entry.shape, entry.field}] += bytes.size();
      append(section, bytes);
    }
    Bytes table, content;
    for (std::size_t p = 0; p < parts.size(); ++p) {
      operate(p == 0 ? Part::cell_entries : Part::cell_summary, parts[p]);
      const Bytes part = packed(parts[p]);
      append_record(table, IndexPagePart{static_cast<std::uint32_t>(part.size()),
                                         static_cast<std::uint32_t>(parts[p].size()), hash_bytes(part)});
      append(content, part);
    }
    operate(Part::cell_table, table);
    ref.offset = pages.size();
    ref.page_bytes = static_cast<std::uint32_t>(table.size() + content.size());
    ref.hash = hash_bytes(table);
    append(pages, table);
    append(pages, content);
    return ref;
  }

  // Returns a reference to the root page.
  IndexPageRef pack_pages(const Body& body, Packed& sections) {
    std::vector<IndexPageRef> refs;
    Bytes pages, summaries, root;
    for (const Page& page : body.pages) {
      std::vector<Bytes> parts = page.parts;
      for (std::size_t link = 0; link < page.links.size(); ++link)
        overwrite(parts[0], page.links[link], refs[page.linked_pages[link]]);
      for (std::size_t p = 0; p < parts.size(); ++p)
        operate(p == 0 && !body.is_step ? Part::structure : Part::summary, parts[p]);

      Bytes table, content;
      if (!body.is_step) {
        append_record(table, page.node_count);
        append_record(table, page.number);
      }
      std::uint64_t structure_bytes = 0;
      for (const Bytes& raw : parts) {
        const Bytes part = packed(raw);
        append_record(table, IndexPagePart{static_cast<std::uint32_t>(part.size()),
                                           static_cast<std::uint32_t>(raw.size()), hash_bytes(part)});
        if (content.empty() && !body.is_step) structure_bytes = part.size();
        append(content, part);
      }
      operate(Part::index_table, table);
      refs.push_back({pages.size(), static_cast<std::uint32_t>(table.size() + structure_bytes),
                      static_cast<std::uint32_t>(table.size() + content.size()), hash_bytes(table)});
      const bool is_root = &page == &body.pages.back();
      append_record(summaries, SummaryPageRef{is_root ? 0 : pages.size(), refs.back().page_bytes, page.node_count,
                                              refs.back().hash});
      append(is_root ? root : pages, table);
      append(is_root ? root : pages, content);
    }
    if (body.is_step) {
      operate(Part::summary_table, summaries);
      sections[SectionKind::summary_table] = summaries;
    }
    sections[SectionKind::index_pages] = pages;
    sections[SectionKind::index_root] = root;
    return refs.back();
  }

  std::vector<ChunkEntry> pack_chunks(const Body& body, Packed& sections) {
    std::vector<ChunkEntry> entries;
    Bytes& rows = sections[SectionKind::rows];
    for (const Chunk& chunk : body.chunks) {
      Bytes payload = chunk.payload;
      operate(Part::chunk, payload);
      const Bytes bytes = packed(payload);
      ChunkEntry entry = chunk.entry;
      entry.hash = hash_bytes(bytes);
      entry.packed_bytes = static_cast<std::uint32_t>(bytes.size());
      entry.unpacked_bytes = static_cast<std::uint32_t>(payload.size());
      entries.push_back(entry);
      append(rows, bytes);
    }
    return entries;
  }

  void pack_directory(const Body& body, const std::vector<ChunkEntry>& entries, Packed& sections) {
    // All lengths are known, and so the offsets of sections, directory pages and chunks.
    const std::uint64_t references = 8 + body.directory_pages.size() * sizeof(DirectoryPageRef);
    sections[SectionKind::directory_root].resize(references + 8 + body.directory_pages[0] * sizeof(ChunkEntry));
    std::size_t tail = 0;
    for (std::size_t p = 1; p < body.directory_pages.size(); ++p)
      tail += 8 + body.directory_pages[p] * sizeof(ChunkEntry);
    sections[SectionKind::directory_pages].resize(tail);
    std::uint64_t end = sizeof(Superblock) + body.sections.size() * sizeof(SectionEntry);
    std::map<SectionKind, std::uint64_t> begins;
    for (const SectionEntry& section : body.sections) {
      begins[section.kind] = end;
      end += sections[section.kind].size();
    }

    Bytes root(8), head, pages_tail;
    overwrite(root, 0, static_cast<std::uint64_t>(body.directory_pages.size()));
    std::uint64_t chunk_offset = begins[SectionKind::rows];
    std::size_t chunk = 0;
    for (std::size_t p = 0; p < body.directory_pages.size(); ++p) {
      Bytes page;
      append_record(page, chunk_offset);
      for (std::size_t c = 0; c < body.directory_pages[p]; ++c, ++chunk) {
        append_record(page, entries[chunk]);
        chunk_offset += entries[chunk].packed_bytes;
      }
      operate(Part::directory_page, page);
      const std::uint64_t offset = p == 0 ? begins[SectionKind::directory_root] + references
                                          : begins[SectionKind::directory_pages] + pages_tail.size();
      append_record(root, DirectoryPageRef{offset, page.size(), hash_bytes(page)});
      append(p == 0 ? head : pages_tail, page);
    }
    append(root, head);
    operate(Part::directory_root, root);
    sections[SectionKind::directory_root] = root;
    sections[SectionKind::directory_pages] = pages_tail;
  }

  // Makes sections that tile the file, whatever lengths the surgeon has changed: their table, and their bytes.
  Bytes pack_sections(const Body& body, Packed& sections, const std::map<SectionKind, std::uint64_t>& unpacked_bytes,
                      const IndexPageRef& root, Bytes& table) {
    Bytes result;
    std::uint64_t offset = sizeof(Superblock) + body.sections.size() * sizeof(SectionEntry);
    for (SectionEntry section : body.sections) {
      const Bytes& bytes = sections[section.kind];
      section.offset = offset;
      offset += section.packed_bytes = bytes.size();
      if (section.codec != Codec::extent) {
        const auto unpacked = unpacked_bytes.find(section.kind);
        const bool is_packed = unpacked != unpacked_bytes.end() && unpacked->second != bytes.size();
        section.codec = is_packed ? Codec::zstd : Codec::raw;
        section.unpacked_bytes = is_packed ? unpacked->second : bytes.size();
        section.hash = hash_bytes(bytes);
      }
      if (section.kind == SectionKind::index_root) {
        section.unpacked_bytes = root.front_bytes;
        section.hash = root.hash;
      }
      append_record(table, section);
      append(result, bytes);
    }
    operate(Part::section_table, table);
    return result;
  }

  const std::map<std::uint64_t, Bytes>& packed_;
  const Surgeon& surgeon_;
  const Packing packing_;
  std::array<std::size_t, all_part_count> next_{};
  std::map<std::pair<CellShape, CellField>, std::uint64_t> cell_bytes_;  // of all chunks
};

Bytes Dissected::assemble(const Surgeon& surgeon, Packing packing) const {
  return Assembler(*this, surgeon, packing).assemble(*this);
}

Bytes Dissected::harmed(Part part, std::size_t index, const std::function<void(Bytes&)>& harm) const {
  require(index < count(part), "the file has no such part");
  return assemble([&](Part p, std::size_t i, Bytes& bytes) {
    if (p == part && i == index) harm(bytes);
  });
}

}  // namespace splatvol::test
