#include "tests/support/surgery.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "format/volume_info.h"

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

// Unpacks a part; one that is damaged stays packed.
Bytes unpack_or_copy(View packed, std::uint64_t unpacked_bytes) {
  auto bytes = unpack(packed, unpacked_bytes, "test");
  return bytes ? std::move(*bytes) : copy_of(packed);
}

}  // namespace

// Fills a body, part by part. Functions return false if they do not find a part.
class Dissected::Reader {
 public:
  Reader(View bytes, Body& body) : bytes_(bytes), body_(body) {}

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
    return find(SectionKind::metadata) && find(SectionKind::rows) && read_pages() && read_directory();
  }

 private:
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
};

std::optional<Dissected> Dissected::take_apart(View file) {
  Dissected parts;
  if (file.size() < sizeof(Superblock) + sizeof(Footer) || !Reader(file, parts.file_).read(false)) return {};
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
      else if (!Reader(*range, part.step).read(true))
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
  Assembler(const Surgeon& surgeon, Packing packing) : surgeon_(surgeon), packing_(packing) {}

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

  Bytes packed(const Bytes& raw) const { return packing_ == Packing::zstd ? pack(raw) : raw; }

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
      sections[kind] = packed(bytes);
      unpacked_bytes[kind] = bytes.size();
    }
    if (!body.patches.empty()) unpacked_bytes[SectionKind::boundary] = pack_patches(body, sections);
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

  const Surgeon& surgeon_;
  const Packing packing_;
  std::array<std::size_t, all_part_count> next_{};
};

Bytes Dissected::assemble(const Surgeon& surgeon, Packing packing) const {
  return Assembler(surgeon, packing).assemble(*this);
}

}  // namespace splatvol::test
