// Takes a .svol file apart and puts it together again with correct hashes, lengths and offsets, as an attacker can who
// knows the specification.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "format/codec.h"
#include "format/layout.h"

namespace splatvol::test {

/// The kinds of parts that have hashes.
enum class Part {
  metadata,     // JSON
  structure,    // of an index page, unpacked; the last one is the root's
  summary,      // an attribute's part of an index page, unpacked
  index_table,  // node count and part table of an index page
  chunk,        // unpacked
  directory_page,
  directory_root,  // page count and references
  histograms,      // unpacked
  section_table,
  superblock,  // all but its hash
  footer,      // all but its hash
};
inline constexpr int part_count = 11;

/// May change a part before it is packed and hashed. `index` counts the parts of one kind in file order.
using Surgeon = std::function<void(Part part, std::size_t index, format::Bytes& bytes)>;

/// A file, taken apart.
class Dissected {
 public:
  /// Requires a whole and valid file.
  explicit Dissected(const format::Bytes& file);

  /// Makes a file whose hashes are all correct, whatever the surgeon did.
  [[nodiscard]] format::Bytes assemble(const Surgeon& surgeon) const;

  /// Returns the number of parts of a kind.
  [[nodiscard]] std::size_t count(Part part) const;

  /// Finds the offsets of a page's links to other pages in its structure.
  [[nodiscard]] const std::vector<std::size_t>& links(std::size_t page) const { return pages_[page].links; }

 private:
  struct Page {
    std::uint32_t node_count;
    std::vector<format::Bytes> parts;
    std::vector<std::size_t> links;         // offsets of its links in the structure
    std::vector<std::size_t> linked_pages;  // for each link, the page's index in pages_
  };
  struct PackedPage {
    format::IndexPageRef ref;
    format::Bytes bytes;
  };
  struct Chunk {
    format::ChunkEntry entry;
    format::Bytes payload;
  };

  void read_pages(std::span<const std::byte> section, std::span<const std::byte> root, std::uint64_t root_front,
                  std::size_t attributes);
  [[nodiscard]] std::vector<PackedPage> pack_pages(const Surgeon& surgeon) const;

  // A file that is being put together.
  struct Assembly {
    std::map<format::SectionKind, format::Bytes> packed;
    std::map<format::SectionKind, std::uint64_t> unpacked_bytes;  // of sections that are packed
    std::vector<format::ChunkEntry> entries;
    std::vector<format::SectionEntry> sections;
    format::IndexPageRef root;
  };
  void pack_content(const Surgeon& surgeon, Assembly& assembly) const;
  void pack_directory(const Surgeon& surgeon, Assembly& assembly) const;
  void pack_sections(const Surgeon& surgeon, Assembly& assembly, format::Bytes& table, format::Bytes& body) const;

  format::Superblock superblock_{};
  std::vector<format::SectionEntry> sections_;
  format::Bytes metadata_;
  std::vector<Page> pages_;  // file order; the root's is the last
  std::size_t resolutions_ = 0;
  std::size_t size_bounds_ = 0;
  std::vector<Chunk> chunks_;
  std::vector<std::size_t> directory_pages_;  // chunks in each
  format::Bytes histograms_;
  format::Footer footer_{};
};

}  // namespace splatvol::test
