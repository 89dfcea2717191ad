// The sections "contours" and "measure": sizes, numbers and exports.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tests/viewer/viewer_fixture.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

struct MeasuresInAWindow : ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    build_mesh(lattice(8), [](dvec3 p) { return glm::distance(p, dvec3(0.5)); }, path("ball.svol"),
               {.keep_cells = true});
    resize(800, 600);
  }
  // A file of which nothing else is shown: the sections that are open at first are closed.
  void open_ball() {
    open({.volume = path("ball.svol")});
    settle();
    for (const double y : {397.0, 62.0}) click_and_settle(160, y);
  }
  void click_and_settle(double x, double y) {
    click(x, y);
    settle();
  }
  [[nodiscard]] std::string text() const {
    std::string all;
    for (const Messages::Message& message : viewer->messages().all()) all += message.text + "\n";
    return all;
  }
  // Whether a part of the panel differs from what it was.
  [[nodiscard]] std::vector<vec4> rows(int top, int bottom) {
    std::vector<vec4> pixels;
    const Image image = screen();
    for (int y = top; y < bottom; ++y)
      for (int x = 0; x < 336; ++x) pixels.push_back(image.at(x, y));
    return pixels;
  }
};

constexpr double contours_y = 187, measure_y = 237;

// The row below the value has the size .3 s after the last change.
TEST_F(MeasuresInAWindow, AContourHasItsSize) {
  open_ball();
  click_and_settle(160, contours_y);
  frame_seconds = 0.01;
  click(40, contours_y + 22);  // "add contour"
  ASSERT_EQ(scene().contours.size(), 1u);
  frame({PointerMoved{-1, -1}});
  for (int i = 0; i < 3; ++i) frame({});
  const int top = static_cast<int>(contours_y) + 82, bottom = top + 20;
  const std::vector<vec4> unknown = rows(top, bottom);
  settle();
  EXPECT_TRUE(rows(top, bottom) != unknown);
}

TEST_F(MeasuresInAWindow, AContourIsExported) {
  open_ball();
  click_and_settle(160, contours_y);
  click_and_settle(40, contours_y + 22);
  const auto before = std::filesystem::current_path();
  std::filesystem::current_path(path());
  click_and_settle(33, contours_y + 92);  // "export"
  std::filesystem::current_path(before);
  EXPECT_THAT(text(), HasSubstr("saved ball.vtp: "));
  EXPECT_GT(std::filesystem::file_size(path("ball.vtp")), 1000u);
}

// Numbers appear, and are grey once the region is another one.
TEST_F(MeasuresInAWindow, NumbersOfWhatIsSeen) {
  open_ball();
  click_and_settle(160, measure_y);
  frame({PointerMoved{-1, -1}});
  settle();
  const std::vector<vec4> nothing = rows(355, 485);
  click_and_settle(40, measure_y + 91);  // "measure"
  frame({PointerMoved{-1, -1}});
  settle();
  const std::vector<vec4> numbers = rows(355, 485);
  EXPECT_TRUE(numbers != nothing) << text();
  viewer->session()->scene.clip_box = Box{dvec3(0), dvec3(0.5)};
  settle();
  EXPECT_TRUE(rows(355, 485) != numbers);
  EXPECT_EQ(text(), "");
}

}  // namespace
}  // namespace splatvol::test
