// svinfo and the scenes that it writes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>

#include "format/volume.h"
#include "scene/scene.h"
#include "streamer/first/default_scene.h"
#include "tests/support/memory_source.h"
#include "tests/support/program_json.h"
#include "tests/support/results.h"
#include "tests/support/surgery.h"
#include "tests/support/test_volume.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using namespace ::testing;

using Values = std::vector<std::vector<double>>;

Values random_values(std::size_t attributes, std::size_t points) {
  std::mt19937 random(2);
  std::normal_distribution<double> normal(5, 1);
  Values values(attributes, std::vector<double>(points));
  for (auto& column : values)
    for (double& value : column) value = normal(random);
  return values;
}

std::shared_ptr<const format::Volume> open_volume(const format::Bytes& bytes) {
  return format::Volume::open(memory_source(bytes, "test.svol")).value();
}

Scene scene_of(const TestVolume& volume, const std::string& attribute = "") {
  const format::Bytes bytes = test_volume_bytes(volume);
  const auto scene = default_scene(*open_volume(bytes), attribute);
  EXPECT_TRUE(scene) << scene.error().message;
  return scene.value_or(Scene{});
}

// Returns the largest distance of a point from the image's centre, in halves of the image.
double largest_reach(const Scene& scene, const std::vector<dvec3>& points) {
  const View view = make_view(scene.camera, scene.width, scene.height).value();
  double reach = 0;
  for (const dvec3& p : points) {
    const dvec3 v = view.to_view(p);
    EXPECT_GT(v.z, 0);
    reach = std::max({reach, std::abs(view.focal * v.x / v.z) / (0.5 * view.width),
                      std::abs(view.focal * v.y / v.z) / (0.5 * view.height)});
  }
  return reach;
}

TEST(DefaultScene, ThePointsFillTheImage) {
  for (const dvec3 extent : {dvec3(1), dvec3(1, 0.1, 0.1), dvec3(0.05, 1, 0.3), dvec3(1, 1, 0), dvec3(0, 0, 1)}) {
    auto points = random_points(800, 4);
    for (dvec3& p : points) p *= extent;
    const Scene scene = scene_of(make_test_volume(points, random_values(1, 800)));
    const double reach = largest_reach(scene, points);
    EXPECT_LE(reach, 1);
    EXPECT_GE(reach, 0.6);  // the material of few points reaches beyond them
  }
}

TEST(DefaultScene, WorksAtEveryScaleAndPlace) {
  for (const double scale : {1e-6, 1.0, 1e6}) {
    auto points = random_points(300, 4);
    TestVolumeOptions options{.cube = {dvec3(1e3 * scale), scale}};
    for (dvec3& p : points) p = options.cube.origin + scale * p;
    const Scene scene = scene_of(make_test_volume(points, random_values(1, 300), options));
    EXPECT_NEAR(largest_reach(scene, points), 0.75, 0.15);
    double densest = 0;
    for (const auto& density : scene.transfer_function.densities) densest = std::max(densest, density.extinction);
    EXPECT_GE(densest * scale, 2);
    EXPECT_LE(densest * scale, 12);
  }
}

TEST(DefaultScene, TheMostFrequentValueIsClear) {
  Values values = random_values(1, 600);
  for (std::size_t i = 0; i < 600; i += 2) values[0][i] = 4.5;
  const Scene scene = scene_of(make_test_volume(random_points(600, 4), values));
  EXPECT_EQ(scene.transfer_function.extinction(4.5), 0);
  EXPECT_GT(scene.transfer_function.extinction(3.5), 0);
  EXPECT_GT(scene.transfer_function.extinction(6), scene.transfer_function.extinction(5));
}

TEST(DefaultScene, LooksAtWhatIsNotClear) {
  // A small part with other values, in wide surroundings with one value.
  auto points = random_points(1000, 4);
  Values values(1, std::vector<double>(1000, 1.0));
  std::vector<dvec3> part;
  for (std::size_t i = 0; i < 1000; ++i) {
    if (glm::length(points[i] - dvec3(0.2, 0.3, 0.25)) > 0.05) continue;
    values[0][i] = 2 + points[i].x;
    part.push_back(points[i]);
  }
  ASSERT_GT(part.size(), 100u);
  const Scene scene = scene_of(make_test_volume(points, values));
  EXPECT_LE(largest_reach(scene, part), 1);
  EXPECT_GE(largest_reach(scene, part), 0.7);
}

