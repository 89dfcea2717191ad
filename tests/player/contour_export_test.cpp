// Contours exported by another program. A script stands for svexport.
#include "player/contour_export.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <stop_token>
#include <vector>

#include "base/file.h"
#include "base/interruption.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class ContourExport : public FolderTest {
 protected:
  Result<std::uint64_t> exported(const std::string& lines) {
    const std::string program =
        write("svexport", "#!/bin/sh\nprintf '%s\\n' \"$@\" > " + path("arguments") + "\n" + lines);
    std::filesystem::permissions(program, std::filesystem::perms::owner_all);
    return export_contour_aside(
        request_, [&](double share) { told_.push_back(share); }, program);
  }

  ContourExportRequest request_{"a b.svol", {}, "p", 0.1, "out.vtp"};
  std::vector<double> told_;
};

TEST_F(ContourExport, TellsProgressAndTriangles) {
  EXPECT_EQ(value_of(exported("echo '{\"share\":0.25}'\necho '{\"share\":0.5}'\n"
                              "echo '{\"result\":{\"triangles\":12,\"area\":1}}'\n")),
            12u);
  EXPECT_THAT(told_, ElementsAre(0.25, 0.5));
  EXPECT_EQ(value_of(read_text_file(path("arguments"))),
            "--progress\n--attribute=p\n--contour=0.1\n--output=out.vtp\n--\na b.svol\n");
  request_.step = 3, request_.replaces = true;
  EXPECT_EQ(value_of(exported("echo '{\"result\":{\"triangles\":0}}'\n")), 0u);
  EXPECT_THAT(value_of(read_text_file(path("arguments"))), HasSubstr("--step=3\n--force\n"));
}

TEST_F(ContourExport, FailsAsTheProgramDoes) {
  EXPECT_EQ(message_of(exported("echo '{\"error\":\"a b.svol: no attribute\"}'\nexit 1\n")), "a b.svol: no attribute");
  EXPECT_THAT(message_of(exported("exit 3\n")), HasSubstr("ended with exit code 3"));
  EXPECT_THAT(message_of(exported("echo nonsense\n")), HasSubstr("another version"));
  EXPECT_THAT(message_of(export_contour_aside(
                  request_, [](double) {}, path("none"))),
              HasSubstr("svexport writes"));
}

TEST_F(ContourExport, HeedsAnInterruption) {
  std::stop_source stop;
  stop.request_stop();
  const Interruptible interruptible(stop.get_token());
  const auto result = exported("sleep 60\n");
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::cancelled);
}

}  // namespace
}  // namespace splatvol::test
