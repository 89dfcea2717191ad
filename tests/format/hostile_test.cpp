// Harmful files with correct hashes: a reader gives an error or a consistent volume.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>

#include "base/file.h"
#include "format/volume.h"
#include "tests/format/allocation_counter.h"
#include "tests/support/explorer.h"
#include "tests/support/long.h"
#include "tests/support/memory_source.h"
#include "tests/support/surgery.h"
#include "tests/support/test_volume.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {
namespace {

using namespace format;
using nlohmann::json;
using testing::HasSubstr;

const Surgeon leave_alone = [](Part, std::size_t, Bytes&) {};

TestVolume volume_of(std::size_t points, std::size_t attributes) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<std::vector<double>> values(attributes, std::vector<double>(points));
  for (auto& column : values)
    for (double& value : column) value = uniform(random) < -0.9 ? std::nan("") : uniform(random);
  return make_test_volume(random_points(points, 3), values, {.node_points = 12, .position_error = 1e-5});
}

struct Outcome {
  bool opened = false;
  bool verified = false;
  std::string message;
};

Outcome explore(const Bytes& file) {
  const auto volume = Volume::open(memory_source(file, "mutant"));
  if (!volume) return {false, false, volume.error().message};
  const Status verified = (*volume)->verify([](double) {});
  const Exploration read = explore_volume(**volume);
  EXPECT_EQ(read.broken, "");
  if (verified) {
    EXPECT_TRUE(read.all_read) << "verify accepts what cannot be read";
  }
  return {true, verified.has_value(), verified ? "" : verified.error().message};
}

Outcome explore(const Dissected& parts, Part part, std::size_t index, const std::function<void(Bytes&)>& change) {
  return explore(parts.harmed(part, index, change));
}

TEST(Surgery, LeavesAFileAsItWasWhereNothingIsDone) {
  for (const std::size_t points : {1, 40, 400}) {
    const Bytes file = test_volume_bytes(volume_of(points, 2));
    ASSERT_FALSE(file.empty());
    const Outcome outcome = explore(Dissected(file).assemble(leave_alone));
    EXPECT_TRUE(outcome.verified) << outcome.message;
    EXPECT_EQ(Dissected(file).assemble(leave_alone, Packing::as_before).size(), file.size());
  }
}

// --- Random changes.

class Mutator {
 public:
  explicit Mutator(std::uint32_t seed) : random_(seed) {}
  std::size_t draw(std::size_t below) { return random_() % below; }

  void harm(Part part, Bytes& bytes) {
    if (part == Part::metadata && draw(4) != 0)
      return harm_number(bytes, [&](std::size_t below) { return draw(below); });
    for (std::size_t times = 1 + draw(3); times > 0; --times) harm_bytes(bytes);
  }

 private:
  void harm_bytes(Bytes& bytes) {
    if (bytes.empty()) return bytes.push_back(std::byte{1});
    const std::size_t at = draw(bytes.size());
    switch (draw(8)) {
      case 0:
        bytes[at] ^= static_cast<std::byte>(1u << draw(8));
        break;
      case 1:
        bytes[at] = pick<std::byte>({std::byte{0}, std::byte{1}, std::byte{0x7F}, std::byte{0x80}, std::byte{0xFF}});
        break;
      case 2:
        overwrite(bytes, at, pick<std::uint32_t>({0, 1, 64, 65536, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF}));
        break;
      case 3:
        overwrite(bytes, at / 8 * 8,
                  pick<std::uint64_t>({0, 1, bytes.size(), 1u << 20, 1ull << 32, 1ull << 48, 1ull << 63, ~0ull}));
        break;
      case 4:
        overwrite(bytes, at / 8 * 8, pick<double>({std::nan(""), 1.0 / 0.0, -1, 1e308, 5e-324, 0x1p63}));
        break;
      case 5:
        bytes.resize(at);
        break;
      case 6:
        bytes.insert(bytes.end(), 1 + draw(64), static_cast<std::byte>(draw(256)));
        break;
      default:
        std::copy_n(bytes.begin(), std::min<std::size_t>(8, bytes.size() - at),
                    bytes.begin() + static_cast<std::ptrdiff_t>(at));
        break;
    }
  }

