// The cache of built files: what makes an entry stale, who waits for whom, and what goes when there is no room.
#include "builder/cache/build_cache.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/stat.h>

#include <atomic>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "builder/pipeline/build.h"
#include "builder/sources/generator.h"
#include "tests/support/child.h"
#include "tests/support/openfoam_files.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

struct CacheTest : FolderTest {
  using Built = BuildCache::Built;
  using Place = BuildCache::Place;

  [[nodiscard]] std::string cache_folder() const { return path("cache"); }
  [[nodiscard]] BuildCache open(std::uint64_t most_bytes = BuildCache::usual_most_bytes) const {
    return value_of(BuildCache::open(cache_folder(), most_bytes));
  }
  [[nodiscard]] static CacheKey key_of(const std::string& input, const std::string& choices = "") {
    return {{canonical_input(input)}, choices};
  }
  static Status never_waits() { return fail(ErrorCode::io, "waits"); }

  [[nodiscard]] static std::optional<Built> find_built(BuildCache& cache, const CacheKey& key) {
    auto found = value_of(cache.find(key, never_waits));
    if (auto* built = std::get_if<Built>(&found)) return std::move(*built);
    return std::nullopt;
  }

  // Writes a small .svol file.
  static void build_at(const std::string& file) {
    auto source = value_of(open_generated("gen:points:count=500", {}));
    BuildOptions options;
    (void)value_of(build_volume(*source, file, options, [](const char*, double) {}));
  }

  // Builds an entry from an input that is read as it is.
  static Built build(BuildCache& cache, const std::string& input, const std::string& choices = "",
                     const ReadFiles& read = {}) {
    const CacheKey key = key_of(input, choices);
    auto place = std::get<Place>(value_of(cache.find(key, never_waits)));
    build_at(place.folder() + "/a.svol");
    return value_of(cache.keep(place, key, "a.svol", state_of_inputs({input}, read), {"a note"}));
  }

  // The names of entries and places.
  [[nodiscard]] std::vector<std::string> folders() const {
    std::vector<std::string> found;
    for (const auto& entry : fs::directory_iterator(cache_folder()))
      if (entry.is_directory()) found.push_back(entry.path().filename());
    return found;
  }
};

TEST_F(CacheTest, FindsWhatWasBuilt) {
  const std::string input = write("a.csv", "x,y,z\n");
  BuildCache cache = open();
  const std::string file = build(cache, input).file;
  EXPECT_TRUE(fs::exists(file));
  const auto found = find_built(cache, key_of(input));
  ASSERT_TRUE(found);
  EXPECT_EQ(found->file, file);
  EXPECT_THAT(found->notes, ElementsAre("a note"));
  EXPECT_FALSE(find_built(cache, key_of(input, "--exact"))) << "other options";
  EXPECT_THAT(folders(), SizeIs(1)) << "a place goes with its object";
}

TEST_F(CacheTest, IsForThisUserAlone) {
  (void)open();
  EXPECT_EQ(fs::status(cache_folder()).permissions(), fs::perms::owner_all);
  if (::geteuid() != 0) GTEST_SKIP() << "only root can give a folder away";
  ASSERT_EQ(::chown(cache_folder().c_str(), 12345, 12345), 0);
  EXPECT_THAT(message_of(BuildCache::open(cache_folder())), HasSubstr("the folder belongs to another user"));
}

TEST_F(CacheTest, TouchesNothingElseInItsFolder) {
  fs::create_directories(cache_folder() + "/.ssh");
  fs::create_directories(cache_folder() + "/results");
  BuildCache cache = open(0);
  (void)value_of(cache.forget({}));
  EXPECT_TRUE(fs::exists(cache_folder() + "/.ssh"));
  EXPECT_TRUE(fs::exists(cache_folder() + "/results"));
}

TEST_F(CacheTest, AChangedInputIsStale) {
  const std::string input = write("a.csv", "x,y,z\n");
  BuildCache cache = open();
  { const Built built = build(cache, input); }
  const auto time = fs::last_write_time(input);
  write("a.csv", "z,y,x\n");
  fs::last_write_time(input, time);
  EXPECT_FALSE(find_built(cache, key_of(input))) << "as large, and as old as it claims";
  EXPECT_THAT(folders(), IsEmpty()) << "a stale entry goes";
}

