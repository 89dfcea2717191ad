#include "player/conversion.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <unistd.h>

#include <filesystem>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "base/interruption.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

// A script stands for svbuild: what it tells is chosen by each test.
class ConversionTest : public FolderTest {
 protected:
  ConversionTest() { write("kept.svol", "kept"); }

  [[nodiscard]] std::string script(const std::string& lines) const {
    const std::string program = write("svbuild", "#!/bin/sh\ncd " + path() + "\necho \"$@\" > arguments\n" + lines);
    std::filesystem::permissions(program, std::filesystem::perms::owner_all);
    return program;
  }
  [[nodiscard]] std::string result(bool is_temporary) const {
    return "echo '{\"result\":{\"file\":\"" + path("kept.svol") +
           "\",\"built\":true,\"temporary\":" + (is_temporary ? "true" : "false") +
           ",\"seconds\":1,\"notes\":[\"a note\"]}}'\n";
  }
  Result<ConvertedFile> converted(const std::string& lines) {
    return convert(
        {{"a b.vtu", "c.vtu"}}, [&](const ConversionProgress& progress) { told_.push_back(progress); }, script(lines));
  }
  [[nodiscard]] bool has(const std::string& name) const { return std::filesystem::exists(path(name)); }

  // Whether the file may be removed: nobody else has a lock on it.
  [[nodiscard]] bool is_free() const {
    const int descriptor = ::open(path("kept.svol").c_str(), O_RDONLY | O_CLOEXEC);
    const bool is_free = ::flock(descriptor, LOCK_EX | LOCK_NB) == 0;
    ::close(descriptor);
    return is_free;
  }

  std::vector<ConversionProgress> told_;
};

TEST_F(ConversionTest, TellsProgressAndKeepsTheFile) {
  auto file =
      value_of(converted("echo '{\"stage\":\"read\",\"share\":0.25,\"seconds_left\":null}'\n"
                         "echo '{\"preview\":\"p.svol\"}'\n"
                         "echo '{\"stage\":\"sort\",\"share\":0.5,\"seconds_left\":3}'\n" +
                         result(false) + "cat > rest\ntouch ended\n"));
  EXPECT_EQ(file.path, path("kept.svol"));
  EXPECT_TRUE(file.was_built);
  EXPECT_FALSE(file.is_temporary);
  EXPECT_THAT(file.notes, ElementsAre("a note"));
  ASSERT_EQ(told_.size(), 3u);
  EXPECT_EQ(told_[0].stage, "read");
  EXPECT_EQ(told_[0].share, 0.25);
  EXPECT_FALSE(told_[0].seconds_left);
  EXPECT_FALSE(told_[0].has_preview);
  EXPECT_TRUE(told_[1].has_preview);
  EXPECT_EQ(told_[1].share, 0.25);
  EXPECT_TRUE(told_[2].has_preview);
  EXPECT_EQ(told_[2].seconds_left, 3);
  EXPECT_TRUE(has("ended"));
  EXPECT_EQ(read("arguments"), "--cached --progress -- a b.vtu c.vtu\n");
  EXPECT_FALSE(is_free());
  file.lease.reset();
  EXPECT_TRUE(is_free());
}

TEST_F(ConversionTest, SvbuildStaysWithATemporaryFile) {
  auto file = value_of(
      converted("trap 'touch ended; exit 1' INT\n" + result(true) + "while read word; do :; done\ntouch ended\n"));
  EXPECT_TRUE(file.is_temporary);
  EXPECT_FALSE(has("ended"));
  file.lease.reset();
  EXPECT_TRUE(has("ended"));
}

TEST_F(ConversionTest, AsksForStepsAndAPreview) {
  const std::string program = script(result(false));
  static_cast<void>(value_of(convert({{"-a.vtu"}, true, "p.svol"}, {}, program)));
  EXPECT_EQ(read("arguments"), "--cached --progress --times all --preview p.svol -- -a.vtu\n");
}

TEST_F(ConversionTest, FailsAsSvbuildDoes) {
  const auto file = converted("echo '{\"error\":\"a b.vtu: not XML\"}'\nexit 1\n");
  ASSERT_FALSE(file);
  EXPECT_EQ(file.error().message, "a b.vtu: not XML");
}

TEST_F(ConversionTest, FailsWhereSvbuildTellsNothing) {
  EXPECT_THAT(converted("exit 3\n").error().message, AllOf(HasSubstr("a b.vtu: "), HasSubstr("exit code 3")));
  EXPECT_THAT(converted("kill -9 $$\n").error().message, HasSubstr("by a signal"));
  EXPECT_THAT(converted("echo nonsense\n").error().message, HasSubstr("of another version"));
  EXPECT_THAT(converted("echo '{\"stage\":1,\"share\":2}'\n").error().message, HasSubstr("stage"));
  EXPECT_THAT(convert({{"a.vtu"}}, {}, path("none")).error().message,
              AllOf(HasSubstr("a.vtu: svbuild converts meshes"), HasSubstr("install it")));
}

TEST_F(ConversionTest, FailsIfTheFileIsNotThere) {
  std::filesystem::remove(path("kept.svol"));
  EXPECT_THAT(converted(result(false)).error().message, HasSubstr("kept.svol: cannot open"));
}

TEST_F(ConversionTest, AnInterruptionEndsSvbuild) {
  const auto stop = std::make_unique<std::stop_source>();  // GCC 12 takes one on the stack for uninitialized
  const Interruptible interruptible(stop->get_token());
  const std::string program = script(
      "trap 'touch interrupted; exit 1' INT\n"
      "echo '{\"stage\":\"read\",\"share\":0,\"seconds_left\":null}'\n"
      "while read word; do :; done\n");
  const auto file = convert(
      {{"a.vtu"}}, [&](const ConversionProgress&) { stop->request_stop(); }, program);
  ASSERT_FALSE(file);
  EXPECT_EQ(file.error().code, ErrorCode::cancelled);
  EXPECT_TRUE(has("interrupted"));
}

}  // namespace
}  // namespace splatvol::test