  template <class T>
  T pick(std::initializer_list<T> choices) {
    return choices.begin()[draw(choices.size())];
  }
  template <class T>
  static void overwrite(Bytes& bytes, std::size_t at, T value) {
    std::memcpy(bytes.data() + at, &value, std::min(sizeof(T), bytes.size() - at));
  }

  std::mt19937 random_;
};

// Explores a file of which one piece of a part was harmed, and expects that no allocation is large.
Outcome explore_harmed(const Dissected& parts, Part part, std::uint32_t seed) {
  constexpr std::size_t largest_allocation = 8u << 20;
  Mutator mutator(seed);
  const std::size_t index = mutator.draw(parts.count(part));
  const Bytes file = parts.harmed(part, index, [&](Bytes& bytes) { mutator.harm(part, bytes); });
  start_counting_allocations();
  const Outcome outcome = explore(file);
  EXPECT_LE(most_bytes_allocated(), largest_allocation) << "seed " << seed;
  return outcome;
}

TEST(Hostile, RandomHarmWithGoodHashesIsRefusedOrHarmless) {
  const Dissected files[] = {Dissected(test_volume_bytes(volume_of(1, 1))),
                             Dissected(test_volume_bytes(volume_of(300, 1))),
                             Dissected(test_volume_bytes(volume_of(700, 3)))};
  int refused = 0, accepted = 0, opened = 0;
  for (std::uint32_t seed = 0; seed < (test::is_long() ? 9000 : 3300); ++seed) {
    const Outcome outcome = explore_harmed(files[seed % 3], static_cast<Part>(seed / 3 % part_count), seed);
    ++(outcome.verified ? accepted : refused);
    if (outcome.opened) ++opened;
    if (!outcome.verified) {
      EXPECT_THAT(outcome.message, HasSubstr("mutant"));
    }
  }
  EXPECT_GT(refused, 1000);
  EXPECT_GT(accepted, 300);  // changes to data for people, or to single coordinates
  EXPECT_GT(opened, 1000);
}

TEST(Hostile, RandomHarmToCellsIsRefusedOrHarmless) {
  TestVolume few = volume_of(40, 1), more = volume_of(300, 2);
  add_random_cells(few, 20);
  add_random_cells(more, 300);
  const Dissected files[] = {Dissected(test_volume_bytes(few)), Dissected(test_volume_bytes(more))};
  constexpr Part parts_of_cells[] = {Part::rank_page,    Part::cells,      Part::cell_entries,
                                     Part::cell_summary, Part::cell_table, Part::cell_root};
  int refused = 0;
  for (std::uint32_t seed = 0; seed < (test::is_long() ? 9000 : 900); ++seed) {
    const Part part = parts_of_cells[seed / 2 % std::size(parts_of_cells)];
    const Outcome outcome = explore_harmed(files[seed % 2], part, seed);
    EXPECT_TRUE(outcome.opened) << "who wants no cells reads none";
    if (outcome.verified) continue;
    ++refused;
    EXPECT_THAT(outcome.message, HasSubstr("mutant"));
  }
  EXPECT_GT(refused, 600);
}

// --- Changes with a purpose.

// A change of the metadata.
std::function<void(Bytes&)> in_metadata(const std::function<void(json&)>& change) {
  return [change](Bytes& bytes) {
    json document = json::parse(text_of(bytes));
    change(document);
    bytes = bytes_of(document.dump());
  };
}

struct HostileSmallFile : testing::Test {
  HostileSmallFile() : file_(test_volume_bytes(volume_of(1, 1))), parts_(file_) {}

  // Returns the most bytes that a reader holds at once while reading the changed file.
  std::size_t memory_of(Part part, const std::function<void(Bytes&)>& change, std::size_t most_file_bytes = 2048) {
    const Bytes file = parts_.assemble([&](Part p, std::size_t, Bytes& bytes) {
      if (p == part) change(bytes);
    });
    EXPECT_LE(file.size(), most_file_bytes);
    start_counting_allocations();
    explore(file);
    return most_bytes_allocated();
  }