TEST(DefaultScene, TakesASinglePointAndAConstant) {
  for (const std::size_t count : {1, 100}) {
    const std::vector<dvec3> points(count, dvec3(0.3));
    for (const double value : {0.0, -7.0, 1e20}) {
      const Scene scene = scene_of(make_test_volume(points, Values(1, std::vector<double>(count, value))));
      EXPECT_TRUE(parse_scene(scene_to_json(scene)));
      EXPECT_GT(scene.transfer_function.extinction(value), 0);
      EXPECT_LE(largest_reach(scene, points), 0.9);
    }
  }
}

TEST(DefaultScene, ChoosesTheAttributeOrSaysWhichThereAre) {
  Values values = random_values(2, 50);
  values.push_back(std::vector<double>(50, std::nan("")));
  const format::Bytes bytes = test_volume_bytes(make_test_volume(random_points(50, 1), values));
  const auto volume = open_volume(bytes);
  EXPECT_EQ(default_scene(*volume, "")->attribute, "a0");
  EXPECT_EQ(default_scene(*volume, "a1")->attribute, "a1");
  EXPECT_THAT(default_scene(*volume, "heat").error().message,
              AllOf(HasSubstr("test.svol"), HasSubstr("\"heat\""), HasSubstr("a0, a1, a2")));
  EXPECT_THAT(default_scene(*volume, "a2").error().message, HasSubstr("no values"));
  const format::Bytes bare = test_volume_bytes(make_test_volume(random_points(50, 1), {}));
  EXPECT_THAT(default_scene(*open_volume(bare), "").error().message, HasSubstr("no attributes"));
}

struct Svinfo : ProgramTest {
  Svinfo() : volume_(make_test_volume(random_points(700, 6), random_values(2, 700))) {
    EXPECT_TRUE(write_test_volume(volume_, path("whole.svol")));
  }

  TestVolume volume_;
};

TEST_F(Svinfo, PrintsWhatIsInTheFile) {
  expect_done("svinfo whole.svol");
  const std::string out = run("svinfo whole.svol").out;
  EXPECT_THAT(out, AllOf(HasSubstr("700 points"), HasSubstr("a1"), HasSubstr("position"), HasSubstr("moments"),
                         HasSubstr("nodes")));
  EXPECT_THAT(out, Not(HasSubstr("every byte checked")));
  EXPECT_THAT(run("svinfo whole.svol --verify").out, HasSubstr("every byte checked"));
}

TEST_F(Svinfo, PrintsItAsJson) {
  const json document = document_of(run("svinfo whole.svol --json --verify"));
  EXPECT_EQ(document["points"], 700);
  EXPECT_EQ(document["bytes"], fs::file_size(path("whole.svol")));
  EXPECT_EQ(document["resolution_counts"], volume_.info.resolution_counts);
  EXPECT_EQ(document["index"]["nodes"], volume_.tree.size());
  EXPECT_EQ(document["verified"], true);
  ASSERT_EQ(document["attributes"].size(), 2u);
  std::uint64_t values = 0;
  for (const std::uint64_t count : document["attributes"][1]["histogram"]) values += count;
  EXPECT_EQ(values, 700u);

  // The parts add up to the file: superblock and table, sections, footer.
  std::uint64_t rows = 0, sections = 0;
  for (const json& column : document["columns"]) rows += column["packed_bytes"].get<std::uint64_t>();
  for (const json& section : document["sections"]) {
    sections += section["bytes"].get<std::uint64_t>();
    if (section["kind"] == "rows") {
      EXPECT_EQ(section["bytes"], rows);
    }
  }
  EXPECT_EQ(64 + 48 * document["sections"].size() + sections + 32, document["bytes"]);
}

