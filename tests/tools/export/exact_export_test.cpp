// From a file of points through svbuild --exact and svexport, and back.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>
#include <tuple>

#include "base/file.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "format/volume.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"
#include "tools/export/vtu_export.h"

namespace splatvol::test {
namespace {

TEST(ExactExport, GivesBackPositionsAndValuesBitByBit) {
  const TempFolder folder;
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::string table = "x,y,z,p,T,p again\n";
  std::map<std::tuple<double, double, double>, std::pair<double, double>> points;
  for (int i = 0; i < 500; ++i) {
    const dvec3 position(normal(random), 1e6 + normal(random), 1e-9 * normal(random));
    const double p = double{static_cast<float>(101325 + normal(random))};
    const double t = i % 9 == 4 ? std::nan("") : double{static_cast<float>(1e20 * normal(random))};
    points[{position.x, position.y, position.z}] = {p, t};
    table += fmt::format("{},{},{},{},{},{}\n", position.x, position.y, position.z, p, t, p);
  }
  folder.write("in.csv", table);

  const auto source = value_of(open_source({folder.path("in.csv")}, {}));
  BuildOptions options{.exact = {.positions = true, .values = true}};
  const auto built = value_of(build_volume(*source, folder.path("out.svol"), options, [](const char*, double) {}));
  const auto volume = format::Volume::open(open_file(folder.path("out.svol")).value()).value();
  EXPECT_EQ(volume->info().attributes.size(), 2u);
  EXPECT_EQ(volume->info().aliases, (std::vector<format::Alias>{{"p again", 0}}));
  const format::SplatSelection selection =
      format::select_splats(*volume, std::nullopt, {}, format::SplatSelection().box).value();
  ASSERT_TRUE(export_vtu(*volume, folder.path("out.vtu"), selection, [](double) {}));

  const auto exported = value_of(open_source({folder.path("out.vtu")}, {.selection = {"p", "T", "p again"}}));
  const auto piece = value_of(exported->next());
  ASSERT_EQ(piece->points.size(), points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const dvec3& at = piece->points[i];
    const auto found = points.find({at.x, at.y, at.z});
    ASSERT_NE(found, points.end()) << at.x << " " << at.y << " " << at.z;
    EXPECT_EQ(piece->values[0][i], found->second.first);
    EXPECT_EQ(piece->values[2][i], found->second.first);
    const double t = piece->values[1][i];
    EXPECT_TRUE(t == found->second.second || (std::isnan(t) && std::isnan(found->second.second)));
  }
}

}  // namespace
}  // namespace splatvol::test