  Bytes file_;
  Dissected parts_;
};

constexpr std::size_t few_megabytes = 7u << 20;  // the shapes of the largest group take 6

TEST_F(HostileSmallFile, HasAboutAKilobyte) {
  EXPECT_LE(file_.size(), 1500u);
  EXPECT_LE(memory_of(Part::superblock, [](Bytes&) {}), 1u << 20);
}

TEST_F(HostileSmallFile, CannotClaimManyPoints) {
  for (const std::uint64_t points : {2ull, 65536ull, 1ull << 32, (1ull << 48) - 1})
    for (const std::uint64_t chunk : {64, 65536})
      for (const std::uint64_t page : {1, 256, 1 << 24})
        EXPECT_LE(memory_of(Part::metadata, in_metadata([&](json& document) {
                              document["resolution_counts"] = {points};
                              document["points_per_chunk"] = {chunk};
                              document["rows_per_directory_page"] = page;
                            })),
                  few_megabytes);
}

TEST_F(HostileSmallFile, CannotClaimManyAttributesOrColumns) {
  const auto change = [](json& document) {
    for (int i = 0; i < 400; ++i)
      document["columns"].push_back({{"kind", "later"}, {"scope", "resolution"}, {"critical", false}});
  };
  EXPECT_LE(memory_of(Part::metadata, in_metadata(change)), few_megabytes);
}

TEST_F(HostileSmallFile, CannotHideAMountainInItsMetadata) {
  for (const std::string piece : {"[],", "{},", "{\"\":0},", "0,", "\"\","}) {
    for (const std::size_t bytes_of_text : {10'000u, 60'000u, 120'000u, 300'000u}) {
      const auto bomb = [&](Bytes& bytes) {
        json document = json::parse(text_of(bytes));
        std::string list = "[";
        while (list.size() < bytes_of_text) list += piece;
        list.back() = ']';
        std::string text = document.dump();
        bytes = bytes_of(text.insert(1, "\"later\":" + list + ","));
      };
      EXPECT_LE(memory_of(Part::metadata, bomb), few_megabytes) << piece << bytes_of_text;
    }
  }
}

TEST(Hostile, APageOfTheMostNodesTakesFewMegabytes) {
  // With 64 resolutions and 16 size bounds, a node needs the most memory. A mask of 0 makes every node a leaf.
  const NodeShape shape{64, 16, 0};
  Bytes structure;
  for (std::uint32_t node = 0; node < max_page_nodes; ++node) {
    structure.insert(structure.end(), {std::byte{0}, std::byte{0}, std::byte{63}});
    structure.insert(structure.end(), 64 + 16, std::byte{1});
    if (node % 8 == 0) structure.back() = static_cast<std::byte>(node * node / 64);  // else the ratio of R7 forbids it
  }
  const Bytes packed = pack(structure);
  Bytes page;
  append_record(page, static_cast<std::uint32_t>(max_page_nodes));
  append_record(page, std::uint32_t{0});
  append_record(page, IndexPagePart{static_cast<std::uint32_t>(packed.size()),
                                    static_cast<std::uint32_t>(structure.size()), hash_bytes(packed)});
  const std::uint64_t hash = hash_bytes(page);
  page.insert(page.end(), packed.begin(), packed.end());
  const auto bytes = static_cast<std::uint32_t>(page.size());
  EXPECT_LE(bytes, 4096u);

  start_counting_allocations();
  EXPECT_TRUE(unpack_index_page({0, bytes, bytes, hash}, page, shape, max_page_nodes, 0, "test"));
  EXPECT_LE(most_bytes_allocated(), 8u << 20);
  EXPECT_GE(most_bytes_allocated(), 4u << 20);
}

struct HostileTree : testing::Test {
  HostileTree() : parts_(test_volume_bytes(volume_of(700, 1))) {}

  Dissected parts_;
};

