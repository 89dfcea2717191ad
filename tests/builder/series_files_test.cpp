// Series of files that several programs change.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>

#include <chrono>
#include <filesystem>
#include <future>
#include <set>
#include <string>
#include <vector>

#include "base/file.h"
#include "base/locked_file.h"
#include "builder/series/series_files.h"
#include "format/series_index.h"
#include "format/volume.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

const auto silent = [](const char*, double) {};

struct SeriesFiles : FolderTest {
  [[nodiscard]] format::SeriesIndex index() const {
    return format::series_index_from_json(read_text_file(path("a.svols")).value()).value();
  }

  // The files that the index names.
  [[nodiscard]] std::vector<std::string> files() const {
    std::vector<std::string> all;
    for (const auto& step : index().steps) all.push_back(step.file);
    return all;
  }

  [[nodiscard]] Result<SeriesReport> build(const std::vector<SeriesStep>& steps, bool append) const {
    return build_series_of_files(steps, path("a.svols"), append, {}, silent);
  }

  void build_or_fail(const std::vector<SeriesStep>& steps, bool append = false) const {
    ASSERT_EQ(message_of(build(steps, append)), "");
  }

  // What another program does that appends a step: the index is another file afterwards.
  void append_elsewhere(double time) const {
    format::SeriesIndex other = index();
    std::filesystem::copy_file(path("a-0000.svol"), path("other.svol"));
    other.steps.push_back({time, "other.svol"});
    EXPECT_TRUE(write_text_file(path("a.svols"), format::to_json(other)));
  }
};

// A step of its own mesh. `meanwhile`: is done while the step is built.
SeriesStep step_at(
    std::optional<double> time, const std::function<void()>& meanwhile = [] {}) {
  const auto open = [time, meanwhile]() -> Result<std::unique_ptr<Source>> {
    meanwhile();
    return std::make_unique<PieceSource>(
        std::vector{mesh_piece(lattice(3), [time](dvec3 p) { return p.x + time.value_or(7); })});
  };
  return {"step", time, open};
}

TEST_F(SeriesFiles, StepsThatAreAppendedMeanwhileStay) {
  build_or_fail({step_at(0)});
  build_or_fail({step_at(2, [&] { append_elsewhere(1); })}, true);
  EXPECT_THAT(files(), ElementsAre("a-0000.svol", "other.svol", "a-0002.svol"));
  EXPECT_EQ(index().attributes[0].range.max, 3);
  EXPECT_THAT(names(), ElementsAre("a-0000.svol", "a-0002.svol", "a.svols", "other.svol"));
}

TEST_F(SeriesFiles, ATimeThatIsNoLongerTheLastIsRefused) {
  build_or_fail({step_at(0)});
  EXPECT_THAT(message_of(build({step_at(2, [&] { append_elsewhere(3); })}, true)),
              HasSubstr("the time 2 is not behind 3, the time of the step before"));
  EXPECT_THAT(files(), ElementsAre("a-0000.svol", "other.svol"));
  EXPECT_THAT(names(), ElementsAre("a-0000.svol", "a.svols", "other.svol"));
}

TEST_F(SeriesFiles, AStepWithoutATimeGetsTheNextOneOfTheIndexThatIsThere) {
  build_or_fail({step_at({})});
  build_or_fail({step_at({}, [&] { append_elsewhere(4.5); })}, true);
  EXPECT_EQ(index().steps.back().time, 5);
}

// The lock of an index that has lost its name protects nothing.
TEST_F(SeriesFiles, AnAppendThatWaitedReadsTheIndexThatHasTheNameThen) {
  build_or_fail({step_at(0)});
  std::promise<void> is_building;
  std::future<Result<SeriesReport>> appended;
  {
    // The append has read the index once, and then waits for the lock.
    std::promise<void> is_locked;
    appended = std::async(std::launch::async, [&] {
      return build({step_at(2,
                            [&] {
                              is_building.set_value();
                              is_locked.get_future().wait();
                            })},
                   true);
    });
    is_building.get_future().wait();
    const auto lock = value_of(LockedFile::open(path("a.svols"), LockedFile::IfTaken::fail));
    is_locked.set_value();
    EXPECT_EQ(appended.wait_for(std::chrono::milliseconds(300)), std::future_status::timeout) << "it did not wait";
    append_elsewhere(1);
  }
  ASSERT_EQ(message_of(appended.get()), "");
  EXPECT_THAT(files(), ElementsAre("a-0000.svol", "other.svol", "a-0002.svol"));
}

