// The preview of an input: some of its points, its box and its ranges, before the build goes on.
#include "builder/pipeline/preview.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <utility>
#include <vector>

#include "base/file.h"
#include "format/volume.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/random.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;

struct PreviewTest : FolderTest {
  // Pieces of random points, the first of which bounds all.
  static std::vector<Piece> pieces(std::size_t count, std::size_t points) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> place(0, 1);
    std::vector<Piece> all;
    for (std::size_t i = 0; i < count; ++i) {
      std::vector<dvec3> positions(points);
      for (dvec3& p : positions) p = {place(random), place(random), place(random)};
      if (i == 0) positions[0] = {-3, 0, 0}, positions[1] = {4, 5, 6}, positions[2] = {0, -1, -2};
      all.push_back(scattered(std::move(positions)));
    }
    return all;
  }

  // Reads a source to its end. Returns the number of previews that were told of.
  int preview_of(std::vector<Piece> of_source) const {
    int told = 0;
    Preview preview(path("p.svol"), {}, [&](const std::string& file) {
      EXPECT_TRUE(fs::exists(file)) << "it is complete";
      ++told;
    });
    const auto source = preview.watch(std::make_unique<PieceSource>(std::move(of_source)));
    while (value_of(source->next())) {
    }
    return told;
  }
};

TEST_F(PreviewTest, HasSomePointsAndTheBoundsOfAll) {
  EXPECT_EQ(preview_of(pieces(3, 60'000)), 1);
  const auto volume = value_of(format::Volume::open(value_of(open_file(path("p.svol")))));
  const format::VolumeInfo& info = volume->info();
  EXPECT_GE(info.resolution_counts.back(), Preview::most_points - 8);
  EXPECT_LE(info.resolution_counts.back(), Preview::most_points);
  EXPECT_EQ(info.cube.origin, dvec3(-3, -1, -2));
  EXPECT_EQ(info.cube.edge, 8);
  ASSERT_EQ(info.attributes.size(), 1u);
  EXPECT_EQ(info.attributes[0].name, "value");
  EXPECT_NEAR(info.attributes[0].max, 14, 1e-5) << "x + 2 y";
}

TEST_F(PreviewTest, DoesNotDependOnTheOrderOfThePieces) {
  std::vector<Piece> all = pieces(4, 40'000);
  EXPECT_EQ(preview_of(all), 1);
  const std::string before = read("p.svol");
  std::ranges::reverse(all);
  EXPECT_EQ(preview_of(all), 1);
  EXPECT_EQ(read("p.svol"), before);
}

TEST_F(PreviewTest, OfFewPointsThereIsNone) {
  EXPECT_EQ(preview_of(pieces(2, 50'000)), 0);
  EXPECT_TRUE(names().empty());
  EXPECT_EQ(preview_of(pieces(2, 50'001)), 1);
}

TEST_F(PreviewTest, PointsThatNoCellUsesDoNotWidenIt) {
  Piece mesh = pieces(1, 110'000)[0];
  mesh.points[1] = {1e6, 0, 0};
  for (std::uint32_t i = 4; i + 4 <= mesh.points.size(); i += 4) mesh.tetrahedra.push_back({i, i + 1, i + 2, i + 3});
  EXPECT_EQ(preview_of({mesh}), 1);
  const auto volume = value_of(format::Volume::open(value_of(open_file(path("p.svol")))));
  EXPECT_LT(volume->info().cube.edge, 1.1);
}

TEST_F(PreviewTest, TheFirstSourceIsEnough) {
  int told = 0;
  Preview preview(path("p.svol"), {}, [&](const std::string&) { ++told; });
  std::vector<std::unique_ptr<Source>> sources;
  for (int i = 0; i < 2; ++i) sources.push_back(preview.watch(std::make_unique<PieceSource>(pieces(1, 120'000))));
  for (const auto& source : sources)
    while (value_of(source->next())) {
    }
  EXPECT_EQ(told, 1);
}

TEST_F(PreviewTest, AFolderThatIsNotThereEndsTheBuild) {
  Preview preview(path("none/p.svol"), {}, [](const std::string&) {});
  const auto source = preview.watch(std::make_unique<PieceSource>(pieces(1, 120'000)));
  EXPECT_TRUE(value_of(source->next()));
  EXPECT_FALSE(source->next());
}

}  // namespace
}  // namespace splatvol::test
