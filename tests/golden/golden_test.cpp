// Files as they were when their version of the format was frozen: each is read as it was read then. A failure is a bug
// of the reader, and no reason to write the files anew (CONTRIBUTING.md).
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include "base/file.h"
#include "format/volume.h"
#include "tests/golden/golden_files.h"
#include "tests/support/long.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"
#include "tests/support/surgery.h"
#include "tests/support/volume_bytes.h"
#include "tests/support/volume_dump.h"

namespace splatvol::test {
namespace {

std::shared_ptr<const format::Volume> open(const std::filesystem::path& path) {
  return value_of(format::Volume::open(value_of(open_file(path))));
}

format::Bytes bytes_of(const std::filesystem::path& path) { return test::bytes_of(read_text_file(path).value()); }

std::string dump_of(const std::filesystem::path& path) { return value_of(dump_volume(*open(path))); }

TEST(Golden, EachFileIsReadAsItWasWhenTheFormatWasFrozen) {
  for (const std::filesystem::path& path : golden_files()) {
    EXPECT_EQ(message_of(open(path)->verify([](double) {})), "");
    std::filesystem::path text = path;
    const auto expected = value_of(read_text_file(text.replace_extension(".dump")));
    const std::vector<std::string> now = lines_of(dump_of(path)), then = lines_of(expected);
    EXPECT_EQ(now.size(), then.size()) << path;
    for (std::size_t i = 0; i < std::min(now.size(), then.size()); ++i)
      ASSERT_EQ(now[i], then[i]) << path << ", line " << i + 1;
  }
}

TEST(Golden, EveryFeatureHasAFile) {
  std::set<std::string> names;
  for (const std::filesystem::path& path : golden_files()) names.insert(path.stem());
  for (const char* name : {"mesh",
                           "points",
                           "octree",
                           "kdtree",
                           "mis",
                           "gradients",
                           "cells_own",
                           "exact",
                           "series",
                           "large_values",
                           "small_lengths",
                           "aliases",
                           "one_point",
                           "pages",
                           "boundary",
                           "two_sided",
                           "cells_tetrahedra",
                           "cells_delaunay",
                           "cells_shapes",
                           "cells_shapes_own",
                           "cells_polyhedra",
                           "cells_polyhedra_own",
                           "cells_series"})
    EXPECT_TRUE(names.contains(name)) << name;
}

TEST(Golden, ChunksAreRawAndCompressed) {
  bool raw = false, compressed = false;
  for (const std::filesystem::path& path : golden_files()) {
    const auto volume = open(path);
    for (std::uint64_t page = 0; page < volume->directory_page_count(); ++page) {
      const auto directory = value_of(volume->read_directory_page(page));
      for (const format::ChunkLocation& chunk : directory.chunks)
        (chunk.entry.packed_bytes == chunk.entry.unpacked_bytes ? raw : compressed) = true;
    }
  }
  EXPECT_TRUE(raw);
  EXPECT_TRUE(compressed);
}

TEST(Golden, ReductionsHaveSeveralResolutionsAndSeriesSeveralSteps) {
  for (const std::filesystem::path& path : golden_files()) {
    const auto volume = open(path);
    if (path.stem() == "octree" || path.stem() == "kdtree" || path.stem() == "mis") {
      EXPECT_EQ(volume->info().reduction_method, path.stem().string());
      EXPECT_GE(volume->info().resolutions(), 2u) << path;
    }
    if (path.stem().string().ends_with("series")) {
      ASSERT_TRUE(volume->series());
      EXPECT_EQ(volume->series()->steps.size(), 3u);
      EXPECT_EQ(volume->series()->entries.size(), 5u);  // with a dead part for each append
    }
  }
}

// What fuzzers mutate: the parts of any file, with steps too.
TEST(Golden, EachFileCanBeTakenApartAndPutTogether) {
  const auto leave_alone = [](Part, std::size_t, format::Bytes&) {};
  for (const std::filesystem::path& path : golden_files()) {
    const auto parts = Dissected::take_apart(bytes_of(path));
    ASSERT_TRUE(parts) << path;
    EXPECT_EQ(parts->count(Part::summary_table), path.stem().string().ends_with("series") ? 3u : 0u);
    for (const Packing packing : {Packing::zstd, Packing::raw}) {
      const format::Bytes bytes = parts->assemble(leave_alone, packing);
      const auto volume = value_of(format::Volume::open(memory_source(bytes, path)));
      EXPECT_EQ(message_of(volume->verify([](double) {})), "");
      EXPECT_EQ(dump_volume(*volume).value(), dump_of(path)) << path;
    }
  }
}

// Expects that bytes are refused, or hold what `dump` says.
void expect_refused_or_same(const format::Bytes& bytes, const std::string& dump, const std::string& what) {
  const auto volume = format::Volume::open(memory_source(bytes, what));
  if (!volume || !(*volume)->verify([](double) {})) return;
  EXPECT_EQ(dump_volume(**volume).value(), dump) << what;
}

TEST(Golden, EveryTruncationIsRefused) {
  for (const std::filesystem::path& path : golden_files()) {
    const format::Bytes whole = bytes_of(path);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const format::Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      const auto volume = format::Volume::open(memory_source(cut, path));
      ASSERT_FALSE(volume && (*volume)->verify([](double) {})) << path << ", " << size << " bytes";
    }
  }
}

// Each byte of a small file; one in several of a larger one, for time. A sample has fewer places of each file.
TEST(Golden, DamagedBytesAreRefusedOrDoNotMatter) {
  const std::size_t small = is_long() ? 8192 : 0, places = is_long() ? 4096 : 60;
  for (const std::filesystem::path& path : golden_files()) {
    const format::Bytes whole = bytes_of(path);
    const std::string dump = dump_of(path);
    const std::size_t step = whole.size() <= small ? 1 : 1 + whole.size() / places;
    for (std::size_t at = 0; at < whole.size(); at += step)
      for (const std::byte value : {std::byte{0}, std::byte{0xff}, whole[at] ^ std::byte{0xff}}) {
        if (value == whole[at]) continue;
        format::Bytes damaged = whole;
        damaged[at] = value;
        expect_refused_or_same(damaged, dump, fmt::format("{}, byte {}", path.filename().string(), at));
      }
  }
}

TEST(Golden, TheFilesAreSmall) {
  std::uint64_t all = 0;
  for (const std::filesystem::path& path : golden_files()) {
    EXPECT_LE(std::filesystem::file_size(path), 24u << 10) << path;
    all += std::filesystem::file_size(path);
  }
  EXPECT_LE(all, 300u << 10);
}

}  // namespace
}  // namespace splatvol::test