TEST(Hostile, PagesThatAreLinkedToTwiceAreRefused) {
  // All octants of a lattice of points have the same counts, so that a link to one fits the others. A chain of such
  // pages has exponentially many paths.
  std::vector<dvec3> lattice;
  for (int i = 0; i < 512; ++i) lattice.push_back((dvec3(i & 7, i >> 3 & 7, i >> 6) + 0.5) / 8.0);
  const Dissected parts(test_volume_bytes(make_test_volume(lattice, {}, {.node_points = 1})));
  const std::size_t root = parts.count(Part::structure) - 1;
  ASSERT_GE(parts.links(root).size(), 2u);
  const Outcome outcome = explore(parts, Part::structure, root, [&](Bytes& bytes) {
    for (const std::size_t link : parts.links(root))
      std::copy_n(bytes.data() + parts.links(root)[0], sizeof(IndexPageRef), bytes.data() + link);
  });
  EXPECT_TRUE(outcome.opened);
  EXPECT_THAT(outcome.message, HasSubstr("[R16]"));
}

TEST_F(HostileTree, ALeafThatClaimsMorePointsIsRefused) {
  const std::size_t root = parts_.count(Part::structure) - 1;
  const Outcome outcome = explore(parts_, Part::structure, root, [](Bytes& bytes) { bytes[3] ^= std::byte{1}; });
  EXPECT_FALSE(outcome.verified);
  EXPECT_THAT(outcome.message, HasSubstr("[R14]"));
}

TEST_F(HostileTree, WrongHistogramsAreRefused) {
  const Outcome outcome = explore(parts_, Part::histograms, 0, [](Bytes& bytes) { bytes[8] ^= std::byte{1}; });
  EXPECT_TRUE(outcome.opened);
  EXPECT_THAT(outcome.message, HasSubstr("histogram"));
}

TEST_F(HostileTree, HistogramsAreCheckedBinByBin) {
  const Outcome outcome = explore(parts_, Part::histograms, 0, [](Bytes& bytes) {
    std::vector<std::uint64_t> bins(64);
    std::memcpy(bins.data(), bytes.data(), bytes.size());
    const auto from = std::ranges::find_if(bins, [](std::uint64_t count) { return count > 0; });
    --*from;
    ++*(from + 1);
    std::memcpy(bytes.data(), bins.data(), bytes.size());
  });
  EXPECT_TRUE(outcome.opened);
  EXPECT_THAT(outcome.message, HasSubstr("histogram"));
}

TEST_F(HostileTree, ErrorsBeyondThoseOfTheMetadataAreRefused) {
  const Outcome outcome =
      explore(parts_, Part::metadata, 0, in_metadata([](json& document) { document["position_error"] = 1e-9; }));
  EXPECT_TRUE(outcome.opened);
  EXPECT_THAT(outcome.message, HasSubstr("larger error than the metadata"));
}

// --- Numbers that would make a reader draw nonsense.

struct HostileNumbers : HostileTree {
  // Returns the message after a change to the header of each chunk of a kind in turn. It is the same for all of them.
  template <class Header>
  std::string message(ColumnKind kind, const std::function<void(Header&)>& change) {
    std::string message = "none";
    for (const std::size_t chunk : chunks_of(kind)) {
      const Outcome outcome = explore(parts_, Part::chunk, chunk, [&](Bytes& bytes) {
        auto header = read_record<Header>(bytes, 0);
        change(header);
        std::memcpy(bytes.data(), &header, sizeof(header));
      });
      EXPECT_TRUE(outcome.opened);
      message = outcome.message.substr(outcome.message.rfind(':') + 1);
      if (outcome.verified) return "accepted";
    }
    return message;
  }

  // Returns the message after a change to the directory's first entry of a kind.
  std::string entry_message(ColumnKind kind, const std::function<void(ChunkEntry&)>& change) {
    return explore(parts_, Part::directory_page, 0,
                   [&](Bytes& page) {
                     const std::size_t at = sizeof(std::uint64_t) + chunks_of(kind).front() * sizeof(ChunkEntry);
                     auto entry = read_record<ChunkEntry>(page, at);
                     change(entry);
                     std::memcpy(page.data() + at, &entry, sizeof(entry));
                   })
        .message;
  }

