// Pins and lines in the viewer, by events.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "base/file.h"
#include "format/splat_reader.h"
#include "player/cell_ray.h"
#include "sampler/line_export.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/viewer/viewer_fixture.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

namespace fs = std::filesystem;

constexpr int width = 1100, height = 1200, panel = 336;

double linear(dvec3 p) { return 3 + p.x - 2 * p.y + 0.5 * p.z; }

struct ViewerLines : ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    present_ = fs::current_path();
    fs::current_path(fs::path(path("m.svol")).parent_path());  // files are saved here
    resize(width, height);
  }
  void TearDown() override { fs::current_path(present_); }

  void open_mesh(bool keeps_cells = true) {
    build_mesh(lattice(12), linear, path("m.svol"), {.keep_cells = keeps_cells});
    open({.volume = path("m.svol")});
    settle();
  }
  void click_and_settle(double x, double y) {
    click(x, y);
    settle();
  }
  void click_with_shift(double x, double y) {
    frame({KeyChanged{key::left_shift, true}});
    click(x, y);
    frame({KeyChanged{key::left_shift, false}});
    settle();
  }
  // From the middle of the picture.
  static constexpr double from_x = panel + 360, from_y = 480, to_x = panel + 420, to_y = 560;
  void show_line() {
    click_and_settle(from_x, from_y);
    click_with_shift(to_x, to_y);
  }

  // What is at a position in the window.
  [[nodiscard]] Pick found(double x, double y) const {
    const Session& session = *viewer->session();
    const Looking looking = looking_through(session.view(), std::floor(x - panel) + 0.5, std::floor(y) + 0.5);
    const auto cells = session.cells_for_picks();
    return value_of(pick_cells(*cells->kept, session.drawn_scene(), session.surfaces(), looking.ray)).value();
  }
  // The panel's section "line" begins below those that are closed; of a series, below the controls of its steps.
  void open_section(double y = section_y) { click_and_settle(100, y); }
  static constexpr double section_y = 796, from_y_field = 821, save_table_y = 962, save_plot_y = 1006, steps_y = 1028;
  static constexpr double of_series = 72;

  [[nodiscard]] std::string newest_message() const {
    const auto toasts = viewer->messages().toasts();
    return toasts.empty() ? "" : toasts.back().text;
  }

  // The rows of a table.
  static std::vector<std::vector<double>> rows_of(const std::string& text) {
    std::vector<std::vector<double>> rows;
    std::istringstream lines(text);
    std::string line, field;
    std::getline(lines, line);
    while (std::getline(lines, line)) {
      std::istringstream fields(line);
      rows.emplace_back();
      while (std::getline(fields, field, ',')) rows.back().push_back(std::stod(field));
    }
    return rows;
  }

  fs::path present_;
};

TEST_F(ViewerLines, EndsWhereShiftAndAClickHitAndIsSavedAsByTheExport) {
  open_mesh();
  show_line();
  open_section();
  click_and_settle(50, save_table_y);
  const auto saved = read_text_file("m-line.csv");
  ASSERT_TRUE(saved);
  const auto rows = rows_of(*saved);
  ASSERT_GT(rows.size(), 4);
  const auto place_of = [](const std::vector<double>& row) { return dvec3(row[1], row[2], row[3]); };
  const dvec3 start = place_of(rows.front()), end = place_of(rows.back());
  EXPECT_LT(glm::length(start - found(from_x, from_y).position), 1e-12);
  EXPECT_LT(glm::length(end - found(to_x, to_y).position), 1e-12);
  for (const auto& row : rows) EXPECT_NEAR(row[4], linear(place_of(row)), 0.01);

  const format::Volume& volume = *value_of(viewer->session()->steps().volume(0));
  const auto selection = value_of(format::select_splats(volume, {}, {"value"}, format::SplatSelection().box));
  require(export_line(volume, path("exported.csv"), selection, start, end, {}));
  EXPECT_EQ(*saved, *read_text_file(path("exported.csv")));

  click_and_settle(50, save_plot_y);
  EXPECT_EQ(read_text_file("m-line.png")->substr(1, 3), "PNG");
}

TEST_F(ViewerLines, EndsAreTyped) {
  open_mesh();
  open_section();
  click_and_settle(40, from_y_field);  // x of the start
  frame({KeyChanged{key::left_control, true}, KeyChanged{'A', true}});
  frame({KeyChanged{'A', false}, KeyChanged{key::left_control, false}});
  for (const char c : std::string("0.25")) frame({TextTyped{static_cast<std::uint32_t>(c)}});
  press(key::enter);
  settle();
  click_and_settle(50, save_table_y);
  const auto saved = read_text_file("m-line.csv");
  ASSERT_TRUE(saved);
  EXPECT_EQ(rows_of(*saved).front()[1], 0.25);
  EXPECT_EQ(rows_of(*saved).back()[1], 1) << "the box's corner";
}

TEST_F(ViewerLines, EscEndsTheLineAndThenThePin) {
  open_mesh();
  const auto corner = [&] {  // where the windows of plots are
    frame({PointerMoved{-1, -1}});
    settle();
    const Image all = screen();
    Image part{300, 150, {}};
    for (int y = 0; y < part.height; ++y)
      for (int x = 0; x < part.width; ++x) part.pixels.push_back(all.at(panel + 12 + x, height - 160 + y));
    return part;
  };
  const auto differ = [](const Image& a, const Image& b) { return compare_images(a, b)->rmse > 0.01; };
  const Image empty = corner();
  click_and_settle(from_x, from_y);
  const Image pinned = corner();
  EXPECT_TRUE(differ(pinned, empty));
  click_with_shift(to_x, to_y);
  EXPECT_TRUE(differ(corner(), pinned));
  press(key::escape);
  EXPECT_FALSE(differ(corner(), pinned));
  press(key::escape);
  EXPECT_FALSE(differ(corner(), empty));
}

TEST_F(ViewerLines, NeedCells) {
  open_mesh(false);
  show_line();
  EXPECT_THAT(newest_message(), HasSubstr("the file keeps no cells"));
  open_section();
  click_and_settle(50, save_table_y);
  EXPECT_FALSE(fs::exists("m-line.csv")) << "the control is off";
}

// A click on the plot shows the step there.
TEST_F(ViewerLines, StepsHaveAPlot) {
  write_series(path("s.svol"), {.keep_cells = true});
  open({.volume = path("s.svol")});
  settle();
  ASSERT_EQ(viewer->session()->step(), 2U);
  click_and_settle(from_x, from_y);
  click_with_shift(to_x, to_y);
  press(key::escape);
  open_section(section_y + of_series);
  click_and_settle(70, steps_y + of_series);
  click_and_settle(panel + 20, height - 100);
  EXPECT_EQ(viewer->session()->step(), 0U);
}

}  // namespace
}  // namespace splatvol::test
