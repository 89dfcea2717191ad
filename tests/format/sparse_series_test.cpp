// Time series with holes: lengths of gigabytes that take no disk space, with correct hashes. Readers must not take
// memory for them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "base/file.h"
#include "format/series_writer.h"
#include "format/volume.h"
#include "tests/format/allocation_counter.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {
namespace {

using namespace format;
using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

constexpr std::uint64_t six_gigabytes = std::uint64_t{6} << 30;
constexpr std::size_t little = std::size_t{16} << 20;

/// Two runs of bytes with zeros between them.
class Sparse final : public ByteSource {
 public:
  Sparse(Bytes front, std::uint64_t hole, Bytes back = {})
      : front_(std::move(front)), hole_(hole), back_(std::move(back)) {}

  std::uint64_t size() const override { return front_.size() + hole_ + back_.size(); }
  Status read(std::uint64_t offset, std::span<std::byte> out) override {
    for (std::byte& byte : out) byte = at(offset++);
    return {};
  }
  const std::string& name() const override { return name_; }

 private:
  std::byte at(std::uint64_t offset) const {
    if (offset < front_.size()) return front_[offset];
    offset -= front_.size();
    return offset < hole_ ? std::byte{0} : back_.at(offset - hole_);
  }

  Bytes front_;
  std::uint64_t hole_;
  Bytes back_;
  std::string name_ = "sparse.svol";
};

/// The golden series, in parts.
struct Parts {
  Bytes front;  // up to the step directory
  std::vector<StepEntry> entries;
  Bytes ranges;
};

Parts golden_series() {
  const std::string text = read_text_file(SPLATVOL_GOLDEN "/series.svol").value();
  const auto raw = std::as_bytes(std::span(text));
  const auto directory = read_record<Superblock>(raw, 0).step_directory;
  const auto head = read_record<StepDirectoryHead>(raw, directory);
  Parts parts;
  parts.front.assign(raw.begin(), raw.begin() + static_cast<std::ptrdiff_t>(directory));
  std::size_t at = directory + sizeof(head);
  for (std::uint64_t i = 0; i < head.entries; ++i, at += sizeof(StepEntry))
    parts.entries.push_back(read_record<StepEntry>(raw, at));
  parts.ranges.assign(raw.begin() + static_cast<std::ptrdiff_t>(at), raw.end() - sizeof(Footer));
  return parts;
}

template <class T>
void put(Bytes& bytes, std::size_t at, const T& record) {
  std::ranges::copy(std::as_bytes(std::span(&record, 1)), bytes.begin() + static_cast<std::ptrdiff_t>(at));
}

/// Makes a file of the parts, with a hole behind the front. The superblock and all hashes are right.
std::unique_ptr<ByteSource> assemble(Parts parts, std::uint64_t hole) {
  Bytes back;
  StepDirectoryHead head{0, parts.entries.size(), parts.ranges.size() / sizeof(StepRange)};
  append_record(back, head);
  for (const StepEntry& entry : parts.entries) append_record(back, entry);
  back.insert(back.end(), parts.ranges.begin(), parts.ranges.end());
  head.hash = hash_bytes(std::span(back).subspan(sizeof(head.hash)));
  put(back, 0, head);

  auto superblock = read_record<Superblock>(parts.front, 0);
  superblock.step_directory = parts.front.size() + hole;
  superblock.file_bytes = superblock.step_directory + back.size() + sizeof(Footer);
  seal(superblock);
  put(parts.front, 0, superblock);
  const std::size_t table = sizeof(Superblock) + superblock.section_count * sizeof(SectionEntry);
  append_record(back, make_footer(superblock.file_bytes, hash_bytes(std::span(parts.front).first(table))));
  return std::make_unique<Sparse>(std::move(parts.front), hole, std::move(back));
}

/// Opens and checks a file. Returns the first error; empty: there is none. It may hold little memory.
std::string refusal_of(std::unique_ptr<ByteSource> file) {
  start_counting_allocations();
  const std::string error = test::error_of(std::move(file));
  EXPECT_LT(most_bytes_allocated(), little);
  return error;
}

TEST(SparseSeries, TheSoundFileIsAccepted) { EXPECT_EQ(refusal_of(assemble(golden_series(), 0)), ""); }

TEST(SparseSeries, AStepDirectoryOfGigabytesIsRefused) {
  Parts parts = golden_series();
  auto superblock = read_record<Superblock>(parts.front, 0);
  superblock.file_bytes = six_gigabytes;
  seal(superblock);
  put(parts.front, 0, superblock);
  const std::uint64_t hole = six_gigabytes - parts.front.size();
  EXPECT_THAT(refusal_of(std::make_unique<Sparse>(std::move(parts.front), hole)),
              AllOf(StartsWith("sparse.svol: "), HasSubstr("step directory"), HasSubstr("[R18]")));
}

TEST(SparseSeries, ADirectoryOfMoreStepsThanAllowedIsRefused) {
  Parts parts = golden_series();
  parts.entries.resize(max_step_entries + 1, parts.entries.back());
  auto file = assemble(std::move(parts), 0);
  EXPECT_THAT(refusal_of(std::move(file)), HasSubstr("[R18]"));
}

TEST(SparseSeries, ALongDeadPartIsHashedInPieces) {
  constexpr std::uint64_t length = std::uint64_t{64} << 20;  // zeros
  Parts parts = golden_series();
  StreamHash hash;
  for (std::uint64_t at = 0; at < length; at += 1u << 20) hash.add(Bytes(1u << 20));
  parts.entries.push_back({0, parts.front.size(), length, hash.value(), StepEntryKind::dead, 0});
  EXPECT_EQ(refusal_of(assemble(std::move(parts), length)), "");
}

/// The last step of a series, to be changed.
struct LastStep {
  explicit LastStep(Parts& of) : parts(of), entry(of.entries.back()) {
    bytes.assign(parts.front.begin() + static_cast<std::ptrdiff_t>(entry.offset), parts.front.end());
    superblock = read_record<Superblock>(bytes, 0);
    for (std::uint32_t i = 0; i < superblock.section_count; ++i)
      sections.push_back(read_record<SectionEntry>(bytes, sizeof(Superblock) + i * sizeof(SectionEntry)));
  }