TEST_F(CacheTest, FilesThatTheReaderOpenedCount) {
  const std::string input = write("a.vtkhdf", "x"), linked = write("data/b.h5", "y");
  const ReadFiles read{.opened = {input, linked}, .missing = {path("a.nam")}};
  BuildCache cache = open();
  { const Built built = build(cache, input, "", read); }
  EXPECT_TRUE(find_built(cache, key_of(input)));
  write("a.nam", "a file that was not there");
  EXPECT_FALSE(find_built(cache, key_of(input)));
  { const Built built = build(cache, input, "", read); }
  EXPECT_TRUE(find_built(cache, key_of(input)));
  write("data/b.h5", "z");
  EXPECT_FALSE(find_built(cache, key_of(input)));
  { const Built built = build(cache, input, "", read); }
  write("another.vtkhdf", "nobody looked into this folder");
  EXPECT_TRUE(find_built(cache, key_of(input)));
}

TEST_F(CacheTest, ANewTimeStepOfACaseIsSeen) {
  for (const auto& [name, text] : openfoam_files()) write("case/" + name, text);
  const ReadFiles read{.opened = {path("case/system/controlDict")}, .missing = {}};
  BuildCache cache = open();
  for (const std::string& input : {path("case"), path("case/system/controlDict")}) {
    { const Built built = build(cache, input, "", read); }
    EXPECT_TRUE(find_built(cache, key_of(input)));
    write("case/processor3/7/polyMesh/" + fs::path(input).filename().string(), "x");
    EXPECT_FALSE(find_built(cache, key_of(input))) << input;
  }
}

TEST_F(CacheTest, ANewPieceInAFolderIsSeen) {
  write("pieces/a.csv", "x,y,z\n");
  BuildCache cache = open();
  { const Built built = build(cache, path("pieces")); }
  EXPECT_TRUE(find_built(cache, key_of(path("pieces/"))));
  write("pieces/b.csv", "x,y,z\n");
  EXPECT_FALSE(find_built(cache, key_of(path("pieces"))));
}

TEST_F(CacheTest, AnInputThatChangesWhileItIsReadIsSeen) {
  const std::string input = write("a.csv", "x,y,z\n"), linked = write("b.h5", "y");
  const ReadFiles read{.opened = {linked}, .missing = {}};
  const InputWatch watch({input});
  EXPECT_TRUE(watch.is_unchanged(state_of_inputs({input}, read)));
  write("b.h5", "z");
  EXPECT_FALSE(watch.is_unchanged(state_of_inputs({input}, read))) << "written since the watch began";
  const InputWatch second({input});
  EXPECT_TRUE(second.is_unchanged(state_of_inputs({input}, {})));
  write("a.csv", "z,y,x\n");
  EXPECT_FALSE(second.is_unchanged(state_of_inputs({input}, {})));
  const InputWatch third({input});
  fs::remove(path("b.h5"));
  EXPECT_FALSE(third.is_unchanged(state_of_inputs({input}, read))) << "it was opened, and is gone";
}

TEST_F(CacheTest, ADamagedEntryIsNotUsed) {
  const std::string input = write("a.csv", "x,y,z\n");
  BuildCache cache = open();
  const std::vector<void (*)(const std::string&)> damages = {
      [](const std::string& file) { fs::resize_file(file, 100); },
      [](const std::string& file) { fs::remove(file); },
      [](const std::string& file) {
        std::fstream bytes(file, std::ios::in | std::ios::out | std::ios::binary);
        bytes.seekp(0) << '?';
      },
      [](const std::string& file) {
        std::ofstream(fs::path(file).replace_filename("entry.json")) << "{\"inputs\": 1}";
      },
      [](const std::string& file) { fs::remove(fs::path(file).replace_filename("entry.json")); },
  };
  for (const auto& damage : damages) {
    std::string file;
    { file = build(cache, input).file; }
    EXPECT_TRUE(find_built(cache, key_of(input)));
    damage(file);
    EXPECT_FALSE(find_built(cache, key_of(input)));
    EXPECT_THAT(folders(), IsEmpty());
  }
}

TEST_F(CacheTest, OneBuildsAndTheOtherWaits) {
  const std::string input = write("a.csv", "x,y,z\n");
  const CacheKey key = key_of(input);
  BuildCache cache = open(), other_cache = open();
  auto place = std::get<Place>(value_of(cache.find(key, never_waits)));
  std::atomic<int> waits = 0;
  std::optional<Built> other;
  std::thread waiting([&] {
    auto found = other_cache.find(key, [&]() -> Status {
      ++waits;
      return {};
    });
    if (found && std::holds_alternative<Built>(*found)) other.emplace(std::get<Built>(std::move(*found)));
  });
  EXPECT_TRUE(becomes([&] { return waits > 0; }));
  build_at(place.folder() + "/a.svol");
  const Built built = value_of(cache.keep(place, key, "a.svol", state_of_inputs({input}, {}), {}));
  waiting.join();
  ASSERT_TRUE(other);
  EXPECT_EQ(other->file, built.file);
}

