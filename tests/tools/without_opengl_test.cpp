// svrender in a build without OpenGL.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "pictures/image.h"
#include "tests/support/programs.h"
#include "tests/support/test_volume.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

struct WithoutOpenGl : ProgramTest {
  [[nodiscard]] Outcome run(const std::string& arguments) const {
    return run_in(folder_, fmt::format("'{}' {}", SPLATVOL_SVRENDER_WITHOUT_OPENGL, arguments));
  }
};

TEST_F(WithoutOpenGl, SvrenderDraws) {
  ASSERT_TRUE(write_test_volume(volume_of_x(500), path("v.svol")));
  for (const char* device : {"auto", "cpu"}) {
    const Outcome outcome = run(fmt::format("v.svol -o {}.exr --device {}", device, device));
    ASSERT_EQ(outcome.code, 0) << outcome.text;
    EXPECT_GT(compare_images(read_exr(path(fmt::format("{}.exr", device))).value(), read_exr(path("auto.exr")).value())
                  ->mean_a,
              0.001);
  }
  const Outcome outcome = run("v.svol -o gl.exr --device gl");
  EXPECT_EQ(outcome.code, 2);
  EXPECT_THAT(outcome.text, HasSubstr("built without OpenGL: take --device cpu"));
}

TEST_F(WithoutOpenGl, SvrenderNeedsNoLibraryOfIt) {
  const Outcome outcome = run_in(folder_, fmt::format("ldd '{}'", SPLATVOL_SVRENDER_WITHOUT_OPENGL));
  ASSERT_EQ(outcome.code, 0) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("libtbb"));
  for (const char* library : {"libEGL", "libGL", "libOpenGL", "libepoxy", "libX11", "libglfw"})
    EXPECT_THAT(outcome.text, Not(HasSubstr(library)));
}

}  // namespace
}  // namespace splatvol::test