  SectionEntry& section(SectionKind kind) { return *std::ranges::find(sections, kind, &SectionEntry::kind); }

  /// Puts the step back, `hole` bytes longer, with right hashes of its superblock and sections.
  void put_back(std::uint64_t hole) {
    superblock.file_bytes = entry.bytes = bytes.size() + hole;
    const Bytes front = pack_front(superblock, true, sections);
    std::ranges::copy(front, bytes.begin());
    entry.hash = hash_bytes(front);
    parts.front.resize(entry.offset);
    parts.front.insert(parts.front.end(), bytes.begin(), bytes.end());
  }

  Parts& parts;
  StepEntry& entry;
  Bytes bytes;
  Superblock superblock{};
  std::vector<SectionEntry> sections;
};

// The table moves behind the other sections. The section behind its place takes over its bytes, so that no other offset
// changes.
TEST(SparseSeries, ASummaryTableOfGigabytesIsRefusedAtItsFirstWrongEntry) {
  constexpr std::uint64_t table_bytes = six_gigabytes / sizeof(SummaryPageRef) * sizeof(SummaryPageRef);
  Parts parts = golden_series();
  LastStep step(parts);
  const SectionEntry table = step.section(SectionKind::summary_table);
  const auto next = step.sections.erase(std::ranges::find(step.sections, table.kind, &SectionEntry::kind));
  next->offset = table.offset;
  next->packed_bytes += table.packed_bytes;
  step.sections.push_back(table);
  step.sections.back().offset = step.bytes.size();
  step.sections.back().packed_bytes = step.sections.back().unpacked_bytes = table_bytes;
  step.put_back(table_bytes);
  EXPECT_THAT(refusal_of(assemble(std::move(parts), table_bytes)),
              AllOf(StartsWith("sparse.svol: "), HasSubstr("[R20]")));
}

TEST(SparseSeries, PackedSummariesAreNoLongerThanUnpackedOnes) {
  Parts parts = golden_series();
  LastStep step(parts);
  // One part of the root's page takes bytes from the next.
  SectionEntry& root = step.section(SectionKind::index_root);
  auto first = read_record<IndexPagePart>(step.bytes, root.offset);
  auto second = read_record<IndexPagePart>(step.bytes, root.offset + sizeof(first));
  const std::uint32_t too_many = first.unpacked_bytes + 1 - first.packed_bytes;
  ASSERT_GT(second.packed_bytes, too_many);
  first.packed_bytes += too_many;
  second.packed_bytes -= too_many;
  put(step.bytes, root.offset, first);
  put(step.bytes, root.offset + sizeof(first), second);
  root.hash = hash_bytes(std::span(step.bytes).subspan(root.offset, root.unpacked_bytes));

  SectionEntry& table = step.section(SectionKind::summary_table);
  const std::size_t last = table.offset + table.packed_bytes - sizeof(SummaryPageRef);
  auto page = read_record<SummaryPageRef>(step.bytes, last);
  page.hash = root.hash;
  put(step.bytes, last, page);
  table.hash = hash_bytes(std::span(step.bytes).subspan(table.offset, table.packed_bytes));
  step.put_back(0);
  EXPECT_THAT(refusal_of(assemble(std::move(parts), 0)), HasSubstr("a part has the wrong length [R20]"));
}

}  // namespace
}  // namespace splatvol::test
