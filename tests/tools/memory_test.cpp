// The memory of a process that draws a file much larger than its budget.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/file.h"
#include "pictures/image.h"
#include "tests/support/measured_process.h"
#include "tests/support/require.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::uint64_t budget = 4 * mebibyte;

// Allowed besides the budget: code, stacks, memory that the allocator keeps, and the renderer's copy of the splats,
// which with a software rasterizer is memory of the process too.
constexpr std::uint64_t overhead = 64 * mebibyte;

struct MemoryBounds : testing::Test {
  static void SetUpTestSuite() {
    // Of the programs. With one arena, address space counts used memory, not the reserves of each thread.
    ::setenv("MALLOC_ARENA_MAX", "1", 1);
    folder.emplace();
    for (const auto& [name, source] : {std::pair<std::string, std::string>{"small", "gen:points:count=1000"},
                                       {"large", "gen:points:count=3e6,distribution=vortex"}}) {
      require(run_measured({"svbuild", source, "-o", path(name + ".svol"), "--connectivity", "boxes"}).code == 0,
              source);
      require(run_measured({"svinfo", path(name + ".svol"), "--scene", path(name + ".json")}).code == 0, source);
    }
    require(fs::file_size(path("large.svol")) >= 20 * budget, "the large file is too small");
  }
  static void TearDownTestSuite() { folder.reset(); }

  static std::string path(const std::string& name = "") { return folder->path(name); }

  static Measured render(const std::string& volume, const std::string& output, std::vector<std::string> options,
                         std::uint64_t address_space = 0) {
    std::vector<std::string> words = {"svrender", path(volume + ".svol"), "--scene", path(volume + ".json"),
                                      "-o",       path(output + ".exr"),  "--stats", path(output + ".json")};
    words.insert(words.end(), options.begin(), options.end());
    return run_measured(words, address_space);
  }
  static json statistics(const std::string& output) { return json::parse(*read_text_file(path(output + ".json"))); }

  // The address space that the program and OpenGL's libraries take to draw next to nothing, to 4 MiB.
  static std::uint64_t least_address_space() {
    std::uint64_t refused = 0, enough = 64u << 10;
    for (enough *= mebibyte; enough - refused > 4 * mebibyte;) {
      const std::uint64_t middle = refused + (enough - refused) / 2;
      (render("small", "least", {"--memory", "4M"}, middle).code == 0 ? enough : refused) = middle;
    }
    return enough;
  }

  static inline std::optional<TempFolder> folder;
};

const std::vector<std::string> bounded = {"--memory", "4M", "--tolerance", "15"};

TEST_F(MemoryBounds, AProcessTakesItsBudgetAndLittleMore) {
  const Measured alone = render("small", "small-picture", bounded);
  const Measured large = render("large", "bounded", bounded);
  ASSERT_EQ(alone.code, 0);
  ASSERT_EQ(large.code, 0);
  EXPECT_LE(large.peak_rss, alone.peak_rss + budget + overhead);
  EXPECT_LE(statistics("bounded")["bytes_resident_peak"], budget);
}

TEST_F(MemoryBounds, APictureWithinABudgetIsThatWithoutOne) {
  ASSERT_EQ(render("large", "bounded", bounded).code, 0);
  ASSERT_EQ(render("large", "unbounded", {"--memory", "1G", "--tolerance", "15"}).code, 0);
  ASSERT_EQ(statistics("bounded")["effective_tolerance"], 15) << "the budget binds: compare at another tolerance";
  EXPECT_EQ(read_exr(path("bounded.exr"))->pixels, read_exr(path("unbounded.exr"))->pixels);
}

// Finer and finer voxels, up to those that take more than was granted.
TEST_F(MemoryBounds, AnExportTakesItsMemoryAndLittleMore) {
  constexpr std::uint64_t granted = 200 * mebibyte;
  bool was_refused = false;
  for (const char* voxel : {"0.02", "0.005", "0.001"}) {
    const Measured outcome =
        run_measured({"svexport", path("large.svol"), "-o", path("out.vdb"), "--voxel", voxel, "--memory", "200M"});
    EXPECT_TRUE(outcome.code == 0 || outcome.code == 1) << voxel;
    EXPECT_LE(outcome.peak_rss, granted + 2 * overhead) << voxel;
    was_refused = was_refused || outcome.code == 1;
  }
  EXPECT_TRUE(was_refused);
}

TEST_F(MemoryBounds, DrawsWhereTheProcessMayHaveNoMore) {
  const std::uint64_t limit = least_address_space() + budget + overhead;
  ASSERT_EQ(render("large", "free", bounded).code, 0);
  ASSERT_EQ(render("large", "limited", bounded, limit).code, 0);
  EXPECT_EQ(read_exr(path("limited.exr"))->pixels, read_exr(path("free.exr"))->pixels);
  EXPECT_EQ(render("large", "walk", {"--memory", "4M", "--tolerance", "2", "--progress-frames", path()}, limit).code,
            0);
  // The limit works: a program that holds the whole file does not pass.
  EXPECT_NE(render("large", "whole", {"--memory", "2G", "--tolerance", "0"}, limit).code, 0);
}

}  // namespace
}  // namespace splatvol::test
