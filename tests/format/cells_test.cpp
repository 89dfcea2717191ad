#include "format/cells.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <random>

#include "base/file.h"
#include "format/cell_reader.h"
#include "format/ranked_points.h"
#include "format/volume.h"
#include "tests/format/allocation_counter.h"
#include "tests/support/explorer.h"
#include "tests/support/memory_source.h"
#include "tests/support/opened_files.h"
#include "tests/support/results.h"
#include "tests/support/sanitizers.h"
#include "tests/support/surgery.h"
#include "tests/support/test_volume.h"
#include "tests/support/volume_bytes.h"
#include "tests/support/volume_dump.h"

namespace splatvol::test {
namespace {

using namespace format;
using ::testing::HasSubstr;

constexpr auto tetrahedron = CellShape::tetrahedron;
constexpr std::uint64_t end_of_ranks = (std::uint64_t{1} << 48) - 1;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

CellChunk chunk_of(std::vector<std::uint64_t> corners) {
  return {tetrahedron, CellField::corners, std::move(corners), {}, {}};
}

// Tetrahedra whose corners are numbered already.
struct Local {
  CellChunk chunk;
  LocalCells cells;

  explicit Local(std::span<const std::uint32_t> corners)
      : chunk(chunk_of({corners.begin(), corners.end()})), cells{{}, {corners.begin(), corners.end()}} {}
  [[nodiscard]] CellExtent measure(std::span<const dvec3> positions) const {
    return measure_cells(chunk, cells, positions);
  }
  [[nodiscard]] ValueSummary summarize(std::span<const float> values, const ValueBins& bins) const {
    return summarize_cells(chunk, cells, values, bins);
  }
};

// --- Cells to and from bytes.

void expect_back(const std::vector<std::uint64_t>& corners, std::uint64_t points) {
  const PackedCells packed = pack_cells(chunk_of(corners), 4);
  EXPECT_EQ(packed.entry.cells, corners.size() / 4);
  EXPECT_EQ(packed.entry.packed_bytes, packed.bytes.size());
  EXPECT_EQ(value_of(unpack_cells(packed.entry, packed.bytes, points, 0, "cells")).corners, corners);
  EXPECT_THAT(test::message_of(unpack_cells(packed.entry, packed.bytes, std::ranges::max(corners), 0, "cells")),
              HasSubstr("a corner that is not there [R24]"));
}

TEST(PackedCells, OneComesBack) {
  expect_back({0, 1, 2, 3}, 4);
  expect_back({7, 900, 70'000, 20'000'000}, 20'000'001);
  expect_back({end_of_ranks - 4, end_of_ranks - 3, end_of_ranks - 2, end_of_ranks - 1}, end_of_ranks);
  expect_back({0, 1, 2, end_of_ranks - 1}, end_of_ranks);
}

TEST(PackedCells, AsManyAsAChunkMayHaveComeBack) {
  std::mt19937_64 random(3);
  std::vector<std::uint64_t> corners;
  std::uint64_t first = 1000;
  for (std::size_t cell = 0; cell < max_chunk_cells; ++cell) {
    first += random() % 3;
    std::uint64_t corner = first;
    for (int k = 0; k < 4; ++k, corner += 1 + random() % 5000) corners.push_back(corner);
  }
  expect_back(corners, std::ranges::max(corners) + 1);
}

// Columns of each width: one byte up to six, and none where all differences are 0.
TEST(PackedCells, DifferencesOfEachWidthComeBack) {
  for (int width = 0; width <= 5; ++width)
    for (std::size_t column = 0; column < 4; ++column) {
      const std::uint64_t large = width == 0 ? 0 : (std::uint64_t{1} << 8 * width) - 1;
      std::vector<std::uint64_t> corners = {5, 6, 7, 8};
      std::uint64_t corner = 5;
      for (std::size_t k = 0; k < 4; ++k, ++corner) corners.push_back(corner += k == column ? large : 0);
      expect_back(corners, std::ranges::max(corners) + 1);
      const PackedCells packed = pack_cells(chunk_of(corners), 4);
      EXPECT_EQ(packed.entry.unpacked_bytes, 16 + 2 * static_cast<std::size_t>(width)) << width << ' ' << column;
    }
  const std::uint64_t half = std::uint64_t{1} << 47;  // six bytes
  expect_back({1, 2, 3, 4, half, half + 1, half + 2, half + 3}, end_of_ranks);
}

TEST(PackedCells, OfOtherLengthsAreRefused) {
  const std::vector<std::uint64_t> corners = {1, 2, 3, 4, 1, 2, 4, 900};
  const PackedCells packed = pack_cells(chunk_of(corners), 5);
  Bytes payload = value_of(unpack(packed.bytes, packed.entry.unpacked_bytes, "cells"));
  const auto message = [&](const Bytes& changed, std::uint32_t cells) {
    const PackedCells with = repacked(packed, changed, cells);
    return test::message_of(unpack_cells(with.entry, with.bytes, 1000, 0, "cells"));
  };
  EXPECT_EQ(message(payload, 2), "");
  for (const std::uint32_t cells : {1u, 3u, 65536u}) EXPECT_THAT(message(payload, cells), HasSubstr("[R24]"));
  for (std::size_t bytes = 0; bytes < payload.size(); ++bytes)
    EXPECT_THAT(message(Bytes(payload.begin(), payload.begin() + static_cast<std::ptrdiff_t>(bytes)), 2),
                HasSubstr("[R24]"));
  Bytes longer = payload;
  longer.push_back({});
  EXPECT_THAT(message(longer, 2), HasSubstr("[R24]"));
  for (std::size_t width = 8; width < 16; ++width) {
    Bytes wider = payload;
    wider[width] = std::byte{7};
    EXPECT_THAT(message(wider, 2), HasSubstr("[R24]")) << width;
  }
  // A column of a fifth corner, with bytes for it.
  Bytes fifth = payload;
  fifth[12] = std::byte{1};
  fifth.resize(payload.size() + 2);
  EXPECT_THAT(message(fifth, 2), HasSubstr("[R24]"));
}

TEST(NumberCorners, AreTheRanksInOrder) {
  EXPECT_TRUE(number_corners({}).ranks.empty());
  std::mt19937_64 random(7);
  for (const std::uint64_t spread : {1ull, 9ull, 5000ull, 1ull << 30, 1ull << 47}) {
    std::vector<std::uint64_t> corners;
    for (int i = 0; i < 4000; ++i) corners.push_back(12345 + random() % spread);
    std::map<std::uint64_t, std::uint32_t> numbers;
    for (const std::uint64_t corner : corners) numbers[corner] = 0;
    std::uint32_t next = 0;
    for (auto& [rank, number] : numbers) number = next++;
    const LocalCells local = number_corners(corners);
    ASSERT_EQ(local.ranks.size(), numbers.size());
    ASSERT_EQ(local.corners.size(), corners.size());
    EXPECT_TRUE(std::ranges::is_sorted(local.ranks));
    for (std::size_t i = 0; i < corners.size(); ++i) {
      EXPECT_EQ(local.corners[i], numbers[corners[i]]);
      EXPECT_EQ(local.ranks[local.corners[i]], corners[i]);
    }
  }
}

TEST(MeasureCells, HasBoxAndAreaOfAllFaces) {
  const std::vector<dvec3> positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, -2}};
  const std::uint32_t one[] = {0, 1, 2, 3};
  const CellExtent unit = Local(one).measure(std::span(positions).first(4));
  EXPECT_EQ(unit.box.low, dvec3(0));
  EXPECT_EQ(unit.box.high, dvec3(1));
  EXPECT_NEAR(unit.area, 1.5 + std::numbers::sqrt3 / 2, 1e-15);
  // The face between both counts twice.
  const std::uint32_t two[] = {0, 1, 2, 3, 0, 1, 2, 4};
  const CellExtent both = Local(two).measure(positions);
  EXPECT_EQ(both.box.low, dvec3(0, 0, -2));
  EXPECT_NEAR(both.area, unit.area + 0.5 + 1 + 1 + 1.5, 1e-15);
  const std::vector<dvec3> flat = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
  EXPECT_NEAR(Local(one).measure(flat).area, 2, 1e-15);
  const std::vector<dvec3> point(4, dvec3(1, 2, 3));
  EXPECT_EQ(Local(one).measure(point).area, 0);
}

TEST(SummarizeCells, HasBinsBetweenCorners) {
  const ValueBins bins{0, 64};
  const std::uint32_t corners[] = {0, 1, 2, 3, 0, 1, 2, 4, 1, 2, 3, 5};
  const float none = std::nanf("");
  const float values[] = {2.5f, 3.5f, 8.5f, 4.5f, none, 60.5f};
  // Bins 2 to 8, and 3 to 60; the second cell lacks a value.
  const ValueSummary all = Local(corners).summarize(values, bins);
  EXPECT_EQ(all.min, 2.5f);
  EXPECT_EQ(all.max, 60.5f);
  EXPECT_EQ(all.occupancy, ((std::uint64_t{1} << 61) - 1) & ~std::uint64_t{3});
  const ValueSummary first = Local(std::span(corners).first(8)).summarize(values, bins);
  EXPECT_EQ(first.max, 8.5f);
  EXPECT_EQ(first.occupancy, 0b1'1111'1100u);
  const ValueSummary missing = Local(std::span(corners).subspan(4, 4)).summarize(values, bins);
  EXPECT_GT(missing.min, missing.max);
  EXPECT_EQ(missing.occupancy, 0u);
  EXPECT_TRUE(missing.is_valid());
}

// --- Pages of ranks.

struct RankPages : testing::Test {
  // Returns the page that comes back, or its message.
  std::string change(const std::function<void(RankPage&)>& change, std::uint64_t first = 10) const {
    RankPage page = page_;
    change(page);
    PackedPageRef ref{};
    const Bytes packed = pack_rank_page(page, ref);
    const auto back = unpack_rank_page(ref, packed, first, page_.segments.size(), counts_, "ranks");
    if (!back) return back.error().message;
    EXPECT_EQ(back->first, first);
    EXPECT_EQ(back->before, page.before);
    EXPECT_EQ(back->segments, page.segments);
    return "";
  }

