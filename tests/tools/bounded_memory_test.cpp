// The memory of processes that draw a file of many cells: SIZE, and a little for each thread, more than for a file of
// one cell. So code, tables and the pictures themselves are no part of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <thread>

#include "base/file.h"
#include "builder/series/series_build.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/long.h"
#include "tests/support/measured_process.h"
#include "tests/support/require.h"
#include "tests/support/sanitizers.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using nlohmann::json;

constexpr std::uint64_t bytes_of_thread = 12 * mebibyte;

Mesh one_cell() { return {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{0, 1, 2, 3}}}; }

// All cells with one of `count` corners near each corner of another cell. Most rays that meet one of them meet all.
Mesh heap(std::uint32_t count) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(0, 0.1);
  Mesh mesh;
  for (const dvec3& corner : one_cell().points)
    for (std::uint32_t i = 0; i < count; ++i) mesh.points.push_back(corner + random_vector(uniform, random));
  for (std::uint32_t a = 0; a < count; ++a)
    for (std::uint32_t b = count; b < 2 * count; ++b)
      for (std::uint32_t c = 2 * count; c < 3 * count; ++c)
        for (std::uint32_t d = 3 * count; d < 4 * count; ++d) mesh.tetrahedra.push_back({a, b, c, d});
  return mesh;
}

// Slivers from each of `count` places at the left to a row of as many at the right. Those of one place cover the
// picture of fans_scene(), at all depths, and begin at its eye. So segments wait for all chunks.
Mesh fans(std::uint32_t count) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  Mesh mesh;
  for (std::uint32_t i = 0; i < count; ++i)
    mesh.points.emplace_back(-1, 0.5 + 0.01 * uniform(random), 0.1 * uniform(random));
  for (std::uint32_t i = 0; i <= count; ++i)
    for (const double z : {0.0, 1.0}) mesh.points.emplace_back(2, -1 + 3.0 * i / count, z + uniform(random));
  for (std::uint32_t place = 0; place < count; ++place)
    for (std::uint32_t right = count; right < 3 * count; right += 2)
      mesh.tetrahedra.push_back({place, right, right + 1, right + 2});
  return mesh;
}

// A step with three attributes.
SeriesStep step_of(const Mesh& mesh, int step) {
  Piece piece = mesh_piece(mesh, [step](dvec3 p) { return std::sin(5 * p.x + step) + p.y; });
  piece.values.push_back(sample(mesh, [step](dvec3 p) { return std::cos(7 * p.y + 4 * p.z) + 0.1 * step; }));
  piece.values.push_back(sample(mesh, [](dvec3 p) { return glm::length(p - dvec3(0.4)); }));
  return {"a step", step, [piece = std::move(piece)]() -> Result<std::unique_ptr<Source>> {
            return std::make_unique<PieceSource>(std::vector{piece}, PieceSourceTraits{.attributes = {"a", "b", "c"}});
          }};
}

json orthographic(const dvec3& position, const dvec3& focal_point, double height) {
  return {{"projection", "orthographic"},
          {"parallel_height", height},
          {"position", {position.x, position.y, position.z}},
          {"focal_point", {focal_point.x, focal_point.y, focal_point.z}},
          {"up", {0, 1, 0}}};
}

struct BoundedMemory : testing::Test {
  static void SetUpTestSuite() {
    folder.emplace();
    make("one", one_cell);
    make("many", [] { return lattice(69); });
    make("heap", [] { return heap(24); });
    make("fans", [] { return fans(400); });
    write("full", full_scene());
    write("pixel", pixel_scene());
    write("wait", fans_scene());
  }
  static void TearDownTestSuite() { folder.reset(); }

