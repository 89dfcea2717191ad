#include "tests/format/surgery.h"

#include <algorithm>
#include <map>
#include <memory>
#include <numeric>

#include "base/file.h"
#include "format/volume_info.h"

namespace splatvol::test {

using namespace format;

namespace {

std::span<const std::byte> section_of(const Bytes& file, const std::vector<SectionEntry>& sections, SectionKind kind) {
  const auto section = std::ranges::find(sections, kind, &SectionEntry::kind);
  return std::span(file).subspan(section->offset, section->packed_bytes);
}

Bytes raw_section(const Bytes& file, const std::vector<SectionEntry>& sections, SectionKind kind) {
  const auto section = std::ranges::find(sections, kind, &SectionEntry::kind);
  return unpack(section_of(file, sections, kind), section->unpacked_bytes, "test").value();
}

// Finds the offsets of the links in a structure part: spec 6, node by node.
std::vector<std::size_t> find_links(const Bytes& structure, std::uint32_t nodes, std::size_t resolutions,
                                    std::size_t size_bounds) {
  std::vector<std::size_t> links;
  std::size_t at = 0;
  for (std::uint32_t node = 0; node < nodes; ++node) {
    const bool linked = structure[at + 1] == std::byte{1};
    const auto first = static_cast<std::size_t>(structure[at + 2]);
    at += 3;
    for (std::size_t s = 0; s < resolutions; ++s, ++at)
      while ((structure[at] & std::byte{0x80}) != std::byte{0}) ++at;
    at += size_bounds * (resolutions - first);
    if (!linked) continue;
    links.push_back(at);
    at += sizeof(IndexPageRef);
  }
  return links;
}

template <class T>
void overwrite(Bytes& bytes, std::size_t offset, const T& record) {
  std::memcpy(bytes.data() + offset, &record, sizeof(T));
}

void append(Bytes& bytes, std::span<const std::byte> more) { bytes.insert(bytes.end(), more.begin(), more.end()); }

// Gives a record to the surgeon, and returns the changed record.
template <class T>
T operate_on_record(const T& record, std::size_t bytes, const Surgeon& surgeon, Part part) {
  const auto raw = std::as_bytes(std::span(&record, 1)).first(bytes);
  Bytes copy(raw.begin(), raw.end());
  surgeon(part, 0, copy);
  T changed = record;
  std::memcpy(&changed, copy.data(), std::min(bytes, copy.size()));
  return changed;
}

}  // namespace

Dissected::Dissected(const Bytes& file) {
  superblock_ = read_record<Superblock>(file, 0);
  for (std::size_t i = 0; i < superblock_.section_count; ++i)
    sections_.push_back(read_record<SectionEntry>(file, sizeof(Superblock) + i * sizeof(SectionEntry)));
  footer_ = read_record<Footer>(file, file.size() - sizeof(Footer));
  metadata_ = raw_section(file, sections_, SectionKind::metadata);
  histograms_ = raw_section(file, sections_, SectionKind::histograms);
  const VolumeInfo info =
      metadata_from_json(std::string(reinterpret_cast<const char*>(metadata_.data()), metadata_.size())).value();
  resolutions_ = info.resolutions();
  size_bounds_ = info.size_bounds.size();

  const auto root = std::ranges::find(sections_, SectionKind::index_root, &SectionEntry::kind);
  read_pages(section_of(file, sections_, SectionKind::index_pages),
             section_of(file, sections_, SectionKind::index_root), root->unpacked_bytes, info.attributes.size());

  const RowLayout rows(info);
  const Bytes directory = raw_section(file, sections_, SectionKind::directory_root);
  const auto page_count = read_record<std::uint64_t>(directory, 0);
  for (std::uint64_t page = 0; page < page_count; ++page) {
    const auto ref = read_record<DirectoryPageRef>(directory, 8 + page * sizeof(DirectoryPageRef));
    auto offset = read_record<std::uint64_t>(file, ref.offset);
    directory_pages_.push_back((ref.bytes - 8) / sizeof(ChunkEntry));
    for (std::size_t c = 0; c < directory_pages_.back(); ++c) {
      const auto entry = read_record<ChunkEntry>(file, ref.offset + 8 + c * sizeof(ChunkEntry));
      chunks_.push_back(
          {entry, unpack(std::span(file).subspan(offset, entry.packed_bytes), entry.unpacked_bytes, "test").value()});
      offset += entry.packed_bytes;
    }
  }
}

void Dissected::read_pages(std::span<const std::byte> section, std::span<const std::byte> root,
                           std::uint64_t root_front, std::size_t attributes) {
  std::map<std::uint64_t, std::size_t> page_at;  // offset in the section: index in pages_
  const auto read_page = [&](std::span<const std::byte> bytes, std::uint64_t front) {
    Page page{read_record<std::uint32_t>(bytes, 0), {}, {}, {}};
    std::uint64_t at = 8 + sizeof(IndexPagePart) * (1 + attributes);
    for (std::size_t b = 0; b <= attributes; ++b) {
      const auto part = read_record<IndexPagePart>(bytes, 8 + b * sizeof(IndexPagePart));
      page.parts.push_back(unpack(bytes.subspan(at, part.packed_bytes), part.unpacked_bytes, "test").value());
      at += part.packed_bytes;
      if (b == 0 && at != front) std::abort();
    }
    page.links = find_links(page.parts[0], page.node_count, resolutions_, size_bounds_);
    return page;
  };

  // Depth first, so that a page comes before the page that links to it.
  const std::function<std::size_t(std::span<const std::byte>, std::uint64_t)> add =
      [&](std::span<const std::byte> bytes, std::uint64_t front) {
        Page page = read_page(bytes, front);
        for (const std::size_t link : page.links) {
          const auto ref = read_record<IndexPageRef>(page.parts[0], link);
          page.linked_pages.push_back(add(section.subspan(ref.offset, ref.page_bytes), ref.front_bytes));
        }
        pages_.push_back(std::move(page));
        return pages_.size() - 1;
      };
  add(root, root_front);
}

std::vector<Dissected::PackedPage> Dissected::pack_pages(const Surgeon& surgeon) const {
  std::vector<PackedPage> packed;
  std::uint64_t offset = 0;
  std::size_t summaries = 0;
  for (std::size_t p = 0; p < pages_.size(); ++p) {
    const Page& page = pages_[p];
    std::vector<Bytes> parts = page.parts;
    for (std::size_t link = 0; link < page.links.size(); ++link)
      overwrite(parts[0], page.links[link], packed[page.linked_pages[link]].ref);
    surgeon(Part::structure, p, parts[0]);
    for (std::size_t b = 1; b < parts.size(); ++b) surgeon(Part::summary, summaries++, parts[b]);

    Bytes table, body;
    append_record(table, page.node_count);
    append_record(table, std::uint32_t{0});
    std::uint64_t structure_bytes = 0;
    for (std::size_t b = 0; b < parts.size(); ++b) {
      const Bytes part = pack(parts[b]);
      append_record(table, IndexPagePart{static_cast<std::uint32_t>(part.size()),
                                         static_cast<std::uint32_t>(parts[b].size()), hash_bytes(part)});
      append(body, part);
      if (b == 0) structure_bytes = part.size();
    }
    surgeon(Part::index_table, p, table);
    PackedPage result{{offset, static_cast<std::uint32_t>(table.size() + structure_bytes), 0, hash_bytes(table)},
                      table};
    append(result.bytes, body);
    result.ref.page_bytes = static_cast<std::uint32_t>(result.bytes.size());
    offset += result.bytes.size();
    packed.push_back(std::move(result));
  }
  return packed;
}

Bytes Dissected::assemble(const Surgeon& surgeon) const {
  Assembly assembly{{}, {}, {}, sections_, {}};
  pack_content(surgeon, assembly);
  pack_directory(surgeon, assembly);
  Bytes table, body;
  pack_sections(surgeon, assembly, table, body);

  Superblock superblock = superblock_;
  superblock.file_bytes = sizeof(Superblock) + table.size() + body.size() + sizeof(Footer);
  superblock.preamble_bytes = std::min<std::uint64_t>(max_preamble_bytes, superblock.file_bytes - sizeof(Footer));
  superblock.section_count = static_cast<std::uint32_t>(table.size() / sizeof(SectionEntry));
  superblock.section_table_hash = hash_bytes(table);
  superblock = operate_on_record(superblock, offsetof(Superblock, hash), surgeon, Part::superblock);
  superblock.hash = hash_bytes(std::as_bytes(std::span(&superblock, 1)).first(offsetof(Superblock, hash)));

  Bytes file;
  append_record(file, superblock);
  append(file, table);
  Footer footer = footer_;
  footer.file_bytes = superblock.file_bytes;
  footer.table_hash = hash_bytes(file);
  footer = operate_on_record(footer, offsetof(Footer, hash), surgeon, Part::footer);
  footer.hash = hash_bytes(std::as_bytes(std::span(&footer, 1)).first(offsetof(Footer, hash)));
  append(file, body);
  append_record(file, footer);
  return file;
}

// Packs everything but the directory.
void Dissected::pack_content(const Surgeon& surgeon, Assembly& assembly) const {
  const auto pack_section = [&](SectionKind kind, Part part, Bytes bytes) {
    surgeon(part, 0, bytes);
    assembly.packed[kind] = pack(bytes);
    assembly.unpacked_bytes[kind] = bytes.size();
  };
  pack_section(SectionKind::metadata, Part::metadata, metadata_);
  pack_section(SectionKind::histograms, Part::histograms, histograms_);

  const std::vector<PackedPage> pages = pack_pages(surgeon);
  for (std::size_t p = 0; p + 1 < pages.size(); ++p) append(assembly.packed[SectionKind::index_pages], pages[p].bytes);
  assembly.packed[SectionKind::index_root] = pages.back().bytes;
  assembly.root = pages.back().ref;

  for (std::size_t c = 0; c < chunks_.size(); ++c) {
    Bytes payload = chunks_[c].payload;
    surgeon(Part::chunk, c, payload);
    const Bytes chunk = pack(payload);
    ChunkEntry entry = chunks_[c].entry;
    entry.hash = hash_bytes(chunk);
    entry.packed_bytes = static_cast<std::uint32_t>(chunk.size());
    entry.unpacked_bytes = static_cast<std::uint32_t>(payload.size());
    assembly.entries.push_back(entry);
    append(assembly.packed[SectionKind::rows], chunk);
  }
}

void Dissected::pack_directory(const Surgeon& surgeon, Assembly& assembly) const {
  // All lengths are known, and so the offsets of sections, directory pages and chunks.
  const std::uint64_t references = 8 + directory_pages_.size() * sizeof(DirectoryPageRef);
  assembly.packed[SectionKind::directory_root].resize(references + 8 + directory_pages_[0] * sizeof(ChunkEntry));
  std::size_t tail = 0;
  for (std::size_t p = 1; p < directory_pages_.size(); ++p) tail += 8 + directory_pages_[p] * sizeof(ChunkEntry);
  assembly.packed[SectionKind::directory_pages].resize(tail);
  std::uint64_t end = sizeof(Superblock) + assembly.sections.size() * sizeof(SectionEntry);
  std::map<SectionKind, std::uint64_t> begins;
  for (const SectionEntry& section : assembly.sections) {
    begins[section.kind] = end;
    end += assembly.packed[section.kind].size();
  }

  Bytes root(8), head, pages_tail;
  overwrite(root, 0, static_cast<std::uint64_t>(directory_pages_.size()));
  std::uint64_t chunk_offset = begins[SectionKind::rows];
  std::size_t chunk = 0;
  for (std::size_t p = 0; p < directory_pages_.size(); ++p) {
    Bytes page;
    append_record(page, chunk_offset);
    for (std::size_t c = 0; c < directory_pages_[p]; ++c, ++chunk) {
      append_record(page, assembly.entries[chunk]);
      chunk_offset += assembly.entries[chunk].packed_bytes;
    }
    surgeon(Part::directory_page, p, page);
    const std::uint64_t offset = p == 0 ? begins[SectionKind::directory_root] + references
                                        : begins[SectionKind::directory_pages] + pages_tail.size();
    append_record(root, DirectoryPageRef{offset, page.size(), hash_bytes(page)});
    append(p == 0 ? head : pages_tail, page);
  }
  append(root, head);
  surgeon(Part::directory_root, 0, root);
  assembly.packed[SectionKind::directory_root] = root;
  assembly.packed[SectionKind::directory_pages] = pages_tail;
}

// Makes sections that tile the file, whatever lengths the surgeon has changed: their table, and their bytes.
void Dissected::pack_sections(const Surgeon& surgeon, Assembly& assembly, Bytes& table, Bytes& body) const {
  std::uint64_t offset = sizeof(Superblock) + assembly.sections.size() * sizeof(SectionEntry);
  for (SectionEntry& section : assembly.sections) {
    const Bytes& bytes = assembly.packed[section.kind];
    section.offset = offset;
    offset += section.packed_bytes = bytes.size();
    if (section.codec != Codec::extent) {
      const auto unpacked = assembly.unpacked_bytes.find(section.kind);
      const bool is_packed = unpacked != assembly.unpacked_bytes.end() && unpacked->second != bytes.size();
      section.codec = is_packed ? Codec::zstd : Codec::raw;
      section.unpacked_bytes = is_packed ? unpacked->second : bytes.size();
      section.hash = hash_bytes(bytes);
    }
    if (section.kind == SectionKind::index_root) {
      section.unpacked_bytes = assembly.root.front_bytes;
      section.hash = assembly.root.hash;
    }
    append_record(table, section);
    append(body, bytes);
  }
  surgeon(Part::section_table, 0, table);
}

std::size_t Dissected::count(Part part) const {
  switch (part) {
    case Part::structure:
    case Part::index_table:
      return pages_.size();
    case Part::summary:
      return pages_.size() * (pages_[0].parts.size() - 1);
    case Part::chunk:
      return chunks_.size();
    case Part::directory_page:
      return directory_pages_.size();
    default:
      return 1;
  }
}

}  // namespace splatvol::test