  // Numbers of the chunks of a kind.
  std::vector<std::size_t> chunks_of(ColumnKind kind) const {
    const auto volume = Volume::open(memory_source(parts_.assemble(leave_alone), "whole")).value();
    std::vector<std::size_t> chunks;
    std::size_t chunk = 0;
    for (std::uint64_t row = 0; row < volume->rows().row_count(); ++row)
      for (const int column : volume->rows().columns_of_row(row)) {
        if (volume->info().columns[static_cast<std::size_t>(column)].kind == kind) chunks.push_back(chunk);
        ++chunk;
      }
    return chunks;
  }
};

constexpr double infinite = std::numeric_limits<double>::infinity();

TEST_F(HostileNumbers, PositionsAreInTheCube) {
  using Header = PositionHeader;
  EXPECT_EQ(message<Header>(ColumnKind::position, [](Header&) {}), "accepted");
  for (const double away : {1.1, -1.1, 1e30, -1e300, infinite, std::nan("")})
    EXPECT_THAT(message<Header>(ColumnKind::position, [&](Header& h) { h.origin[1] += away; }), HasSubstr("[R17]"));
  // A large error does not make room for them.
  EXPECT_THAT(message<Header>(ColumnKind::position, [&](Header& h) { h.origin[1] = h.error = 1e30; }),
              HasSubstr("[R17]"));
  EXPECT_THAT(message<Header>(ColumnKind::position, [&](Header& h) { h.quantisation_step = 1e30; }),
              HasSubstr("[R17]"));
}

TEST_F(HostileNumbers, CentroidsAreNearTheCube) {
  using Header = PositionHeader;
  for (const double away : {2.1, -2.1, 1e30, -1e300})
    EXPECT_THAT(message<Header>(ColumnKind::centroid, [&](Header& h) { h.origin[2] += away; }), HasSubstr("[R17]"));
}

TEST_F(HostileNumbers, MaterialIsNoLargerThanTheCube) {
  using Header = MomentsHeader;
  for (const double scale : {1.01, 1e30, 1e308})
    EXPECT_THAT(message<Header>(ColumnKind::moments, [&](Header& h) { h.deviation_scale = scale; }),
                HasSubstr("[R17]"));
  for (const double scale : {1e20, 1e308, infinite})
    EXPECT_THAT(message<Header>(ColumnKind::moments, [&](Header& h) { h.mass_scale = scale; }), HasSubstr("[R17]"));
}

TEST_F(HostileNumbers, DeviationsOfValuesFitTheirRange) {
  using Header = ValueMomentsHeader;
  for (const double scale : {1e3, 1e30, 1e308}) {
    EXPECT_THAT(message<Header>(ColumnKind::value_moments, [&](Header& h) { h.deviation_scale = scale; }),
                HasSubstr("[R17]"));
    EXPECT_THAT(message<Header>(ColumnKind::value_moments, [&](Header& h) { h.least_step = scale; }),
                HasSubstr("[R17]"));
  }
}

TEST_F(HostileNumbers, RangesAreRanges) {
  constexpr float not_a_number = std::numeric_limits<float>::quiet_NaN();
  constexpr float no_end = std::numeric_limits<float>::infinity();
  for (const ColumnKind kind : {ColumnKind::value, ColumnKind::value_moments}) {
    EXPECT_THAT(entry_message(kind, [](ChunkEntry& e) { e.min = not_a_number; }), HasSubstr("[R10]"));
    EXPECT_THAT(entry_message(kind, [](ChunkEntry& e) { e.max = not_a_number; }), HasSubstr("[R10]"));
    EXPECT_THAT(entry_message(kind, [](ChunkEntry& e) { e.max = no_end; }), HasSubstr("[R10]"));
    EXPECT_THAT(entry_message(kind, [](ChunkEntry& e) { e.min = -no_end; }), HasSubstr("[R10]"));
    EXPECT_THAT(entry_message(kind, [](ChunkEntry& e) { e.max = 3e38F; }), HasSubstr("[R10]"));
    EXPECT_THAT(entry_message(kind, [](ChunkEntry& e) { std::swap(e.min, e.max); }), HasSubstr("[R10]"));
  }
  for (const float bad : {not_a_number, -no_end, 3e38F})
    EXPECT_THAT(
        explore(parts_, Part::summary, 0, [&](Bytes& bytes) { std::memcpy(bytes.data(), &bad, sizeof(bad)); }).message,
        HasSubstr("[R13]"));
}

