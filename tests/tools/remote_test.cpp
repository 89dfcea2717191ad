// The programs on a file of a web server.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <sstream>

#include "pictures/image.h"
#include "tests/support/nginx.h"
#include "tests/support/programs.h"
#include "tests/support/test_volume.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

struct ProgramsOnUrl : ProgramTest {
  void SetUp() override {
    nginx_ = Nginx::start(folder_);
    if (!nginx_) GTEST_SKIP() << "no nginx on this machine (package nginx)";
    ASSERT_TRUE(write_test_volume(volume_of_x(1000), path("v.svol")));
  }

  // Bytes that the server has sent.
  std::uint64_t sent_bytes() const {
    std::istringstream log(read("access.log"));
    std::uint64_t sum = 0;
    for (std::string line; std::getline(log, line);) {
      std::istringstream words(line);
      std::uint64_t status = 0, bytes = 0;
      if (words >> status >> bytes) sum += bytes;
    }
    return sum;
  }

  std::uint64_t requests() const {
    const std::string log = read("access.log");
    return static_cast<std::uint64_t>(std::ranges::count(log, '\n'));
  }

  std::unique_ptr<Nginx> nginx_;
};

TEST_F(ProgramsOnUrl, DrawThePictureOfTheFile) {
  expect_done("svinfo v.svol --scene s.json");
  expect_done("svrender v.svol --scene s.json -o near.exr --size 64x64 --tolerance 0");
  std::string secret = nginx_->url("v.svol?token=abc");
  secret.replace(0, 7, "http://user:pass@");
  expect_done(
      fmt::format("svrender '{}' --scene s.json -o far.exr --size 64x64 --tolerance 0 --stats stats.json", secret));
  EXPECT_EQ(read_exr(path("far.exr")).value().pixels, read_exr(path("near.exr")).value().pixels);
  for (const char* file : {"stats.json", "far.exr"}) {
    EXPECT_THAT(read(file), HasSubstr(nginx_->url("v.svol")));
    EXPECT_THAT(read(file), Not(HasSubstr("pass"))) << "what is secret ends up in a picture";
    EXPECT_THAT(read(file), Not(HasSubstr("token")));
  }
}

TEST_F(ProgramsOnUrl, SayWhatIsInIt) {
  std::string near = run("svinfo v.svol").out;
  near.replace(near.find("v.svol"), 6, nginx_->url("v.svol"));
  EXPECT_EQ(run(fmt::format("svinfo {} --verify", nginx_->url("v.svol"))).text, near + "\nevery byte checked\n");

  EXPECT_EQ(run(fmt::format("svinfo {}", nginx_->url("missing.svol"))).text,
            fmt::format("svinfo: {}: the server answers 404: not found\n", nginx_->url("missing.svol")));
}

// The files of a series lie beside its index. What the address of the index has for its server, theirs have too.
TEST_F(ProgramsOnUrl, PlaySeriesOfFiles) {
  write("f.svols", R"({"steps": [{"time": 2.5, "file": "v.svol"}],
    "attributes": [{"name": "a0", "unit": "", "min": 0, "max": 1}]})");
  std::string secret = nginx_->url("f.svols?token=abc");
  secret.replace(0, 7, "http://user:pass@");
  EXPECT_THAT(run(fmt::format("svinfo '{}' --time 2", secret)).out, HasSubstr(nginx_->url("v.svol")));
  EXPECT_EQ(run(fmt::format("svinfo '{}' --step 1", secret)).text,
            fmt::format("svinfo: {}: no step 1; the last is 0\n", nginx_->url("f.svols")));
}

// Cells of a box are as those of the file itself, and a small part of the file is read for them.
TEST_F(ProgramsOnUrl, ExportCellsOfABox) {
  expect_done("svbuild gen:mesh:cells=4e5 -o mesh.svol");
  for (const std::string box : {"--box 0.5,0.5,0.5,0.52,0.52,0.52", ""}) {
    expect_done(fmt::format("svexport mesh.svol -o near.vtu --cells {}", box));
    const std::uint64_t before = sent_bytes();
    expect_done(fmt::format("svexport {} -o far.vtu --cells {}", nginx_->url("mesh.svol"), box));
    EXPECT_TRUE(read("far.vtu") == read("near.vtu")) << box;
    const std::uint64_t sent = sent_bytes() - before, file = std::filesystem::file_size(path("mesh.svol"));
    EXPECT_LT(sent, box.empty() ? file : file / 10);
    EXPECT_GT(sent, 0U);
  }
}

// A contour and a line, too: each reads the chunks that it meets, by few requests.
TEST_F(ProgramsOnUrl, ExportContoursAndLines) {
  expect_done("svbuild gen:mesh:cells=4e5 -o mesh.svol");
  const std::uint64_t file = std::filesystem::file_size(path("mesh.svol"));
  for (const std::string arguments : {"near.vtp --contour 0.5", "near.csv --line 0.1,0.2,-1:0.15,0.1,1"}) {
    std::string far = arguments;
    far.replace(0, 4, "far");
    expect_done("svexport mesh.svol -o " + arguments);
    const std::uint64_t before = sent_bytes(), requests_before = requests();
    expect_done(fmt::format("svexport {} -o {}", nginx_->url("mesh.svol"), far));
    EXPECT_LE(requests() - requests_before, 20) << arguments;
    const std::string kind = arguments.substr(4, 4);
    EXPECT_TRUE(read("far" + kind) == read("near" + kind)) << kind;
    EXPECT_LT(sent_bytes() - before, file / 3) << kind;
  }
}

// A cold exact view of a twentieth of the volume reads little of the cells and points, by few requests.
TEST_F(ProgramsOnUrl, DrawCellsByFewRequests) {
  expect_done("svbuild gen:mesh:cells=1e6 -o mesh.svol");
  expect_done("svinfo mesh.svol --scene s.json");
  std::string scene = read("s.json");
  scene.insert(scene.find('{') + 1, R"("clip_box": {"low": [-1.3, -0.9, -0.7], "high": [-0.13, 0.27, 0.47]},)");
  write("s.json", scene);
  expect_done("svrender mesh.svol --scene s.json --exact -o near.exr --size 64x64");
  const std::uint64_t bytes_before = sent_bytes(), before = requests();
  expect_done(fmt::format("svrender {} --scene s.json --exact -o far.exr --size 64x64", nginx_->url("mesh.svol")));
  EXPECT_EQ(read_exr(path("far.exr")).value().pixels, read_exr(path("near.exr")).value().pixels);
  const std::uint64_t sent = sent_bytes() - bytes_before;
  EXPECT_LE(requests() - before, 12 + sent / (std::uint64_t{256} << 10));
  EXPECT_LT(sent, std::filesystem::file_size(path("mesh.svol")) / 6);
}

// Index pages of a level come together, and so do rows.
TEST_F(ProgramsOnUrl, DrawSplatsByFewRequests) {
  expect_done("svbuild gen:mesh:cells=1e6 -o mesh.svol");
  const std::uint64_t bytes_before = sent_bytes(), before = requests();
  expect_done(fmt::format("svrender {} --splats 100000 -o far.exr --size 256x256", nginx_->url("mesh.svol")));
  EXPECT_LE(requests() - before, 20 + (sent_bytes() - bytes_before) / (std::uint64_t{512} << 10));
  expect_done("svrender mesh.svol --splats 100000 -o near.exr --size 256x256");
  EXPECT_EQ(read_exr(path("far.exr")).value().pixels, read_exr(path("near.exr")).value().pixels);
}

}  // namespace
}  // namespace splatvol::test
