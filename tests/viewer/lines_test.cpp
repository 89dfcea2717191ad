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

using testing::Contains;
using testing::Field;
using testing::HasSubstr;

namespace fs = std::filesystem;

constexpr int width = 1100, height = 1000, panel = 336;

double linear(dvec3 p) { return 3 + p.x - 2 * p.y + 0.5 * p.z; }

struct ViewerLines : ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    present_ = fs::current_path();
    fs::current_path(folder);  // files are saved here
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
    require(cells);
    return value_of(pick_cells(*cells->kept, session.drawn_scene(), session.surfaces(), looking.ray)).value();
  }
  // The panel's section "line" begins below those that are closed.
  void open_section() { click_and_settle(100, section_y); }
  static constexpr double section_y = 794;

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
  for (const auto& row : rows) EXPECT_NEAR(row[4], linear(place_of(row)), 1e-4);

  const format::Volume& volume = *value_of(viewer->session()->steps().volume(0));
  const auto selection = value_of(format::select_splats(volume, {}, {"value"}, format::SplatSelection().box));
  require(export_line(volume, path("exported.csv"), selection, start, end, {}));
  EXPECT_EQ(*saved, *read_text_file(path("exported.csv")));

  click_and_settle(50, save_plot_y);
  EXPECT_EQ(read_text_file("m-line.png")->substr(1, 3), "PNG");
}

}  // namespace
}  // namespace splatvol::test
