// Takes a .svol file apart and puts it together again with correct hashes, lengths and offsets, as an attacker can who
// knows the specification.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "format/codec.h"
#include "format/layout.h"

namespace splatvol::test {

/// The kinds of parts that have hashes. Those of the steps of a series follow those of the file.
enum class Part {
  metadata,     // JSON
  structure,    // of an index page, unpacked; the last one of the file is the root's
  summary,      // an attribute's part of an index page, unpacked
  index_table,  // node count and part table of an index page; of a step, the part table
  chunk,        // unpacked
  directory_page,
  directory_root,  // page count and references
  histograms,      // unpacked
  section_table,
  superblock,  // all but its hash
  footer,      // all but its hash

  // Not in every file.
  summary_table,   // of a step
  step_directory,  // of a series, all but its hash
  dead_part,       // of a series
  other_section,   // padding, and kinds that are not known; unpacked
  patch,           // of the boundary, unpacked
  patch_table,     // of the boundary, all but its hash
  rank_page,       // of the cells, unpacked
  cells,           // a chunk of cells, unpacked
  cell_entries,    // of a page of cells, unpacked
  cell_summary,    // an attribute's part of a page of cells, unpacked
  cell_table,      // part table of a page of cells
  cell_root,       // root of the cells, with its tail but without its hash
};
inline constexpr std::size_t part_count = 11;  // of the kinds that every file has
inline constexpr std::size_t all_part_count = 23;

/// Replaces a number in a JSON text by another: at the edge of a rule, or far beyond. `draw(n)`: a number below n.
void harm_number(format::Bytes& json, const std::function<std::size_t(std::size_t below)>& draw);

/// May change a part before it is packed and hashed. `index` counts the parts of one kind in file order.
using Surgeon = std::function<void(Part part, std::size_t index, format::Bytes& bytes)>;

/// How parts are stored. `as_before`: those that the surgeon leaves alone have the bytes that they had.
enum class Packing { zstd, raw, as_before };

/// A file, taken apart.
class Dissected {
 public:
  /// Requires a whole and valid file.
  explicit Dissected(const format::Bytes& file);

  /// Takes any file apart, however damaged its parts are. Returns nothing if they cannot be found, or if their lengths
  /// are not those of the file. Checks no hash. Safe on untrusted bytes.
  [[nodiscard]] static std::optional<Dissected> take_apart(std::span<const std::byte> file);

  /// Makes a file whose hashes are all correct, whatever the surgeon did.
  [[nodiscard]] format::Bytes assemble(const Surgeon& surgeon, Packing packing = Packing::zstd) const;

  /// The same, where only one part is changed, which must be there.
  [[nodiscard]] format::Bytes harmed(Part part, std::size_t index,
                                     const std::function<void(format::Bytes&)>& harm) const;

  /// Returns the number of parts of a kind.
  [[nodiscard]] std::size_t count(Part part) const { return counts_[static_cast<std::size_t>(part)]; }

  /// Finds the offsets of a page's links to other pages in its structure.
  [[nodiscard]] const std::vector<std::size_t>& links(std::size_t page) const { return file_.pages[page].links; }

 private:
  struct Page {
    std::uint32_t node_count = 0;
    std::uint32_t number = 0;
    std::vector<format::Bytes> parts;       // of a step: without a structure
    std::vector<std::size_t> links;         // offsets of its links in the structure
    std::vector<std::size_t> linked_pages;  // for each link, the page's number
  };
  struct Chunk {
    format::ChunkEntry entry{};
    format::Bytes payload;
  };
  /// The section of cells.
  struct Cells {
    struct Page {
      std::vector<std::size_t> chunks;   // of `Cells::chunks`
      std::vector<format::Bytes> parts;  // unpacked
      format::CellPageRef ref{};
    };
    std::vector<format::Bytes> rank_pages;  // unpacked
    std::vector<format::Bytes> chunks;      // unpacked
    std::vector<Page> pages;
    format::Bytes kinds;
    format::CellsTail tail{};
  };
  /// A superblock and its sections: of the file, or of a step.
  struct Body {
    bool is_step = false;
    format::Superblock superblock{};
    std::vector<format::SectionEntry> sections;
    std::map<format::SectionKind, format::Bytes> plain;  // sections that are no extents, unpacked
    std::vector<Page> pages;                             // file order; the root's is the last
    std::vector<Chunk> chunks;
    std::vector<std::size_t> directory_pages;  // chunks in each
    std::vector<format::Bytes> patches;        // unpacked
    std::optional<Cells> cells;                // none: there are none, or they are one section
  };
  /// A step, or a dead part.
  struct SeriesPart {
    format::StepEntry entry{};
    Body step;
    format::Bytes dead;
  };
  class Reader;
  class Assembler;

  Dissected() = default;

  Body file_;
  std::map<std::uint64_t, format::Bytes> packed_;  // by the hashes of parts that are unpacked
  std::vector<SeriesPart> series_;
  format::Bytes step_ranges_;
  std::uint64_t step_attributes_ = 0;
  format::Footer footer_{};
  std::array<std::size_t, all_part_count> counts_{};
};

}  // namespace splatvol::test