TEST_F(SeriesFiles, NumbersOfOtherFilesAreLeftOutAndTold) {
  build_or_fail({step_at(0), step_at(1)});
  write("a-0002.svol", "of an append that was killed");
  write("a-0003.svol", "");
  const auto appended = value_of(build({step_at(2), step_at(3)}, true));
  EXPECT_THAT(files(), ElementsAre("a-0000.svol", "a-0001.svol", "a-0004.svol", "a-0005.svol"));
  ASSERT_EQ(appended.warnings.size(), 1U);
  EXPECT_THAT(appended.warnings[0], HasSubstr(path("a-0002.svol") + ": is there already"));
  EXPECT_THAT(appended.warnings[0], HasSubstr("the step at 2 is a-0004.svol"));
  EXPECT_EQ(read_text_file(path("a-0002.svol")).value(), "of an append that was killed");

  // Later appends have nothing to tell.
  const auto next = value_of(build({step_at(4)}, true));
  EXPECT_THAT(next.warnings, IsEmpty());
  EXPECT_EQ(files().back(), "a-0006.svol");
}

TEST_F(SeriesFiles, ANewSeriesReplacesNoFiles) {
  write("a-0001.svol", "another's");
  bool opened = false;
  const auto built = build({step_at(0, [&] { opened = true; }), step_at(1)}, false);
  ASSERT_FALSE(built);
  EXPECT_THAT(built.error().message, HasSubstr("a-0001.svol: exists already"));
  EXPECT_FALSE(opened) << "refused after the work";
  EXPECT_THAT(names(), ElementsAre("a-0001.svol"));

  // Nor one that appears while it is built.
  std::filesystem::remove(path("a-0001.svol"));
  EXPECT_THAT(message_of(build({step_at(0), step_at(1, [&] { write("a-0001.svol", "another's"); })}, false)),
              HasSubstr("a-0001.svol: exists already"));
  EXPECT_THAT(names(), ElementsAre("a-0001.svol"));
  EXPECT_EQ(read_text_file(path("a-0001.svol")).value(), "another's");
}

TEST_F(SeriesFiles, AFailureLeavesNothing) {
  build_or_fail({step_at(0)});
  const std::string before = read_text_file(path("a.svols")).value();
  SeriesStep broken = step_at(2);
  broken.open = []() -> Result<std::unique_ptr<Source>> { return fail(ErrorCode::io, "broken"); };
  EXPECT_FALSE(build({step_at(1), broken}, true));
  EXPECT_FALSE(build({step_at(1), step_at(0.5)}, true));
  EXPECT_THAT(names(), ElementsAre("a-0000.svol", "a.svols"));
  EXPECT_EQ(read_text_file(path("a.svols")).value(), before);
}

// A folder stands where the index shall be: it cannot get its name.
TEST_F(SeriesFiles, AnIndexThatCannotGetItsNameTakesItsFilesAlong) {
  const auto built = build({step_at(0, [&] { std::filesystem::create_directory(path("a.svols")); })}, false);
  ASSERT_FALSE(built);
  EXPECT_THAT(names(), ElementsAre("a.svols"));
}

TEST_F(SeriesFiles, AppendsAtOnceLoseNoStep) {
  build_or_fail({step_at({})});
  constexpr int appends = 12;
  std::vector<std::future<Result<SeriesReport>>> all;
  for (int i = 0; i < appends; ++i)
    all.push_back(std::async(std::launch::async, [&] { return build({step_at({}), step_at({})}, true); }));
  for (auto& appended : all) {
    EXPECT_EQ(message_of(appended.get()), "");
  }
  const std::vector<std::string> named = files();
  EXPECT_EQ(named.size(), 1U + 2 * appends);
  EXPECT_EQ(std::set<std::string>(named.begin(), named.end()).size(), named.size());
  for (const std::string& file : named) EXPECT_TRUE(std::filesystem::exists(path(file))) << file;
  EXPECT_EQ(names().size(), named.size() + 1);
}

}  // namespace
}  // namespace splatvol::test