  const std::vector<std::uint64_t> counts_ = {3, 4, 9};
  const RankPage page_{10, {2, 2, 6}, {2, 0, 1, 2, 1, 2}};
};

TEST_F(RankPages, ComeBack) {
  EXPECT_EQ(change([](RankPage&) {}), "");
}

TEST_F(RankPages, HaveTheCountsOfTheSegments) {
  const auto refused = HasSubstr("its counts are not those of the points [R24]");
  EXPECT_THAT(change([](RankPage&) {}, 11), refused);
  EXPECT_THAT(change([](RankPage& page) { page.before = {2, 3, 5}, page.segments[0] = 1; }), refused);
  EXPECT_THAT(change([](RankPage& page) { page.before = {4, 0, 6}; }), refused);
  EXPECT_THAT(change([](RankPage& page) { page.before = {~std::uint64_t{0}, 2, 9}; }), refused);
  EXPECT_THAT(change([](RankPage& page) { page.segments[0] = 0; }), refused);
  EXPECT_THAT(change([](RankPage& page) { page.segments[0] = 3; }), refused);
  EXPECT_THAT(change([](RankPage& page) { page.segments.pop_back(); }), refused);
  EXPECT_THAT(change([](RankPage& page) { page.segments.push_back(2); }), refused);
  EXPECT_THAT(change([](RankPage& page) { page.before.push_back(0); }), refused);
}

// --- Files.

Result<std::shared_ptr<const Volume>> open(const Bytes& bytes) { return Volume::open(memory_source(bytes, "a.svol")); }

TestVolume plain_volume(std::size_t attributes = 2) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<std::vector<double>> values(attributes, std::vector<double>(300));
  for (auto& column : values)
    for (double& value : column) value = uniform(random) < -0.9 ? nan : uniform(random);
  return make_test_volume(random_points(300, 3), values, {.node_points = 25, .position_error = 1e-5});
}

TestVolume volume_with_cells(std::size_t cells = 200, std::size_t attributes = 2) {
  TestVolume volume = plain_volume(attributes);
  add_random_cells(volume, cells);
  volume.cells->turned = 3;
  return volume;
}

std::vector<std::uint64_t> all_corners(const CellReader& cells) {
  std::vector<std::uint64_t> all;
  for (const CellChunk& chunk : chunks_of(cells)) all.insert(all.end(), chunk.corners.begin(), chunk.corners.end());
  return all;
}

TEST(CellsOfAFile, ComeBack) {
  const TestVolume volume = volume_with_cells();
  const Bytes file = test_volume_bytes(volume);
  ASSERT_EQ(error_of(file), "");
  EXPECT_EQ(error_of(file, 3), "");
  EXPECT_EQ(read_record<Superblock>(file, 0).minor_version, 2);
  const auto opened = open(file).value();
  EXPECT_TRUE(CellReader::has_cells(*opened));
  EXPECT_EQ(opened->info().cells->hash, 0x0123456789abcdefu);
  const auto cells = value_of(CellReader::open(*opened));
  ASSERT_EQ(cells->kinds().size(), 1u);
  EXPECT_EQ(cells->kinds()[0].cells, 200u);
  EXPECT_EQ(cells->kinds()[0].turned, 3u);
  EXPECT_EQ(cells->chunk_count(), 13u);
  EXPECT_EQ(cells->pages().size(), 4u);
  EXPECT_EQ(cells->kinds()[0].packed_bytes + cells->directory_bytes() + cells->rank_bytes(), cells->section_bytes());
  std::vector<std::uint64_t> expected;
  for (const auto& cell : volume.cells->corners) expected.insert(expected.end(), cell.begin(), cell.end());
  EXPECT_EQ(all_corners(*cells), expected);
}

TEST(CellsOfAFile, RanksNameTheirPoints) {
  const TestVolume volume = volume_with_cells();
  const Bytes file = test_volume_bytes(volume);
  const auto opened = open(file).value();
  const auto cells = value_of(CellReader::open(*opened));
  const std::vector<std::uint64_t> ranks = ranks_of(volume);
  // A memory of nothing holds one group at a time.
  for (const std::uint64_t memory : {0, 1 << 20}) {
    RankedPoints points(*cells, own_room(memory));
    std::vector<RankedPoints::Place> places;
    std::vector<dvec3> positions;
    std::vector<float> values;
    ASSERT_TRUE(points.find(ranks, places));
    ASSERT_TRUE(points.read_positions(places, positions));
    ASSERT_TRUE(points.read_values(places, 1, values));
    ASSERT_EQ(positions.size(), volume.positions.size());
    for (std::size_t i = 0; i < ranks.size(); ++i) {
      EXPECT_LE(glm::length(positions[i] - volume.positions[i]), 2e-5);
      EXPECT_TRUE(values[i] == volume.stored[1][i] || (std::isnan(values[i]) && std::isnan(volume.stored[1][i])));
    }
  }
}

// What a reader sees does not depend on how bytes are packed.
TEST(CellsOfAFile, AreInADump) {
  const Bytes file = test_volume_bytes(volume_with_cells());
  const auto dump_of = [](const Bytes& bytes) { return value_of(dump_volume(*open(bytes).value(), true)); };
  const std::string dump = dump_of(file);
  EXPECT_THAT(dump, HasSubstr("kind: tetrahedron, corners, 200 cells, 3 turned"));
  EXPECT_EQ(dump_of(Dissected(file).assemble([](Part, std::size_t, Bytes&) {}, Packing::raw)), dump);
  const Bytes other = Dissected(file).assemble([](Part part, std::size_t i, Bytes& bytes) {
    if (part == Part::cells && i == 2) bytes.back() ^= std::byte{1};
  });
  EXPECT_NE(dump_of(other), dump);
}

TEST(CellsOfAFile, MayBeNone) {
  TestVolume volume = plain_volume();
  add_cells(volume, {});
  const Bytes file = test_volume_bytes(volume);
  EXPECT_EQ(error_of(file), "");
  const auto opened = open(file).value();
  const auto cells = value_of(CellReader::open(*opened));
  EXPECT_TRUE(cells->kinds().empty());
  EXPECT_EQ(cells->chunk_count(), 0u);
  EXPECT_EQ(cells->rank_page_count(), 1u);
}

TEST(CellsOfAFile, FilesWithoutThemAreAsBefore) {
  const Bytes file = test_volume_bytes(plain_volume());
  EXPECT_EQ(read_record<Superblock>(file, 0).minor_version, 0);
  const auto opened = open(file).value();
  EXPECT_FALSE(CellReader::has_cells(*opened));
  EXPECT_EQ(value_of(CellReader::open(*opened)), nullptr);
}

TEST(CellsOfAFile, MustBeDescribed) {
  TestVolume undescribed = volume_with_cells(), absent = plain_volume();
  undescribed.info.cells.reset();
  absent.info.cells = CellsInfo{1};
  EXPECT_TRUE(test_volume_bytes(undescribed).empty());
  EXPECT_TRUE(test_volume_bytes(absent).empty());
}

TEST(CellsOfAFile, AreReadOnDemandOnly) {
  TestVolume volume = volume_with_cells(60'000);
  const Bytes file = test_volume_bytes(volume);
  const auto opened = open(file).value();
  const std::uint64_t before = opened->bytes_read();
  const auto cells = value_of(CellReader::open(*opened));
  ASSERT_GT(cells->section_bytes(), 200'000u);
  EXPECT_LE(opened->bytes_read() - before, std::max<std::uint64_t>(65536, cells->directory_bytes()));
  EXPECT_EQ(cells->kinds()[0].cells, 60'000u);
}

// An attribute may have no column of values (spec 8).
TEST(CellsOfAFile, AttributesMayLackValues) {
  TestVolume volume = volume_with_cells();
  std::erase_if(volume.info.columns, [](const Column& column) { return column.attribute == 1; });
  const Bytes file = test_volume_bytes(volume);
  ASSERT_FALSE(file.empty());
  const auto opened = open(file).value();
  const auto cells = value_of(CellReader::open(*opened));
  RankedPoints points(*cells, own_room(1 << 20));
  const std::uint64_t rank = 3;
  std::vector<RankedPoints::Place> places;
  std::vector<float> values;
  ASSERT_TRUE(points.find({&rank, 1}, places));
  EXPECT_THAT(test::message_of(points.read_values(places, 1, values)), HasSubstr("attribute 1 has no values"));
  EXPECT_EQ(error_of(file), "");
}

// A reader of version 1.1 knows neither the section nor its line in the metadata.
TEST(CellsOfAFile, AreNothingToReadersThatDoNotKnowThem) {
  const Bytes file =
      Dissected(test_volume_bytes(volume_with_cells())).assemble([](Part part, std::size_t, Bytes& bytes) {
        if (part == Part::metadata) replacing("\"cells\"", "\"later_thing\"")(bytes);
        for (std::size_t at = 0; part == Part::section_table && at < bytes.size(); at += sizeof(SectionEntry)) {
          auto section = read_record<SectionEntry>(bytes, at);
          if (section.kind == SectionKind::cells) section.kind = static_cast<SectionKind>(200);
          std::memcpy(bytes.data() + at, &section, sizeof(section));
        }
      });
  EXPECT_EQ(error_of(file), "");
  const auto opened = open(file);
  ASSERT_TRUE(opened);
  EXPECT_FALSE(CellReader::has_cells(**opened));
  EXPECT_TRUE(explore_volume(**opened).all_read);
}

// --- Damage. Hashes are right in all of these, but where a test says so.

struct DamagedCells : testing::Test {
  [[nodiscard]] Bytes harmed(Part part, std::size_t index, const std::function<void(Bytes&)>& harm) const {
    return parts_.harmed(part, index, harm);
  }

  // The message of the whole check: one line, and no part is read in another way.
  static std::string message_of(const Bytes& file) {
    std::string message = error_of(file);
    EXPECT_EQ(message.find('\n'), std::string::npos);
    EXPECT_EQ(error_of(file, 2).empty(), message.empty());
    if (const auto opened = open(file)) {
      EXPECT_EQ(explore_volume(**opened).broken, "");
    }
    return message;
  }

  void expect_refused(Part part, std::size_t index, const std::function<void(Bytes&)>& harm,
                      const std::string& words) const {
    EXPECT_THAT(message_of(harmed(part, index, harm)), HasSubstr(words));
  }

  // Refused before a cell is read.
  void expect_unopened(const std::function<void(Bytes&)>& harm, const std::string& words) const {
    const Bytes file = harmed(Part::cell_root, 0, harm);
    EXPECT_THAT(message_of(file), HasSubstr(words));
    const auto opened = open(file);
    ASSERT_TRUE(opened) << "who wants no cells reads none";
    EXPECT_THAT(test::message_of(CellReader::open(**opened)), HasSubstr(words));
  }

  template <class Record>
  static std::function<void(Bytes&)> edit(std::size_t offset, const std::function<void(Record&)>& change) {
    return [=](Bytes& bytes) {
      auto record = read_record<Record>(bytes, offset);
      change(record);
      std::memcpy(bytes.data() + offset, &record, sizeof(record));
    };
  }
  static std::function<void(Bytes&)> edit_entry(const std::function<void(CellChunkEntry&)>& change,
                                                std::size_t chunk = 1) {
    return edit<CellChunkEntry>(chunk * sizeof(CellChunkEntry), change);
  }
  static std::function<void(Bytes&)> edit_kind(const std::function<void(CellKind&)>& change) {
    return edit<CellKind>(0, change);
  }
  static std::function<void(Bytes&)> edit_page(const std::function<void(CellPageRef&)>& change) {
    return edit<CellPageRef>(sizeof(CellKind) + sizeof(CellPageRef), change);
  }
  [[nodiscard]] std::function<void(Bytes&)> edit_ranks(const std::function<void(PackedPageRef&)>& change) const {
    return edit<PackedPageRef>(sizeof(CellKind) + parts_.count(Part::cell_table) * sizeof(CellPageRef), change);
  }
  // The tail without its hash, which the test does not get.
  struct Tail {
    std::uint64_t chunks, pages, vertices;
    std::uint32_t kinds, version;
  };
  static std::function<void(Bytes&)> edit_tail(const std::function<void(Tail&)>& change) {
    return [=](Bytes& bytes) { edit<Tail>(bytes.size() - sizeof(Tail), change)(bytes); };
  }

  const TestVolume volume_ = volume_with_cells();
  const Bytes file_ = test_volume_bytes(volume_);
  const Dissected parts_{file_};
};

TEST_F(DamagedCells, AreWholeWhenNothingIsDone) {
  EXPECT_EQ(parts_.count(Part::rank_page), 1u);
  EXPECT_EQ(parts_.count(Part::cells), 13u);
  EXPECT_EQ(parts_.count(Part::cell_entries), 4u);
  EXPECT_EQ(parts_.count(Part::cell_summary), 8u);
  EXPECT_EQ(parts_.count(Part::cell_root), 1u);
  for (const auto packing : {Packing::zstd, Packing::raw})
    EXPECT_EQ(message_of(parts_.assemble([](Part, std::size_t, Bytes&) {}, packing)), "");
}

TEST_F(DamagedCells, MetadataFollowTheirRules) {
  expect_refused(Part::metadata, 0, replacing("\"cells\"", "\"x\""), "do not say whether it has cells [R23]");
  for (const char* hash : {"\"0123456789abcde\"", "\"0123456789abcdef0\"", "\"0123456789abcdeg\"",
                           "\"-123456789abcdef\"", "\"0x23456789abcdef\"", "\"\"", "7", "null"})
    expect_refused(Part::metadata, 0, replacing("\"0123456789abcdef\"", hash), "[R9]");
  for (const char* copies : {R"("block")", R"("place")", "7"})
    expect_refused(Part::metadata, 0, replacing("\"hash\"", fmt::format(R"("copies":{},"hash")", copies)),
                   "only a series has it [R9]");
  const Bytes plain = Dissected(test_volume_bytes(plain_volume())).assemble([](Part part, std::size_t, Bytes& bytes) {
    if (part != Part::metadata) return;
    std::string json = text_of(bytes);
    bytes = bytes_of(json.insert(1, R"("cells":{"hash":"0123456789abcdef"},)"));
  });
  EXPECT_THAT(error_of(plain), HasSubstr("do not say whether it has cells [R23]"));
}

TEST_F(DamagedCells, TheSectionIsRawAndThereOnce) {
  const auto edit_sections = [&](const std::function<void(SectionEntry&)>& change) {
    return harmed(Part::section_table, 0, [&](Bytes& table) {
      for (std::size_t at = 0; at < table.size(); at += sizeof(SectionEntry)) edit<SectionEntry>(at, change)(table);
    });
  };
  const auto pack_cells = [](SectionEntry& section) {
    if (section.kind != SectionKind::cells) return;
    section.codec = Codec::zstd;
    section.unpacked_bytes = section.packed_bytes + 1;
  };
  EXPECT_NE(message_of(edit_sections(pack_cells)), "");
  EXPECT_FALSE(open(edit_sections(pack_cells)));
  const auto twice = [](SectionEntry& section) {
    if (section.kind != SectionKind::histograms) return;
    section.kind = SectionKind::cells;
    section.codec = Codec::raw;
    section.unpacked_bytes = section.packed_bytes;
  };
  EXPECT_THAT(message_of(edit_sections(twice)), HasSubstr("cells appear twice, or in a step [R8]"));
}

TEST_F(DamagedCells, TheRootFollowsItsRules) {
  const std::string wrong_length = "the root of the cells has the wrong length [R23]";
  for (const std::uint32_t version : {cells_version - 1, cells_version + 1})
    expect_unopened(edit_tail([=](Tail& tail) { tail.version = version; }), "does not know [R23]");
  for (const std::uint64_t pages : {std::uint64_t{1} << 20, std::uint64_t{1} << 60, ~std::uint64_t{0}})
    expect_unopened(edit_tail([=](Tail& tail) { tail.pages = pages; }), wrong_length);
  expect_unopened(edit_tail([](Tail& tail) { tail.kinds = ~0u; }), wrong_length);
  expect_unopened(edit_tail([](Tail& tail) { tail.kinds = 2; }), "the root of the cells: checksum mismatch [R23]");
  expect_unopened(edit_tail([](Tail& tail) { tail.pages = 3; }), "the root of the cells: checksum mismatch [R23]");
  expect_unopened([](Bytes& root) { root.erase(root.begin(), root.begin() + 8); }, "checksum mismatch [R23]");
  for (const std::uint64_t chunks : {std::uint64_t{0}, std::uint64_t{12}, ~std::uint64_t{0}})
    expect_unopened(edit_tail([=](Tail& tail) { tail.chunks = chunks; }), "not as many as stated [R23]");
}

TEST_F(DamagedCells, PagesTileTheSection) {
  const std::string untiled = "parts of the cells do not tile their section [R23]";
  const std::string range = "a page of cells is out of range [R23]";
  expect_unopened(edit_ranks([](PackedPageRef& ref) { ref.offset = 1; }), untiled);
  expect_unopened(edit_ranks([](PackedPageRef& ref) { ref.packed_bytes = ~0u; }), untiled);
  expect_unopened(edit_ranks([](PackedPageRef& ref) { ref.unpacked_bytes = ~0u; }), "ranks has the wrong length [R23]");
  expect_unopened(edit_ranks([](PackedPageRef& ref) { ref.unpacked_bytes = ref.packed_bytes - 1; }),
                  "ranks has the wrong length [R23]");
  for (const std::uint64_t offset : {std::uint64_t{0}, std::uint64_t{1} << 40, ~std::uint64_t{0}})
    expect_unopened(edit_page([=](CellPageRef& ref) { ref.offset = offset; }), untiled);
  expect_unopened(edit_page([](CellPageRef& ref) { ref.page_bytes = ~0u; }), untiled);
  expect_unopened(edit_page([](CellPageRef& ref) { ref.page_bytes = 47; }), untiled);
  expect_unopened(edit_page([](CellPageRef& ref) { ref.chunks = 0; }), range);
  expect_unopened(edit_page([](CellPageRef& ref) { ref.chunks = 257; }), range);
  expect_unopened(edit_page([](CellPageRef& ref) { ref.chunks = 5; }), "not as many as stated [R23]");
  for (const double number : {2.0, nan, 1e62, std::numeric_limits<double>::infinity()})
    expect_unopened(edit_page([=](CellPageRef& ref) { ref.low[1] = number; }), range);
  for (const double number : {-2.0, nan, -1e62})
    expect_unopened(edit_page([=](CellPageRef& ref) { ref.high[2] = number; }), range);
  for (const double number : {-1.0, nan, std::numeric_limits<double>::infinity()})
    expect_unopened(edit_page([=](CellPageRef& ref) { ref.area = number; }), range);
  // What is no part of a page belongs to none.
  expect_unopened(edit_page([](CellPageRef& ref) { --ref.page_bytes; }), untiled);
  expect_unopened(edit_page([](CellPageRef& ref) { ++ref.offset, --ref.page_bytes; }), untiled);
  for (const std::uint64_t offset : {std::uint64_t{0}, std::uint64_t{1} << 40, ~std::uint64_t{0}})
    expect_unopened(edit_page([=](CellPageRef& ref) { ref.chunks_offset = offset; }), untiled);
  for (const std::uint64_t step : {std::uint64_t{1}, ~std::uint64_t{0}})
    expect_refused(Part::cell_root, 0, edit_page([=](CellPageRef& ref) { ref.chunks_offset += step; }),
                   "chunks of cells do not tile their section");
}

TEST_F(DamagedCells, PartsOfAPageHaveTheirLengths) {
  const std::string wrong = "a part of a page of cells has the wrong length [R23]";
  const auto edit_part = [](std::size_t part, const std::function<void(IndexPagePart&)>& change) {
    return edit<IndexPagePart>(part * sizeof(IndexPagePart), change);
  };
  for (std::size_t part = 0; part < 3; ++part) {
    expect_refused(Part::cell_table, 1, edit_part(part, [](IndexPagePart& p) { ++p.unpacked_bytes; }), wrong);
    expect_refused(Part::cell_table, 1, edit_part(part, [](IndexPagePart& p) { p.packed_bytes = ~0u; }), wrong);
    expect_refused(Part::cell_table, 1, edit_part(part, [](IndexPagePart& p) { ++p.hash; }), "mismatch");
  }
  expect_refused(Part::cell_table, 1, edit_part(2, [](IndexPagePart& p) { --p.packed_bytes; }),
                 "a page of cells has bytes left over [R23]");
  expect_refused(
      Part::cell_entries, 1, [](Bytes& entries) { entries.resize(3 * sizeof(CellChunkEntry)); }, wrong);
  expect_refused(
      Part::cell_summary, 3, [](Bytes& summaries) { summaries.push_back({}); }, "[R23]");
}

TEST_F(DamagedCells, EntriesAreInTheirRanges) {
  const auto refused = [&](const std::function<void(CellChunkEntry&)>& change, const std::string& words) {
    expect_refused(Part::cell_entries, 1, edit_entry(change), words + " [R23]");
  };
  const std::string range = "a chunk of cells is out of range", length = "a chunk of cells has the wrong length";
  refused([](CellChunkEntry& entry) { entry.cells = 0; }, range);
  refused([](CellChunkEntry& entry) { entry.cells = max_chunk_cells + 1; }, range);
  refused([](CellChunkEntry& entry) { entry.unpacked_bytes = entry.packed_bytes - 1; }, range);
  for (const double number : {2.0, nan, -1e62}) refused([=](CellChunkEntry& entry) { entry.low[0] = number; }, range);
  for (const double number : {-2.0, nan, 1e62}) refused([=](CellChunkEntry& entry) { entry.high[2] = number; }, range);
  for (const double number : {-1e-9, nan}) refused([=](CellChunkEntry& entry) { entry.area = number; }, range);
  refused([](CellChunkEntry& entry) { entry.unpacked_bytes = 16 + entry.cells * 32 + 1; }, length);
  refused([](CellChunkEntry& entry) { entry.points = 3; }, length);
  refused([](CellChunkEntry& entry) { entry.points = entry.cells * 4 + 1; }, length);
  const std::string untiled = "chunks of cells do not tile their section, or pass the box of their page";
  refused([](CellChunkEntry& entry) { ++entry.offset; }, untiled);
  refused([](CellChunkEntry& entry) { entry.offset = ~std::uint64_t{0}; }, untiled);
  refused([](CellChunkEntry& entry) { entry.packed_bytes = entry.unpacked_bytes = 528; }, untiled);
  refused([](CellChunkEntry& entry) { entry.high[0] = 1e9; }, untiled);
  refused([](CellChunkEntry& entry) { entry.low[0] = -1e9; }, untiled);
  // The last chunk of a page ends where the page begins.
  expect_refused(Part::cell_entries, 1, edit_entry([](CellChunkEntry& entry) { --entry.packed_bytes; }, 3),
                 "chunks of cells do not tile their section [R23]");
  expect_refused(Part::cell_entries, 1, edit_entry([](CellChunkEntry& entry) { ++entry.hash; }), "checksum mismatch");
}

TEST_F(DamagedCells, NumbersAreThoseOfTheCells) {
  const auto refused = [&](const std::function<void(CellChunkEntry&)>& change, const std::string& words) {
    expect_refused(Part::cell_entries, 1, edit_entry(change), words + " [R24]");
  };
  const std::string box = "the box or area of a chunk of cells is wrong";
  refused([](CellChunkEntry& entry) { entry.low[0] = std::nextafter(entry.low[0], 1); }, box);
  refused([](CellChunkEntry& entry) { entry.high[1] = std::nextafter(entry.high[1], -1); }, box);
  refused([](CellChunkEntry& entry) { entry.area *= 1.011; }, box);
  refused([](CellChunkEntry& entry) { entry.area *= 0.989; }, box);
  const std::string points = "corners at others than it states";
  refused([](CellChunkEntry& entry) { ++entry.points; }, points);
  refused([](CellChunkEntry& entry) { --entry.points; }, points);
  refused([](CellChunkEntry& entry) { ++entry.cells; }, "wrong length, or a corner that is not there");
  EXPECT_EQ(message_of(harmed(Part::cell_entries, 1, edit_entry([](CellChunkEntry& entry) { entry.area *= 1.009; }))),
            "");
  const std::string page = "the box or area of a page of cells is wrong [R24]";
  expect_refused(Part::cell_root, 0, edit_page([](CellPageRef& ref) { ref.low[0] -= 1e-9; }), page);
  expect_refused(Part::cell_root, 0, edit_page([](CellPageRef& ref) { ref.high[1] += 1e-9; }), page);
  expect_refused(Part::cell_root, 0, edit_page([](CellPageRef& ref) { ref.area *= 1.011; }), page);
}

TEST_F(DamagedCells, RangesAndBinsAreThoseOfTheCells) {
  const std::string wrong = "the range or occupancy of a chunk of cells is wrong [R24]";
  for (const std::size_t part : {2u, 5u}) {
    // Columns of least values, of largest ones, and of occupancies, each in its own form.
    const auto message = [&](std::size_t byte) {
      return message_of(harmed(Part::cell_summary, part, [&](Bytes& bytes) { bytes[byte] ^= std::byte{1}; }));
    };
    const std::size_t bytes = 4 * summary_bytes;
    for (std::size_t byte = 0; byte < bytes; ++byte) EXPECT_NE(message(byte), "") << byte;
    EXPECT_THAT(message(bytes - 1), HasSubstr(wrong));
    EXPECT_THAT(message(0), HasSubstr(wrong));
  }
}

TEST_F(DamagedCells, CountsAreThoseOfAllCells) {
  const std::string wrong = "there are other cells than the root of the cells states [R24]";
  const auto refused = [&](const std::function<void(CellKind&)>& change) {
    expect_refused(Part::cell_root, 0, edit_kind(change), wrong);
  };
  refused([](CellKind& kind) { ++kind.cells; });
  refused([](CellKind& kind) { --kind.packed_bytes; });
  refused([](CellKind& kind) { kind.turned = kind.cells + 1; });
  refused([](CellKind& kind) { kind.shape = static_cast<CellShape>(77); });
  refused([](CellKind& kind) { kind.field = static_cast<CellField>(77); });
  // A kind without cells, and none for cells that are there.
  expect_refused(
      Part::cell_root, 0,
      [](Bytes& root) {
        Bytes more;
        append_record(more, CellKind{static_cast<CellShape>(9), CellField::corners, {}, 0, 0, 0});
        root.insert(root.begin(), more.begin(), more.end());
        edit_tail([](Tail& tail) { ++tail.kinds; })(root);
      },
      wrong);
  expect_refused(
      Part::cell_root, 0,
      [](Bytes& root) {
        root.erase(root.begin(), root.begin() + sizeof(CellKind));
        edit_tail([](Tail& tail) { --tail.kinds; })(root);
      },
      wrong);
}

TEST_F(DamagedCells, CornersAreThere) {
  const std::string wrong = "a corner that is not there [R24]";
  const auto edit_first = [](std::uint64_t add) {
    return edit<std::uint64_t>(0, [=](std::uint64_t& first) { first += add; });
  };
  for (const std::uint64_t add : {std::uint64_t{300}, std::uint64_t{1} << 48, ~std::uint64_t{0} - 300})
    expect_refused(Part::cells, 12, edit_first(add), wrong);
  for (std::size_t width = 8; width < 16; ++width)
    expect_refused(Part::cells, 3, edit<std::uint8_t>(width, [](std::uint8_t& w) { w = 9; }), wrong);
  expect_refused(
      Part::cells, 3, [](Bytes& bytes) { bytes.back() = std::byte{255}; }, wrong);
  expect_refused(
      Part::cells, 3, [](Bytes& bytes) { bytes.resize(15); }, "wrong length");
  expect_refused(
      Part::cells, 3, [](Bytes& bytes) { bytes.push_back({}); }, wrong);
}

TEST_F(DamagedCells, AreInOrder) {
  const auto message = [&](std::size_t chunk_cells, std::size_t page_chunks, const auto& change) {
    TestVolume volume = volume_;
    volume.cells->chunk_cells = chunk_cells;
    volume.cells->page_chunks = page_chunks;
    change(volume.cells->corners);
    return message_of(test_volume_bytes(volume));
  };
  const auto exchange = [](std::size_t a, std::size_t b) {
    return [=](std::vector<std::array<std::uint64_t, 4>>& cells) { std::swap(cells[a], cells[b]); };
  };
  EXPECT_EQ(message(1, 8, [](auto&) {}), "");
  const auto out_of_order = HasSubstr("cells are out of order [R24]");
  EXPECT_THAT(message(1, 8, exchange(3, 4)), out_of_order) << "in a page";
  EXPECT_THAT(message(1, 8, exchange(7, 8)), out_of_order) << "in different pages";
  // In one chunk, cells of one first corner.
  const auto& cells = volume_.cells->corners;
  std::size_t pair = 0;
  while (pair + 1 < cells.size() && !(cells[pair][0] == cells[pair + 1][0] && cells[pair] != cells[pair + 1])) ++pair;
  ASSERT_LT(pair + 1, cells.size());
  EXPECT_THAT(message(200, 8, exchange(pair, pair + 1)), out_of_order);
}

TEST_F(DamagedCells, RanksAreThoseOfTheIndex) {
  const std::string counts = "its counts are not those of the points [R24]";
  const std::string index = "the ranks of the points are not those of the index [R24]";
  const std::size_t table = volume_.info.resolutions() * sizeof(std::uint64_t);
  expect_refused(Part::rank_page, 0, edit<std::uint64_t>(0, [](std::uint64_t& before) { ++before; }), counts);
  expect_refused(
      Part::rank_page, 0, [&](Bytes& page) { page[table + 5] = std::byte{63}; }, counts);
  expect_refused(
      Part::rank_page, 0, [](Bytes& page) { page.pop_back(); }, counts);
  // The first and the last point of another segment change places.
  const auto& segments = volume_.cells->segments;
  const std::size_t other = static_cast<std::size_t>(
      std::ranges::find_if(segments, [&](std::uint8_t s) { return s != segments[0]; }, {}) - segments.begin());
  std::size_t last = segments.size() - 1;
  while (segments[last] == segments[0]) --last;
  ASSERT_GT(last, other + 30) << "in different leaves of the index";
  expect_refused(
      Part::rank_page, 0, [&](Bytes& page) { std::swap(page[table], page[table + last]); }, index);
}

// Shapes and fields of later versions are passed over, and their bytes are checked.
TEST_F(DamagedCells, OfAnUnknownKindAreSkipped) {
  const auto with_kind = [&](CellShape shape, CellField field) {
    return parts_.assemble([&](Part part, std::size_t, Bytes& bytes) {
      const auto change_entry = [&](CellChunkEntry& entry) { entry.shape = shape, entry.field = field; };
      const auto change_kind = [&](CellKind& kind) { kind.shape = shape, kind.field = field; };
      for (std::size_t chunk = 0; part == Part::cell_entries && chunk < bytes.size() / sizeof(CellChunkEntry); ++chunk)
        edit_entry(change_entry, chunk)(bytes);
      if (part == Part::cell_root) edit_kind(change_kind)(bytes);
    });
  };
  for (const auto& [shape, field] : {std::pair(static_cast<CellShape>(250), CellField::corners),
                                     std::pair(tetrahedron, static_cast<CellField>(250))}) {
    const Bytes file = with_kind(shape, field);
    EXPECT_EQ(message_of(file), "");
    const auto opened = open(file).value();
    const auto cells = value_of(CellReader::open(*opened));
    EXPECT_FALSE(is_known(cells->kinds()[0].shape, cells->kinds()[0].field));
    for (const CellChunkEntry& entry : value_of(cells->read_page(0, {})).chunks) {
      EXPECT_FALSE(is_known(entry.shape, entry.field));
      EXPECT_TRUE(cells->check_bytes(entry));
    }
    // One that is damaged is found all the same.
    const std::string message = error_of(Dissected(file).assemble([](Part part, std::size_t i, Bytes& bytes) {
      if (part == Part::cell_entries && i == 2) edit_entry([](CellChunkEntry& entry) { ++entry.hash; })(bytes);
    }));
    EXPECT_THAT(message, HasSubstr("checksum mismatch"));
  }
}

// Polyhedra in a file: what is true of tetrahedra is of them.
struct DamagedPolyhedra : DamagedCells {
  static TestVolume volume_with_polyhedra() {
    TestVolume volume = plain_volume();
    add_random_cells(volume, 20);
    add_random_polyhedra(volume, 40);
    return volume;
  }
  // Chunks 0 and 1 have tetrahedra, 2 to 4 polyhedra. All are in pages 0 and 1.
  const TestVolume polyhedra_ = volume_with_polyhedra();
  const Dissected with_polyhedra_{test_volume_bytes(polyhedra_)};

  [[nodiscard]] std::string message(Part part, std::size_t index, const std::function<void(Bytes&)>& harm) const {
    return message_of(with_polyhedra_.harmed(part, index, harm));
  }
};

TEST_F(DamagedPolyhedra, AreWholeWhenNothingIsDone) {
  for (const auto packing : {Packing::zstd, Packing::raw}) {
    const Bytes file = with_polyhedra_.assemble([](Part, std::size_t, Bytes&) {}, packing);
    ASSERT_EQ(message_of(file), "");
    const auto opened = open(file).value();
    const auto cells = value_of(CellReader::open(*opened));
    ASSERT_EQ(cells->kinds().size(), 2u);
    EXPECT_EQ(cells->kinds()[1].shape, CellShape::polyhedron);
    EXPECT_EQ(cells->kinds()[1].cells, 40u);
    EXPECT_TRUE(explore_volume(*opened).all_read);
    EXPECT_THAT(value_of(dump_volume(*opened, true)), HasSubstr("kind: polyhedron, corners, 40 cells"));
  }
}

TEST_F(DamagedPolyhedra, AreRefused) {
  EXPECT_THAT(message(Part::cells, 2, [](Bytes& bytes) { bytes.back() ^= std::byte{77}; }),
              HasSubstr("a polyhedron without a closed surface [R24]"));
  EXPECT_THAT(message(Part::cells, 2, [](Bytes& bytes) { bytes.pop_back(); }), HasSubstr("wrong length"));
  EXPECT_THAT(message(Part::cells, 2, edit<std::uint8_t>(10, [](std::uint8_t& width) { width = 1; })),
              HasSubstr("wrong length"));
  EXPECT_THAT(message(Part::cells, 2, edit<std::uint64_t>(0, [](std::uint64_t& first) { first += 280; })),
              HasSubstr("a corner that is not there [R24]"));
  // The planes: a byte for each of 16 first corners, then counts and apexes.
  EXPECT_THAT(message(Part::cells, 2, edit<std::uint8_t>(16 + 16, [](std::uint8_t& count) { count = 3; })),
              HasSubstr("too few corners"));
  EXPECT_THAT(message(Part::cells, 2, edit<std::uint8_t>(16 + 32, [](std::uint8_t& apex) { apex = 40; })),
              HasSubstr("without its apex"));
  const std::string box = "the box or area of a chunk of cells is wrong";
  EXPECT_THAT(message(Part::cell_entries, 0, edit_entry([](CellChunkEntry& entry) { entry.area *= 1.02; }, 2)),
              HasSubstr(box));
  EXPECT_THAT(message(Part::cell_entries, 0, edit_entry([](CellChunkEntry& entry) { entry.points = 3; }, 2)),
              HasSubstr("a chunk of cells has the wrong length [R23]"));
  EXPECT_THAT(message(Part::cell_entries, 0, edit_entry([](CellChunkEntry& entry) { ++entry.cells; }, 2)),
              HasSubstr("[R24]"));
}

// Bytes of the cells change, and their hashes with them.
TEST_F(DamagedPolyhedra, AreRefusedOrReadAlikeForEachByte) {
  std::size_t refused = 0;
  const std::size_t step = is_sanitized ? 11 : 1;
  const auto bytes = with_polyhedra_.count(Part::cells) == 5 ? std::size_t{700} : std::size_t{0};
  for (std::size_t at = 0; at < bytes; at += step)
    refused +=
        message(Part::cells, 3, [&](Bytes& chunk) { chunk[at % chunk.size()] ^= std::byte{0x15}; }).empty() ? 0 : 1;
  EXPECT_GT(refused, bytes / step / 2);
}

TEST_F(DamagedPolyhedra, AreInOrder) {
  TestVolume volume = polyhedra_;
  volume.cells->chunk_cells = 1;
  CellChunk& cells = volume.cells->polyhedra;
  const CellChunk given = cells;
  cells = {given.shape, given.field, {}, {}, {}};
  for (std::size_t cell = given.size(); cell-- > 0;) append_cells(cells, given, cell, cell + 1);
  EXPECT_THAT(message_of(test_volume_bytes(volume)), HasSubstr("cells are out of order [R24]"));
}

// Hashes are wrong here.
TEST_F(DamagedCells, EachFlippedByteAndCutIsFound) {
  const auto volume = open(file_).value();
  const auto section = std::ranges::find(volume->sections(), SectionKind::cells, &SectionEntry::kind);
  ASSERT_NE(section, volume->sections().end());
  const std::size_t step = is_sanitized ? 7 : 1;  // each takes ten times as long there
  for (std::uint64_t at = section->offset; at < section->offset + section->packed_bytes; at += step) {
    Bytes flipped = file_;
    flipped[at] ^= std::byte{0x10};
    EXPECT_NE(error_of(flipped), "") << at;
    const auto opened = open(flipped);
    ASSERT_TRUE(opened) << "who shows no cells reads no byte of them";
    EXPECT_FALSE(explore_volume(**opened).all_read) << at - section->offset << " of " << section->packed_bytes;
  }
  for (std::uint64_t size = section->offset; size < file_.size(); size += 7)
    EXPECT_FALSE(open(Bytes(file_.begin(), file_.begin() + static_cast<std::ptrdiff_t>(size))));
}

// --- Memory of hostile files.

TEST_F(DamagedCells, CannotClaimMuchMemory) {
  constexpr std::size_t few_megabytes = std::size_t{8} << 20;
  const auto memory = [&](Part part, const std::function<void(Bytes&)>& harm) {
    const Bytes file = harmed(part, 0, harm);
    start_counting_allocations();
    EXPECT_NE(error_of(file), "");
    return most_bytes_allocated();
  };
  const std::size_t honest = memory(Part::cell_root, edit_kind([](CellKind& kind) { ++kind.cells; }));
  for (const std::uint64_t number :
       {std::uint64_t{1} << 20, std::uint64_t{1} << 32, std::uint64_t{1} << 59, ~std::uint64_t{0}}) {
    const auto small = static_cast<std::uint32_t>(std::min<std::uint64_t>(number, ~0u));
    EXPECT_LE(memory(Part::cell_root, edit_tail([=](Tail& tail) { tail.chunks = number; })), honest + 100'000);
    EXPECT_LE(memory(Part::cell_root, edit_tail([=](Tail& tail) { tail.pages = number; })), honest + 100'000);
    EXPECT_LE(memory(Part::cell_root, edit_tail([=](Tail& tail) { tail.kinds = small; })), honest + 100'000);
    EXPECT_LE(memory(Part::cell_root, edit_page([=](CellPageRef& ref) { ref.page_bytes = small; })), honest + 100'000);
    EXPECT_LE(memory(Part::cell_root, edit_ranks([=](PackedPageRef& ref) { ref.unpacked_bytes = small; })),
              honest + 100'000);
    EXPECT_LE(memory(Part::cell_entries, edit_entry([=](CellChunkEntry& entry) { entry.unpacked_bytes = small; })),
              honest + 100'000);
  }
  // As many cells as a chunk may have, in 16 bytes: all are the same.
  const auto repeat = [](Bytes& bytes) {
    bytes.resize(16);
    std::fill(bytes.begin(), bytes.end(), std::byte{0});
  };
  const Bytes file = parts_.assemble([&](Part part, std::size_t i, Bytes& bytes) {
    if (part == Part::cells && i == 0) repeat(bytes);
    if (part == Part::cell_entries && i == 0)
      edit_entry([](CellChunkEntry& entry) { entry.cells = max_chunk_cells, entry.points = 4; }, 0)(bytes);
  });
  start_counting_allocations();
  EXPECT_NE(error_of(file), "");
  EXPECT_LE(most_bytes_allocated(), honest + 2 * few_megabytes);
}

// Bytes for people and for later versions change nothing.
TEST_F(DamagedCells, ReservedBytesAreIgnored) {
  EXPECT_EQ(message_of(harmed(Part::cell_entries, 1, edit_entry([](CellChunkEntry& entry) { entry.zero[3] = 7; }))),
            "");
  EXPECT_EQ(message_of(harmed(Part::cell_root, 0, edit_kind([](CellKind& kind) { kind.zero[5] = 7; }))), "");
}

}  // namespace
}  // namespace splatvol::test
