// The programs on a file of a web server.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>

#include "base/file.h"
#include "pictures/image.h"
#include "tests/support/nginx.h"
#include "tests/support/test_volume.h"

namespace splatvol {
namespace {

using testing::HasSubstr;
using testing::Not;

class ProgramsOnUrl : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "splatvol_remote_programs.XXXXXX").string();
    folder_ = ::mkdtemp(name.data());
    nginx_ = test::Nginx::start(folder_);
    if (!nginx_) GTEST_SKIP() << "no nginx on this machine (package nginx)";
    const auto points = test::random_points(1000, 1);
    std::vector<double> values;
    for (const dvec3& p : points) values.push_back(p.x);
    ASSERT_TRUE(test::write_test_volume(test::make_test_volume(points, {values}), path("v.svol")));
  }
  void TearDown() override {
    nginx_.reset();
    std::filesystem::remove_all(folder_);
  }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string content(const std::string& name) const { return read_text_file(path(name)).value(); }

  // Runs a program in the folder. Its output is in out.txt and err.txt.
  bool run(const std::string& command) const {
    return std::system(
               fmt::format("cd '{}' && '{}'/{} >out.txt 2>err.txt", folder_.string(), SPLATVOL_BIN, command).c_str()) ==
           0;
  }

  std::filesystem::path folder_;
  std::unique_ptr<test::Nginx> nginx_;
};

TEST_F(ProgramsOnUrl, DrawThePictureOfTheFile) {
  ASSERT_TRUE(run("svinfo v.svol --scene s.json")) << content("err.txt");
  ASSERT_TRUE(run("svrender v.svol --scene s.json -o near.exr --size 64x64")) << content("err.txt");
  std::string secret = nginx_->url("v.svol?token=abc");
  secret.replace(0, 7, "http://user:pass@");
  ASSERT_TRUE(run(fmt::format("svrender '{}' --scene s.json -o far.exr --size 64x64 --stats stats.json", secret)))
      << content("err.txt");
  EXPECT_EQ(read_exr(path("far.exr")).value().pixels, read_exr(path("near.exr")).value().pixels);
  for (const char* file : {"stats.json", "far.exr"}) {
    EXPECT_THAT(content(file), HasSubstr(nginx_->url("v.svol")));
    EXPECT_THAT(content(file), Not(HasSubstr("pass"))) << "what is secret ends up in a picture";
    EXPECT_THAT(content(file), Not(HasSubstr("token")));
  }
}

TEST_F(ProgramsOnUrl, SayWhatIsInIt) {
  ASSERT_TRUE(run("svinfo v.svol"));
  std::string near = content("out.txt");
  ASSERT_TRUE(run(fmt::format("svinfo {} --verify", nginx_->url("v.svol")))) << content("err.txt");
  near.replace(near.find("v.svol"), 6, nginx_->url("v.svol"));
  EXPECT_EQ(content("out.txt"), near + "\nevery byte checked\n");

  EXPECT_FALSE(run(fmt::format("svinfo {}", nginx_->url("missing.svol"))));
  EXPECT_EQ(content("err.txt"),
            fmt::format("svinfo: {}: the server answers 404: not found\n", nginx_->url("missing.svol")));
}

// The files of a series lie beside its index. What the address of the index has for its server, theirs have too.
TEST_F(ProgramsOnUrl, PlaySeriesOfFiles) {
  ASSERT_TRUE(write_text_file(path("f.svols"), R"({"steps": [{"time": 2.5, "file": "v.svol"}],
    "attributes": [{"name": "a0", "unit": "", "min": 0, "max": 1}]})"));
  std::string secret = nginx_->url("f.svols?token=abc");
  secret.replace(0, 7, "http://user:pass@");
  ASSERT_TRUE(run(fmt::format("svinfo '{}' --time 2", secret))) << content("err.txt");
  EXPECT_THAT(content("out.txt"), HasSubstr(nginx_->url("v.svol")));
  EXPECT_FALSE(run(fmt::format("svinfo '{}' --step 1", secret)));
  EXPECT_EQ(content("err.txt"), fmt::format("svinfo: {}: no step 1; the last is 0\n", nginx_->url("f.svols")));
}

}  // namespace
}  // namespace splatvol
