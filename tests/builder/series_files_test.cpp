// Series of files that several programs change.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <future>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "base/file.h"
#include "base/locked_file.h"
#include "builder/series/series_files.h"
#include "format/series_index.h"
#include "format/volume.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/require.h"

namespace splatvol {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const auto silent = [](const char*, double) {};

class SeriesFiles : public testing::Test {
 protected:
  SeriesFiles() { test::require(::mkdtemp(folder_.data()) != nullptr, folder_); }
  ~SeriesFiles() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] std::string path(const std::string& name) const { return folder_ + "/" + name; }

  // Names in the folder, sorted.
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) all.push_back(entry.path().filename());
    std::ranges::sort(all);
    return all;
  }

  [[nodiscard]] format::SeriesIndex index() const {
    return format::series_index_from_json(read_text_file(path("a.svols")).value()).value();
  }

  // The files that the index names.
  [[nodiscard]] std::vector<std::string> files() const {
    std::vector<std::string> all;
    for (const auto& step : index().steps) all.push_back(step.file);
    return all;
  }

  void write(const std::string& name, const std::string& text) const {
    const Status written = write_text_file(path(name), text);
    ASSERT_TRUE(written) << written.error().message;
  }

  [[nodiscard]] Result<SeriesReport> build(const std::vector<SeriesStep>& steps, bool append) const {
    return build_series_of_files(steps, path("a.svols"), append, {}, silent);
  }

  void build_or_fail(const std::vector<SeriesStep>& steps, bool append = false) const {
    const auto built = build(steps, append);
    ASSERT_TRUE(built) << built.error().message;
  }

  // What another program does that appends a step: the index is another file afterwards.
  void append_elsewhere(double time) const {
    format::SeriesIndex other = index();
    std::filesystem::copy_file(path("a-0000.svol"), path("other.svol"));
    other.steps.push_back({time, "other.svol"});
    write("a.svols", format::to_json(other));
  }

 private:
  std::string folder_ = (std::filesystem::path(testing::TempDir()) / "splatvol-series-files-XXXXXX").string();
};

// A step of its own mesh. `meanwhile`: is done while the step is built.
SeriesStep step_at(
    std::optional<double> time, const std::function<void()>& meanwhile = [] {}) {
  const auto open = [time, meanwhile]() -> Result<std::unique_ptr<Source>> {
    meanwhile();
    const test::Mesh mesh = test::lattice(3, [](dvec3 p) { return p; });
    return std::make_unique<test::PieceSource>(
        std::vector{test::mesh_piece(mesh, [time](dvec3 p) { return p.x + time.value_or(7); })});
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
  const auto appended = build({step_at(2, [&] { append_elsewhere(3); })}, true);
  ASSERT_FALSE(appended);
  EXPECT_THAT(appended.error().message, HasSubstr("the time 2 is not behind 3, the time of the step before"));
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
    const auto lock = LockedFile::open(path("a.svols"), LockedFile::IfTaken::fail);
    EXPECT_TRUE(lock) << lock.error().message;
    is_locked.set_value();
    EXPECT_EQ(appended.wait_for(std::chrono::milliseconds(300)), std::future_status::timeout) << "it did not wait";
    append_elsewhere(1);
  }
  const auto report = appended.get();
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_THAT(files(), ElementsAre("a-0000.svol", "other.svol", "a-0002.svol"));
}

TEST_F(SeriesFiles, NumbersOfOtherFilesAreLeftOutAndTold) {
  build_or_fail({step_at(0), step_at(1)});
  write("a-0002.svol", "of an append that was killed");
  write("a-0003.svol", "");
  const auto appended = build({step_at(2), step_at(3)}, true);
  ASSERT_TRUE(appended) << appended.error().message;
  EXPECT_THAT(files(), ElementsAre("a-0000.svol", "a-0001.svol", "a-0004.svol", "a-0005.svol"));
  ASSERT_EQ(appended->warnings.size(), 1U);
  EXPECT_THAT(appended->warnings[0], HasSubstr(path("a-0002.svol") + ": is there already"));
  EXPECT_THAT(appended->warnings[0], HasSubstr("the step at 2 is a-0004.svol"));
  EXPECT_EQ(read_text_file(path("a-0002.svol")).value(), "of an append that was killed");

  // Later appends have nothing to tell.
  const auto next = build({step_at(4)}, true);
  ASSERT_TRUE(next) << next.error().message;
  EXPECT_THAT(next->warnings, IsEmpty());
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
  const auto late = build({step_at(0), step_at(1, [&] { write("a-0001.svol", "another's"); })}, false);
  ASSERT_FALSE(late);
  EXPECT_THAT(late.error().message, HasSubstr("a-0001.svol: exists already"));
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
    const auto report = appended.get();
    EXPECT_TRUE(report) << report.error().message;
  }
  const std::vector<std::string> named = files();
  EXPECT_EQ(named.size(), 1U + 2 * appends);
  EXPECT_EQ(std::set<std::string>(named.begin(), named.end()).size(), named.size());
  for (const std::string& file : named) EXPECT_TRUE(std::filesystem::exists(path(file))) << file;
  EXPECT_EQ(names().size(), named.size() + 1);
}

}  // namespace
}  // namespace splatvol