TEST_F(HostileTree, ValuesOutsideOfTheirRangeAreRefused) {
  for (std::size_t chunk = 0; chunk < parts_.count(Part::chunk); ++chunk) {
    bool is_values = false;
    const Outcome outcome = explore(parts_, Part::chunk, chunk, [&](Bytes& bytes) {
      is_values = bytes.size() % 4 == 0 && bytes.size() == 256;
      if (is_values) bytes[200] ^= std::byte{0x40};
    });
    EXPECT_EQ(outcome.verified, !is_values) << outcome.message;
  }
}

TEST_F(HostileTree, NothingIsLargerPackedThanUnpacked) {
  const Outcome chunk = explore(parts_, Part::directory_page, 0, [](Bytes& page) {
    auto entry = read_record<ChunkEntry>(page, sizeof(std::uint64_t));
    entry.unpacked_bytes = entry.packed_bytes - 1;
    std::memcpy(page.data() + sizeof(std::uint64_t), &entry, sizeof(entry));
  });
  EXPECT_THAT(chunk.message, HasSubstr("[R10]"));
  const Outcome structure = explore(parts_, Part::index_table, parts_.count(Part::structure) - 1, [](Bytes& table) {
    auto part = read_record<IndexPagePart>(table, 2 * sizeof(std::uint32_t));
    part.unpacked_bytes = part.packed_bytes - 1;
    std::memcpy(table.data() + 2 * sizeof(std::uint32_t), &part, sizeof(part));
  });
  EXPECT_THAT(structure.message, HasSubstr("[R13]"));
}

TEST_F(HostileTree, PointsOutsideOfTheCubeAreRefused) {
  const Outcome outcome =
      explore(parts_, Part::metadata, 0, in_metadata([](json& document) { document["cube"]["edge"] = 0.5; }));
  EXPECT_TRUE(outcome.opened);
  EXPECT_THAT(outcome.message, HasSubstr("outside of the cube"));
}

// --- The superblock and the section table, rule by rule.

Outcome with_section(const Dissected& parts, SectionKind kind, const std::function<void(SectionEntry&)>& change) {
  return explore(parts, Part::section_table, 0, [&](Bytes& table) {
    for (std::size_t at = 0; at < table.size(); at += sizeof(SectionEntry)) {
      auto entry = read_record<SectionEntry>(table, at);
      if (entry.kind != kind) continue;
      change(entry);
      std::memcpy(table.data() + at, &entry, sizeof(entry));
      return;
    }
  });
}

TEST_F(HostileTree, SectionsFollowTheirRules) {
  const auto message = [&](SectionKind kind, const std::function<void(SectionEntry&)>& change) {
    return with_section(parts_, kind, change).message;
  };
  EXPECT_EQ(message(SectionKind::rows, [](SectionEntry&) {}), "");
  EXPECT_THAT(message(SectionKind::rows, [](SectionEntry& s) { ++s.offset; }), HasSubstr("[R6]"));
  EXPECT_THAT(message(SectionKind::rows, [](SectionEntry& s) { s.packed_bytes = ~0ull; }), HasSubstr("[R6]"));
  EXPECT_THAT(message(SectionKind::rows, [](SectionEntry& s) { s.kind = SectionKind{99}; }), HasSubstr("[R5]"));
  EXPECT_THAT(message(SectionKind::rows, [](SectionEntry& s) { s.kind = SectionKind::metadata; }), HasSubstr("[R"));
  EXPECT_THAT(
      message(SectionKind::histograms, [](SectionEntry& s) { s.kind = SectionKind::rows, s.codec = Codec::extent; }),
      HasSubstr("[R8]"));
  for (const SectionKind kind : {SectionKind::metadata, SectionKind::directory_root, SectionKind::histograms})
    EXPECT_THAT(message(kind, [](SectionEntry& s) { s.codec = Codec::extent; }), HasSubstr("[R7]"));
  for (const SectionKind kind :
       {SectionKind::index_root, SectionKind::rows, SectionKind::index_pages, SectionKind::directory_pages})
    EXPECT_THAT(message(kind, [](SectionEntry& s) { s.codec = Codec::raw; }), HasSubstr("[R7]"));
  EXPECT_THAT(message(SectionKind::histograms, [](SectionEntry& s) { s.codec = Codec{3}; }), HasSubstr("[R7]"));
  EXPECT_THAT(message(SectionKind::metadata, [](SectionEntry& s) { s.unpacked_bytes = 1ull << 40; }),
              HasSubstr("[R7]"));
  EXPECT_THAT(message(SectionKind::histograms, [](SectionEntry& s) { s.unpacked_bytes = 1ull << 40; }),
              HasSubstr("histograms"));
  EXPECT_THAT(message(SectionKind::histograms, [](SectionEntry& s) { s.hash ^= 1; }), HasSubstr("checksum"));
}

