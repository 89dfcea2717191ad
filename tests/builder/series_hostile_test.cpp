// Damaged and hostile files with time steps.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "base/file.h"
#include "builder/series/series_build.h"
#include "format/series_index.h"
#include "format/series_writer.h"
#include "format/volume.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/series_check.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {
namespace {

using format::Bytes;
using format::StepEntry;
using testing::HasSubstr;

// A small series of three steps, of which the last was appended.
const Bytes& series_bytes() {
  static const Bytes bytes = [] {
    const TempFolder folder;
    const std::string path = folder.path("series.svol");
    const auto steps = [](std::size_t begin, std::size_t end) {
      std::vector<SeriesStep> list;
      for (std::size_t step = begin; step < end; ++step) {
        const auto t = static_cast<double>(step);
        list.push_back(step_of("step", t, {mesh_piece(lattice(4), [t](dvec3 p) { return p.x + t * p.y; })}));
      }
      return list;
    };
    const auto silent = [](const char*, double) {};
    EXPECT_TRUE(build_series(steps(0, 2), path, {}, silent));
    EXPECT_EQ(message_of(append_to_series(steps(2, 3), path, {}, silent)), "");
    return bytes_of(folder.read("series.svol"));
  }();
  return bytes;
}

TEST(HostileSeries, TheSoundFileIsAccepted) { EXPECT_EQ(error_of(series_bytes()), ""); }

TEST(HostileSeries, EveryTruncationIsRefused) {
  const Bytes& bytes = series_bytes();
  for (std::size_t size = 0; size < bytes.size(); size += 1 + size / 97) {
    const Bytes cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_NE(error_of(cut), "") << size;
  }
}

TEST(HostileSeries, EveryFlippedByteIsFound) {
  Bytes bytes = series_bytes();
  for (std::size_t at = 0; at < bytes.size(); at += 7) {
    bytes[at] ^= std::byte{0x41};
    EXPECT_NE(error_of(bytes), "") << at;
    bytes[at] ^= std::byte{0x41};
  }
}

TEST(HostileSeries, BytesBehindTheEndDoNotHideTheSteps) {
  Bytes bytes = series_bytes();
  bytes.resize(bytes.size() + 1000, std::byte{7});
  const auto volume = value_of(format::Volume::open(memory_source(bytes, "f")));
  EXPECT_EQ(volume->series()->steps.size(), 3U);
  EXPECT_THAT(error_of(bytes), HasSubstr("1000 bytes behind the end"));
}

// Changes the step directory, and makes all hashes right again. The directory keeps its length.
Bytes with_directory(const std::function<void(std::vector<StepEntry>&)>& change) {
  Bytes bytes = series_bytes();
  const auto superblock = format::read_record<format::Superblock>(bytes, 0);
  const auto head = format::read_record<format::StepDirectoryHead>(bytes, superblock.step_directory);
  const std::size_t first = superblock.step_directory + sizeof(head);
  std::vector<StepEntry> entries;
  for (std::size_t i = 0; i < head.entries; ++i)
    entries.push_back(format::read_record<StepEntry>(bytes, first + i * sizeof(StepEntry)));
  change(entries);
  std::ranges::copy(std::as_bytes(std::span(entries)), bytes.begin() + static_cast<std::ptrdiff_t>(first));
  const std::size_t hashed = superblock.step_directory + sizeof(std::uint64_t);
  const std::uint64_t hash =
      format::hash_bytes(std::span(bytes).subspan(hashed, bytes.size() - sizeof(format::Footer) - hashed));
  std::ranges::copy(std::as_bytes(std::span(&hash, 1)),
                    bytes.begin() + static_cast<std::ptrdiff_t>(superblock.step_directory));
  return bytes;
}

TEST(HostileSeries, EntriesThatLieAreRefused) {
  const auto error = [](const std::function<void(std::vector<StepEntry>&)>& change) {
    return error_of(with_directory(change));
  };
  EXPECT_EQ(error([](auto&) {}), "");
  EXPECT_THAT(error([](auto& e) { e[1].offset = ~std::uint64_t{0}; }), HasSubstr("[R18]"));
  EXPECT_THAT(error([](auto& e) { e[1].bytes = ~std::uint64_t{0}; }), HasSubstr("[R18]"));
  EXPECT_THAT(error([](auto& e) { e[3].bytes -= 1; }), HasSubstr("[R18]"));
  EXPECT_THAT(error([](auto& e) { std::swap(e[0], e[1]); }), HasSubstr("[R18]"));
  EXPECT_THAT(error([](auto& e) { e[0].kind = static_cast<format::StepEntryKind>(7); }), HasSubstr("[R18]"));
  EXPECT_THAT(error([](auto& e) { e[0].hash ^= 1; }), HasSubstr("[R18]"));
  EXPECT_THAT(error([](auto& e) { e[2].hash ^= 1; }), HasSubstr("dead part"));
  EXPECT_THAT(error([](auto& e) { e[1].time = 0; }), HasSubstr("[R19]"));
  EXPECT_THAT(error([](auto& e) { e[3].time = std::numeric_limits<double>::infinity(); }), HasSubstr("[R19]"));
  EXPECT_THAT(error([](auto& e) { e[3].time = 1.1e300; }), HasSubstr("[R19]"));
  EXPECT_THAT(error([](auto& e) { e[3].time = std::numeric_limits<double>::quiet_NaN(); }), HasSubstr("[R19]"));
  EXPECT_THAT(error([](auto& e) { e[0].time = -5; }), HasSubstr("its time is not that of the step directory"));
  EXPECT_THAT(error([](auto& e) {
                for (StepEntry& entry : e) entry.kind = format::StepEntryKind::dead;
              }),
              HasSubstr("without steps"));
  EXPECT_THAT(error([](auto& e) {
                e[0].bytes += e[1].bytes;  // a step that spans two
                e[1].offset += e[1].bytes;
                e[1].bytes = 0;
              }),
              HasSubstr("[R2]"));
}

TEST(HostileSeries, SuperblocksThatLieAreRefused) {
  const auto error = [](const std::function<void(format::Superblock&)>& change) {
    Bytes bytes = series_bytes();
    auto superblock = format::read_record<format::Superblock>(bytes, 0);
    change(superblock);
    format::seal(superblock);
    std::ranges::copy(std::as_bytes(std::span(&superblock, 1)), bytes.begin());
    return error_of(bytes);
  };
  EXPECT_THAT(error([](auto& s) { s.step_directory = ~std::uint64_t{0}; }), HasSubstr("out of range [R18]"));
  EXPECT_THAT(error([](auto& s) { s.step_directory = 64; }), HasSubstr("out of range [R18]"));
  EXPECT_THAT(error([](auto& s) { s.step_directory += 8; }), HasSubstr("[R18]"));
  EXPECT_THAT(error([](auto& s) { s.step_directory = 0; }), HasSubstr("[R18]"));
  EXPECT_THAT(error([](auto& s) { s.critical_features = 0; }), HasSubstr("[R18]"));
  EXPECT_THAT(error([](auto& s) { s.critical_features = 3; }), HasSubstr("feature"));
  EXPECT_THAT(error([](auto& s) { s.critical_features = s.step_directory = 0; }), HasSubstr("[R6]"));
  EXPECT_THAT(error([](auto& s) { s.file_bytes += 1; }), HasSubstr("[R2]"));
}

TEST(SeriesIndex, RoundTrip) {
  const double none = std::numeric_limits<double>::quiet_NaN();
  const format::SeriesIndex index{{{0, "a-0000.svol"}, {0.25, "a-0001.svol"}},
                                  {{"p", "Pa", {-0.1, 1e300}}, {"empty", "", {none, none}}}};
  const auto back = value_of(format::series_index_from_json(format::to_json(index)));
  ASSERT_EQ(back.steps.size(), 2U);
  EXPECT_EQ(back.steps[1].time, 0.25);
  EXPECT_EQ(back.steps[1].file, "a-0001.svol");
  ASSERT_EQ(back.attributes.size(), 2U);
  EXPECT_EQ(back.attributes[0].name, "p");
  EXPECT_EQ(back.attributes[0].unit, "Pa");
  EXPECT_EQ(back.attributes[0].range.min, -0.1);
  EXPECT_EQ(back.attributes[0].range.max, 1e300);
  EXPECT_TRUE(std::isnan(back.attributes[1].range.min) && std::isnan(back.attributes[1].range.max));
}

// Such text once exhausted the stack.
TEST(SeriesIndex, RefusesDeepNesting) {
  constexpr std::size_t levels = 400'000;
  EXPECT_THAT(message_of(format::series_index_from_json(R"({"steps": [)" + std::string(levels, '[') +
                                                        std::string(levels, ']') + R"(], "attributes": []})")),
              HasSubstr("nested deeper"));
}

TEST(SeriesIndex, RefusesWhatIsNone) {
  for (const char* text :
       {"", "[]", "{}", R"({"steps": 3})", R"({"steps": []})", R"({"steps": [{"time": 0}]})",
        R"({"steps": [{"time": "0", "file": "a"}]})", R"({"steps": [{"time": 0, "file": ""}]})",
        R"({"steps": [{"time": 0, "file": "../a"}]})", R"({"steps": [{"time": 0, "file": "/etc/passwd"}]})",
        R"({"steps": [{"time": 0, "file": "a.svol\u0000b"}]})", R"({"steps": [{"time": 0, "file": ".."}]})",
        R"({"steps": [{"time": 1e999, "file": "a"}]})",
        R"({"steps": [{"time": 1, "file": "a"}, {"time": 1, "file": "b"}]})"})
    EXPECT_FALSE(format::series_index_from_json(text)) << text;

  const std::string steps = R"({"steps": [{"time": 0, "file": "a"}])";
  const std::string good = R"({"name": "p", "unit": "", "min": 0, "max": 1})";
  EXPECT_TRUE(format::series_index_from_json(steps + R"(, "attributes": [)" + good + "]}"));
  EXPECT_FALSE(format::series_index_from_json(steps + "}"));
  const std::vector<std::string> bad = {"3",
                                        "[3]",
                                        "[" + good + ", " + good + "]",
                                        R"([{"name": "p", "min": 0, "max": 1}])",
                                        R"([{"name": "p", "unit": "", "min": 0}])",
                                        R"([{"name": "p", "unit": "", "min": 1, "max": 0}])",
                                        R"([{"name": "p", "unit": "", "min": null, "max": 0}])",
                                        R"([{"name": 1, "unit": "", "min": 0, "max": 1}])"};
  for (const std::string& attributes : bad)
    EXPECT_FALSE(format::series_index_from_json(steps + R"(, "attributes": )" + attributes + "}")) << attributes;
}

}  // namespace
}  // namespace splatvol::test
