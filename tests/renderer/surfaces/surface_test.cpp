// Which files of a scene's surfaces are read.
#include "renderer/surfaces/surface.h"
#include "tests/support/results.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace splatvol {
namespace {

using namespace ::testing;

struct ReadSurfaces : testing::Test {
  ReadSurface reader() {
    return [this](const std::string& path) -> Result<TriangleMesh> {
      asked_.push_back(path);
      if (path == "bad") return fail(ErrorCode::io, "bad: gone");
      return TriangleMesh{{dvec3(0), dvec3(1, 0, 0), dvec3(0, 1, 0)}, {{0, 1, 2}}};
    };
  }
  std::vector<std::string> asked_;
};

TEST_F(ReadSurfaces, EachFileThatIsShownIsReadOnce) {
  const std::vector<SceneSurface> styles{{.file = "a"}, {.file = "b", .shown = false}, {.file = "a", .opacity = 0.5}};
  const auto surfaces = read_surfaces(styles, {reader(), {}});
  ASSERT_TRUE(surfaces);
  EXPECT_THAT(asked_, ElementsAre("a"));
  EXPECT_EQ((*surfaces)[0].mesh, (*surfaces)[2].mesh);
  EXPECT_FALSE((*surfaces)[1].mesh);
  EXPECT_FALSE((*surfaces)[1].is_visible());

  asked_.clear();
  const auto after = read_surfaces(std::vector<SceneSurface>{{.file = "b"}, {.file = "a"}}, {reader(), {}}, *surfaces);
  ASSERT_TRUE(after);
  EXPECT_THAT(asked_, ElementsAre("b")) << "a is there";
}

TEST_F(ReadSurfaces, PatchesHaveAReaderOfTheirOwn) {
  const std::vector<SceneSurface> styles{{.boundary = "a"}, {.boundary = "a"}, {.shown = false, .boundary = "b"}};
  const auto surfaces = test::value_of(read_surfaces(styles, {{}, reader()}));
  EXPECT_THAT(asked_, ElementsAre("a"));
  EXPECT_EQ((surfaces)[0].mesh, (surfaces)[1].mesh);
  EXPECT_FALSE((surfaces)[2].mesh);
  ASSERT_TRUE(read_surfaces(std::vector<SceneSurface>{{.file = "a"}}, {reader(), {}}, surfaces));
  EXPECT_THAT(asked_, ElementsAre("a", "a")) << "a file is no patch";
}

TEST_F(ReadSurfaces, FailsIfAFileCannotBeRead) {
  EXPECT_EQ(read_surfaces(std::vector<SceneSurface>{{.file = "bad"}}, {reader(), {}}).error().message, "bad: gone");
  EXPECT_THAT(test::message_of(read_surfaces(std::vector<SceneSurface>{{.file = "a"}}, {})), HasSubstr("svrender"));
  EXPECT_TRUE(read_surfaces(std::vector<SceneSurface>{{.file = "a", .shown = false}}, {}));
  EXPECT_THAT(*read_surfaces({}, {}), IsEmpty());
}

}  // namespace
}  // namespace splatvol