TEST_F(HostileTree, UnknownOptionalSectionsAreSkippedButChecked) {
  EXPECT_EQ(with_section(parts_, SectionKind::histograms, [](SectionEntry& s) { s.kind = SectionKind{99}; }).message,
            "");
  EXPECT_THAT(
      with_section(parts_, SectionKind::histograms, [](SectionEntry& s) { s.kind = SectionKind{99}, s.hash ^= 1; })
          .message,
      HasSubstr("checksum"));
  // No check would cover bytes without a hash.
  EXPECT_THAT(with_section(parts_, SectionKind::histograms,
                           [](SectionEntry& s) { s.kind = SectionKind{99}, s.codec = Codec::extent; })
                  .message,
              HasSubstr("[R7]"));
}

TEST_F(HostileTree, TheSuperblockFollowsItsRules) {
  const auto message = [&](auto change) {
    return explore(parts_, Part::superblock, 0,
                   [&](Bytes& bytes) {
                     Superblock superblock{};
                     std::memcpy(&superblock, bytes.data(), bytes.size());
                     change(superblock);
                     std::memcpy(bytes.data(), &superblock, bytes.size());
                   })
        .message;
  };
  EXPECT_EQ(message([](Superblock&) {}), "");
  EXPECT_EQ(message([](Superblock& s) { s.minor_version = 7; }), "");
  EXPECT_EQ(message([](Superblock& s) { s.reserved0 = 7; }), "");
  EXPECT_THAT(message([](Superblock& s) { s.magic[0] = 0; }), HasSubstr("not a .svol file"));
  EXPECT_THAT(message([](Superblock& s) { s.major_version = 2; }), HasSubstr("2.0"));
  EXPECT_THAT(message([](Superblock& s) { s.major_version = 0; }), HasSubstr("0.0"));
  EXPECT_THAT(message([](Superblock& s) { s.critical_features = 4; }), HasSubstr("feature"));
  EXPECT_THAT(message([](Superblock& s) { ++s.file_bytes; }), HasSubstr("[R2]"));
  EXPECT_THAT(message([](Superblock& s) { s.section_count = 0; }), HasSubstr("[R3]"));
  EXPECT_THAT(message([](Superblock& s) { s.section_count = 65; }), HasSubstr("[R3]"));
  EXPECT_THAT(message([](Superblock& s) { s.preamble_bytes = 100; }), HasSubstr("[R1]"));
  EXPECT_THAT(message([](Superblock& s) { s.preamble_bytes = 64 + 48 * s.section_count; }), HasSubstr("[R1]"));
  EXPECT_THAT(message([](Superblock& s) { s.preamble_bytes = s.file_bytes + 1; }), HasSubstr("[R1]"));
  EXPECT_THAT(message([](Superblock& s) { s.preamble_bytes = ~0ull; }), HasSubstr("[R1]"));
  EXPECT_THAT(message([](Superblock& s) { s.section_table_hash ^= 1; }), HasSubstr("[R4]"));
}

}  // namespace
}  // namespace splatvol::test