TEST_F(Svinfo, TellsOfCells) {
  add_random_cells(volume_, 300);
  volume_.cells->turned = 5;
  ASSERT_TRUE(write_test_volume(volume_, path("cells.svol")));
  const json document = document_of(run("svinfo cells.svol --json --verify"));
  const json& cells = document["cells"];
  EXPECT_EQ(cells["cells"], 300);
  ASSERT_EQ(cells["kinds"].size(), 1u);
  const json& kind = cells["kinds"][0];
  EXPECT_EQ(kind["shape"], "tetrahedron");
  EXPECT_EQ(kind["field"], "corners");
  EXPECT_EQ(kind["known"], true);
  EXPECT_EQ(kind["turned"], 5);
  EXPECT_EQ(kind["bytes"], cells["bytes"]["chunks"]);
  const auto bytes = [&](const char* part) { return cells["bytes"][part].get<std::uint64_t>(); };
  EXPECT_EQ(bytes("chunks") + bytes("directory") + bytes("ranks"), bytes("all"));
  EXPECT_GT(bytes("ranks"), 0u);
  bool found = false;
  for (const json& section : document["sections"]) {
    if (section["kind"] != "cells") continue;
    found = true;
    EXPECT_EQ(section["bytes"], cells["bytes"]["all"]);
  }
  EXPECT_TRUE(found);
  const std::string out = run("svinfo cells.svol").out;
  EXPECT_THAT(out, ContainsRegex("tetrahedron +300 +[0-9.]+ +5\n"));
  EXPECT_THAT(out, AllOf(HasSubstr("part of the cells"), HasSubstr("ranks"), HasSubstr("chunks")));
  EXPECT_THAT(run("svinfo whole.svol").out, Not(HasSubstr("part of the cells")));
  EXPECT_FALSE(document_of(run("svinfo whole.svol --json")).contains("cells"));
}

// Cells of a later version are told, and are no error.
TEST_F(Svinfo, TellsOfCellsThatItDoesNotKnow) {
  add_random_cells(volume_, 100);
  const format::Bytes file =
      Dissected(test_volume_bytes(volume_)).assemble([](Part part, std::size_t, format::Bytes& bytes) {
        const bool is_root = part == Part::cell_root;
        if (is_root) bytes[offsetof(format::CellKind, shape)] = std::byte{77};
        if (part != Part::cell_entries) return;
        for (std::size_t at = offsetof(format::CellChunkEntry, shape); at < bytes.size();
             at += sizeof(format::CellChunkEntry))
          bytes[at] = std::byte{77};
      });
  write("later.svol", text_of(file));
  expect_done("svinfo later.svol --verify");
  EXPECT_THAT(run("svinfo later.svol").out, ContainsRegex("shape 77 +100 .*not known to this program"));
  EXPECT_EQ(document_of(run("svinfo later.svol --json"))["cells"]["kinds"][0]["known"], false);
  const json integrals = document_of(run("svinfo later.svol --integrate --json"));
  EXPECT_EQ(integrals["left_out"], 100);
  EXPECT_EQ(integrals["volume"], 0);
  EXPECT_THAT(run("svinfo later.svol --integrate").out, HasSubstr("100 cells of shapes that this program does not"));
}

TEST_F(Svinfo, NamesWhatIsBroken) {
  std::string bytes = read("whole.svol");
  write("short.svol", bytes.substr(0, bytes.size() - 1));
  bytes[bytes.size() / 2] ^= 4;
  write("flipped.svol", bytes);
  write("text.svol", "This is not a volume, but it is long enough to be one: sixty-four bytes.");
  expect_refusal("svinfo flipped.svol --verify", "checksum mismatch");
  expect_refusal("svinfo short.svol", "truncated");
  expect_refusal("svinfo text.svol", "not a .svol file");
  expect_refusal("svinfo none.svol", "cannot open");
  expect_refusal("svinfo whole.svol --scene no/scene.json", "no/scene.json");
  expect_refusal("svinfo whole.svol --integrate", "keeps no cells: build it from a mesh");
  expect_refusal("svinfo whole.svol --scene scene.json --attribute heat", "a0, a1");
}

TEST_F(Svinfo, WritesAScene) {
  expect_done("svinfo whole.svol --scene scene.json --attribute a1");
  const auto scene = value_of(load_scene(path("scene.json")));
  EXPECT_EQ(scene.attribute, "a1");
}

TEST_F(Svinfo, WrongUsageIsTwo) {
  for (const std::string arguments : {"", " whole.svol --attribute a1", " whole.svol --fast"})
    EXPECT_EQ(run("svinfo" + arguments).code, 2) << arguments;
}

}  // namespace
}  // namespace splatvol::test