TEST_F(CacheTest, ThatWaitEndsWithTheBuilderOrByItsOwnWish) {
  const CacheKey key = key_of(write("a.csv", "x,y,z\n"));
  BuildCache cache = open();
  std::optional<Place> place(std::get<Place>(value_of(cache.find(key, never_waits))));
  EXPECT_EQ(message_of(cache.find(key, never_waits)), "waits");
  const auto give_up = [&]() -> Status {
    place.reset();
    return {};
  };
  EXPECT_TRUE(std::holds_alternative<Place>(value_of(cache.find(key, give_up))));
}

TEST_F(CacheTest, LeftoversOfBuildersThatAreGoneGo) {
  for (const char* file : {"lock", ".splatvol-1"})
    write(std::string("cache/.0123456789abcdef-01234567/") + file, "left");
  BuildCache cache = open();
  EXPECT_THAT(folders(), IsEmpty());
  const Place place = value_of(cache.make_place(key_of("a")));
  (void)open();
  EXPECT_TRUE(fs::exists(place.folder())) << "its builder lives";
}

TEST_F(CacheTest, WhatWasNotUsedForTheLongestTimeGoes) {
  BuildCache large = open();
  std::vector<std::string> inputs, files;
  std::uint64_t bytes = 0;
  for (int i = 0; i < 4; ++i) {
    inputs.push_back(write(fmt::format("{}.csv", i), "x,y,z\n"));
    files.push_back(build(large, inputs.back()).file);
    bytes = fs::file_size(files.back());
    // Entries of different times.
    const timespec times[2] = {{1000 + i, 0}, {1000 + i, 0}};
    ASSERT_EQ(::utimensat(AT_FDCWD, (fs::path(files.back()).parent_path() / "entry.json").c_str(), times, 0), 0);
  }
  EXPECT_TRUE(find_built(large, key_of(inputs[0]))) << "it is the last used now";
  const std::optional<Built> open_one = find_built(large, key_of(inputs[1]));
  const timespec old[2] = {{1, 0}, {1, 0}};
  ASSERT_EQ(::utimensat(AT_FDCWD, (fs::path(files[1]).parent_path() / "entry.json").c_str(), old, 0), 0);

  BuildCache small = open(3 * bytes + bytes / 2);
  const std::string last = build(small, write("last.csv", "x,y,z\n")).file;
  EXPECT_TRUE(fs::exists(last));
  EXPECT_TRUE(fs::exists(files[0]));
  EXPECT_TRUE(fs::exists(files[1])) << "it is open";
  EXPECT_FALSE(fs::exists(files[2]));
}

TEST_F(CacheTest, WhatIsLargerThanTheCacheIsNotKept) {
  const std::string input = write("a.csv", "x,y,z\n");
  BuildCache cache = open(1000);
  auto place = std::get<Place>(value_of(cache.find(key_of(input), never_waits)));
  build_at(place.folder() + "/a.svol");
  const auto kept = cache.keep(place, key_of(input), "a.svol", state_of_inputs({input}, {}), {});
  EXPECT_THAT(kept, FailsWith(ErrorCode::out_of_budget, HasSubstr("and the cache may hold 1000")));
  EXPECT_TRUE(fs::exists(place.folder() + "/a.svol"));
}

TEST_F(CacheTest, ListsAndForgets) {
  const std::string a = write("a.csv", "x,y,z\n"), b = write("b.csv", "x,y,z\n"), c = write("c.csv", "x,y,z\n");
  BuildCache cache = open();
  for (const std::string& input : {a, b}) build(cache, input);
  std::optional<Built> of_c(build(cache, c));
  EXPECT_THAT(value_of(cache.list()), SizeIs(3));
  EXPECT_THAT(value_of(cache.forget({canonical_input(a)})).removed, SizeIs(1));
  const auto forgotten = value_of(cache.forget({}));
  ASSERT_THAT(forgotten.removed, SizeIs(1));
  EXPECT_EQ(forgotten.removed[0].inputs[0], canonical_input(b));
  ASSERT_THAT(forgotten.open, SizeIs(1));
  EXPECT_EQ(forgotten.open[0].inputs[0], canonical_input(c));
  of_c.reset();
  EXPECT_THAT(value_of(cache.forget({})).removed, SizeIs(1));
  EXPECT_THAT(folders(), IsEmpty());
}

}  // namespace
}  // namespace splatvol::test