  // Builds a file of two steps, and a scene that fits it. In a process of its own: programs that this one starts seem
  // to take at least what it does.
  template <class MakeMesh>
  static void make(const std::string& name, const MakeMesh& make_mesh) {
    const pid_t child = ::fork();
    if (child == 0) {
      const Mesh mesh = make_mesh();
      require(build_series({step_of(mesh, 0), step_of(mesh, 1)}, path(name + ".svol"), {.keep_cells = true},
                           [](const char*, double) {}));
      ::_exit(0);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    require(status == 0, name);
    require(run_measured({"svinfo", path(name + ".svol"), "--scene", path(name + ".json")}).code == 0, name);
  }

  static std::string path(const std::string& name) { return folder->path(name); }
  static json read(const std::string& name) { return json::parse(*read_text_file(path(name + ".json"))); }
  static void write(const std::string& name, const json& scene) { folder->write(name + ".json", scene.dump()); }

  // Needs three attributes at once.
  static json full_scene() {
    json scene = read("many");
    scene["opacity"] = {{"attribute", "b"}, {"domain", {-1, 1}}, {"factor", {{0, 0.2}, {1, 1}}}};
    scene["contours"] = {
        {{"values", {-0.3, 0.4, 1}},
         {"color_by", {{"attribute", "c"}, {"domain", {0, 1}}, {"colors", {{0, 0, 0, 1}, {1, 1, 1, 0}}}}},
         {"opacity", 0.5}}};
    scene["slices"] = {{{"point", {0.5, 0.5, 0.5}}, {"normal", {1, 2, 3}}, {"opacity", 0.5}}};
    scene["lighting"] = true;
    return scene;
  }

  // The heap lies in the middle pixel.
  static json pixel_scene() {
    json scene = read("heap");
    scene["camera"] = orthographic(dvec3(1.2), dvec3(0.2), 65);
    scene["image"] = {{"width", 65}, {"height", 65}};
    return scene;
  }

  static json fans_scene() {
    json scene = read("fans");
    scene["camera"] = orthographic({0.5, 0.5, -1}, {0.5, 0.5, 0}, 0.9);
    scene["image"] = {{"width", 192}, {"height", 192}};
    return scene;
  }

  static Measured render(const std::string& volume, const std::string& scene, int size,
                         std::vector<std::string> options = {"--exact"}) {
    std::vector<std::string> words = {"svrender", path(volume + ".svol"), "--scene",  path(scene + ".json"),
                                      "-o",       path("picture.exr"),    "--memory", text_of(size),
                                      "--stats",  path("stats.json"),     "--repeat", "1"};
    words.insert(words.end(), options.begin(), options.end());
    return run_measured(words);
  }
  // With one arena, memory is what is in use: jobs on threads of their own leave up to 10 MiB in theirs.
  static Measured look(const std::string& volume, int size) {
    ::setenv("MALLOC_ARENA_MAX", "1", 1);
    return run_measured({SPLATVOL_SESSION_MEMORY, path(volume + ".svol"), "--memory", text_of(size)});
  }

  // MiB to grant.
  static std::vector<int> sizes() { return sample_of(std::vector{64, 32, 256}); }
  static std::string text_of(int size) { return std::to_string(size) + "M"; }

  static void expect_bounded(const Measured& many, const Measured& one, int size) {
    if (is_sanitized) return;  // sanitizers have an allocator of their own
    const auto mebibytes = [](std::uint64_t bytes) { return static_cast<double>(bytes) / mebibyte; };
    const double most = size + mebibytes(std::thread::hardware_concurrency() * bytes_of_thread);
    const double alone = mebibytes(one.peak_rss), peak = mebibytes(many.peak_rss);
    EXPECT_LE(peak - alone, most) << "MiB; the peak: " << peak << ", of one cell: " << alone;
  }

  static void expect_bounded_pictures(const std::string& volume, const std::string& scene,
                                      const std::vector<std::string>& options,
                                      const std::vector<int>& sizes = BoundedMemory::sizes()) {
    for (const int size : sizes) {
      SCOPED_TRACE(text_of(size));
      const Measured one = render("one", scene, size, options);
      ASSERT_EQ(one.code, 0) << one.errors;
      const Measured many = render(volume, scene, size, options);
      ASSERT_EQ(many.code, 0) << many.errors;
      expect_bounded(many, one, size);
      const json statistics = read("stats");
      ASSERT_TRUE(statistics.contains("bytes_resident_peak"));
      EXPECT_LE(statistics["bytes_resident_peak"], size * mebibyte);
    }
  }

  static inline std::optional<TempFolder> folder;
};

TEST_F(BoundedMemory, OfAnExactPicture) { expect_bounded_pictures("many", "many", {"--exact"}); }

TEST_F(BoundedMemory, OfThePictureByDefault) { expect_bounded_pictures("many", "many", {}); }

TEST_F(BoundedMemory, OfAPictureByItsError) { expect_bounded_pictures("many", "many", {"--max-error", ".0001"}); }

TEST_F(BoundedMemory, OfAnExactPictureWithAllThatCellsShow) { expect_bounded_pictures("many", "full", {"--exact"}); }

// At 32M, two chunks of such slivers take more than their share, as each thread draws one.
TEST_F(BoundedMemory, OfAnExactPictureWhoseSegmentsWait) {
  expect_bounded_pictures("fans", "wait", {"--exact"}, sample_of(std::vector{64, 256}));
}

TEST_F(BoundedMemory, OfASession) {
  for (const int size : sizes()) {
    SCOPED_TRACE(text_of(size));
    const Measured one = look("one", size);
    ASSERT_EQ(one.code, 0) << one.errors;
    const Measured many = look("many", size);
    ASSERT_EQ(many.code, 0) << many.errors;
    expect_bounded(many, one, size);
  }
}

TEST_F(BoundedMemory, OfManyCellsInAPixel) {
  for (const int size : sizes()) {
    SCOPED_TRACE(text_of(size));
    const Measured many = render("heap", "pixel", size);
    EXPECT_THAT(many.errors, testing::MatchesRegex(many.code == 0 ? "" : "svrender: [^\n]*need more memory[^\n]*\n"));
    EXPECT_THAT(many.code, testing::AnyOf(0, 1));
    expect_bounded(many, render("one", "pixel", size), size);
  }
}

// The cells of a pixel take more than that.
TEST_F(BoundedMemory, IsTooLittleForAPictureWithALine) {
  const Measured refused = render("heap", "pixel", 4);
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.errors, testing::MatchesRegex("svrender: [^\n]*need more memory[^\n]*\n"));
  const Measured splats = look("heap", 4);
  EXPECT_EQ(splats.code, 1);
  EXPECT_THAT(splats.errors,
              testing::MatchesRegex("session_memory: [^\n]*need more memory[^\n]*splats are shown[^\n]*\n"));
}

}  // namespace
}  // namespace splatvol::test
