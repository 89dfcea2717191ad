// Sections behind a superblock: of a file, or of a step in a file (spec/svol-1.md, sections 2, 3 and 11).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/byte_ranges.h"
#include "base/error.h"
#include "base/file.h"
#include "format/codec.h"
#include "format/layout.h"

namespace splatvol::format {

/// Puts the hash of the superblock's other fields into it.
void seal(Superblock& superblock);

/// Returns the superblock and the section table of a file or a step. Sets magic, version, counts and hashes; the other
/// fields of `superblock` are the caller's: lengths, and those of a series. A minor version that the caller sets is the
/// lowest one.
[[nodiscard]] Bytes pack_front(Superblock superblock, bool is_step, std::span<const SectionEntry> sections);

/// A range of a file that begins with a superblock and a section table. Holds its preamble, and reads everything else
/// on demand. Offsets are from the beginning of the range. Thread-safe.
class Container {
 public:
  enum class Kind { file, step };

  /// Reads the preamble and checks the section table. A file begins at 0; `bytes` is its size, and that of a step is
  /// the step's. `name` begins messages.
  [[nodiscard]] static Result<std::shared_ptr<const Container>> open(std::shared_ptr<CountedSource> source, Kind kind,
                                                                     std::uint64_t begin, std::uint64_t bytes,
                                                                     std::string name);

  [[nodiscard]] const Superblock& superblock() const { return superblock_; }
  [[nodiscard]] const std::vector<SectionEntry>& sections() const { return sections_; }

  /// Where the range begins in the file, its bytes, and the offset at which its sections end.
  [[nodiscard]] std::uint64_t begin() const { return begin_; }
  [[nodiscard]] std::uint64_t bytes() const { return superblock_.file_bytes; }
  [[nodiscard]] std::uint64_t sections_end() const { return sections_end_; }

  [[nodiscard]] std::uint64_t preamble_bytes() const { return superblock_.preamble_bytes; }

  /// Bytes held, for budgets.
  [[nodiscard]] std::uint64_t memory_bytes() const { return preamble_.size(); }

  /// Returns null if there is none.
  [[nodiscard]] const SectionEntry* find_section(SectionKind kind) const;

  /// Reads packed bytes: from the preamble if it holds them, else from the source.
  [[nodiscard]] Result<Bytes> read_bytes(std::uint64_t offset, std::uint64_t count) const;

  /// Reads packed bytes in parts, of which `use` gets one after the other: a length that the file states takes no
  /// memory. All parts but the last hold whole records. Returns the hash of all, or the first failure of `use`.
  [[nodiscard]] Result<std::uint64_t> read_in_parts(std::uint64_t offset, std::uint64_t count,
                                                    std::uint64_t record_bytes,
                                                    const std::function<Status(std::span<const std::byte>)>& use) const;

  /// Whether the preamble holds these bytes.
  [[nodiscard]] bool holds(std::uint64_t offset, std::uint64_t count) const {
    return offset <= preamble_.size() && count <= preamble_.size() - offset;
  }

  /// Reads, checks and unpacks a section that is no extent.
  [[nodiscard]] Result<Bytes> read_section(const SectionEntry& section) const;

  /// Returns the hash of superblock and section table.
  [[nodiscard]] std::uint64_t table_hash() const;

  [[nodiscard]] tl::unexpected<Error> broken(std::string_view rule) const;

 private:
  Container(std::shared_ptr<CountedSource> source, Kind kind, std::uint64_t begin, std::string name)
      : source_(std::move(source)), kind_(kind), begin_(begin), name_(std::move(name)) {}
  [[nodiscard]] Status read_preamble(std::uint64_t bytes);
  [[nodiscard]] Status read_superblock(std::uint64_t bytes);
  [[nodiscard]] Status check_size(std::uint64_t bytes) const;
  [[nodiscard]] Status read_section_table();
  [[nodiscard]] Status check_sections();
  [[nodiscard]] Status check_section_kinds() const;

  std::shared_ptr<CountedSource> source_;
  Kind kind_;
  std::uint64_t begin_;
  std::string name_;
  Superblock superblock_{};
  std::uint64_t sections_end_ = 0;
  Bytes preamble_;  // the first read, which is at least the preamble
  std::vector<SectionEntry> sections_;
};

}  // namespace splatvol::format
