// The cells of files, as views show them.
#include "streamer/cells/file_cells.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <fstream>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "base/file.h"
#include "pictures/image.h"
#include "renderer/cpu/cells.h"
#include "renderer/reference/reference.h"
#include "streamer/first/default_scene.h"
#include "streamer/splats/visibility.h"
#include "tests/builder/support/built_input.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/builder/support/mesh_of_shapes.h"
#include "tests/player/waves.h"
#include "tests/support/far_file.h"
#include "tests/support/results.h"
#include "tests/support/surgery.h"
#include "tests/support/temp_folder.h"

namespace splatvol {
namespace {

using testing::HasSubstr;

constexpr std::uint64_t memory = std::uint64_t{16} << 20;

// A corner, with its values.
using Corner = std::array<double, 5>;
using Found = std::vector<std::array<Corner, 4>>;

double volume_of(const std::array<Corner, 4>& tetrahedron) {
  const auto at = [&](std::size_t k) { return dvec3(tetrahedron[k][0], tetrahedron[k][1], tetrahedron[k][2]); };
  return std::abs(glm::dot(at(1) - at(0), glm::cross(at(2) - at(0), at(3) - at(0)))) / 6;
}

// Adds tetrahedra with their corners in the order of positions.
void add(const Tetrahedra& cells, Found& all) {
  ASSERT_LE(cells.values.size(), 2U);
  for (const std::vector<double>& values : cells.values)
    ASSERT_EQ(values.size(), cells.constant ? cells.size() : cells.points.size());
  for (std::size_t t = 0; t < cells.size(); ++t) {
    ASSERT_TRUE(std::ranges::is_sorted(cells.corners[t]));
    std::array<Corner, 4> tetrahedron;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::uint32_t point = cells.corners[t][k];
      const std::size_t value = cells.constant ? t : point;
      const dvec3& p = cells.points[point];
      tetrahedron[k] = {p.x, p.y, p.z, cells.values[0][value], cells.values.size() < 2 ? 0 : cells.values[1][value]};
    }
    std::ranges::sort(tetrahedron);
    all.push_back(tetrahedron);
  }
}

Found cells_of(const CellSource& source) {
  Found all;
  Tetrahedra scratch;
  for (const CellSource::Chunk& chunk : source.chunks()) {
    const Tetrahedra& cells = *test::value_of(source.read(chunk, scratch));
    add(cells, all);
    for (const dvec3& p : cells.points) EXPECT_EQ(squared_distance(chunk.box, p), 0);
  }
  std::ranges::sort(all);
  return all;
}

Found cells_of(const Piece& piece) {
  Tetrahedra cells;
  cells.points = piece.points;
  cells.values = piece.values;
  for (auto corners : piece.tetrahedra) {
    std::ranges::sort(corners);
    cells.corners.push_back(corners);
  }
  Found all;
  add(cells, all);
  std::ranges::sort(all);
  return all;
}

// The exact picture of the cells of a source.
ReferencePicture picture_of(const CellSource& source, const Scene& scene) {
  Tetrahedra all, scratch;
  all.values.resize(1);
  for (const CellSource::Chunk& chunk : source.chunks()) {
    const Tetrahedra& cells = *test::value_of(source.read(chunk, scratch));
    const auto first = static_cast<std::uint32_t>(all.points.size());
    for (auto corners : cells.corners) {
      for (std::uint32_t& corner : corners) corner += first;
      all.corners.push_back(corners);
    }
    all.points.insert(all.points.end(), cells.points.begin(), cells.points.end());
    all.values.resize(cells.values.size());
    for (std::size_t a = 0; a < all.values.size(); ++a)
      all.values[a].insert(all.values[a].end(), cells.values[a].begin(), cells.values[a].end());
  }
  TetMesh mesh{all.points, all.values[0], all.corners};
  if (all.values.size() > 1) mesh.opacity_values = all.values[1];
  return test::value_of(render_reference(mesh, scene));
}

class FileCellsOf : public test::FolderTest {
 protected:
  [[nodiscard]] std::shared_ptr<const format::Volume> open_volume(const std::string& name) const {
    return test::value_of(format::Volume::open(*open_file(path(name))));
  }

  [[nodiscard]] static std::unique_ptr<const FileCells> open(const std::shared_ptr<const format::Volume>& volume,
                                                             const Scene& scene, std::uint64_t bytes = memory) {
    const auto kept = test::value_of(KeptCells::open(*volume, scene, own_room(bytes)));
    return test::value_of(FileCells::open(kept, scene, make_view(scene).value()));
  }

  [[nodiscard]] static BuildOptions exact() {
    BuildOptions options{.keep_cells = true};
    options.exact = {.positions = true, .values = true};
    return options;
  }

  std::shared_ptr<const format::Volume> build(const Piece& piece, std::vector<std::string> names = {"value"}) const {
    test::PieceSource source({piece}, {.attributes = std::move(names)});
    EXPECT_EQ(test::message_of(build_volume(source, path("mesh.svol"), exact(), [](const char*, double) {})), "");
    return open_volume("mesh.svol");
  }

  // A view of a cube from outside, in which all values are visible.
  static Scene scene_of_all() {
    Scene scene;
    scene.width = 96;
    scene.height = 64;
    scene.attribute = "value";
    scene.camera.position = {1.7, 2.1, 2.9};
    scene.camera.focal_point = {0.5, 0.5, 0.5};
    scene.transfer_function.lo = -10;
    scene.transfer_function.hi = 10;
    scene.transfer_function.colors = {{0, dvec3(0, 0.2, 1)}, {1, dvec3(1, 0.5, 0)}};
    scene.transfer_function.densities = {{0, 1.0}, {1, 3.0}};
    return scene;
  }

  // A lattice with many chunks. Single precision has its values.
  static Piece lattice() {
    return test::mesh_piece(test::jittered(24, 0.2),
                            [](dvec3 p) { return double{static_cast<float>(p.x + 0.1 * std::sin(9 * p.y))}; });
  }

  // Values near 0.5 only.
  static Scene narrow() {
    Scene scene = scene_of_all();
    scene.transfer_function.lo = -0.2;
    scene.transfer_function.hi = 1.2;
    scene.transfer_function.densities = {{0.48, 0.0}, {0.5, 30.0}, {0.52, 0.0}};
    return scene;
  }
};

const std::vector<double> volumes_of_shapes = {1, 1.0 / 3, 0.5, 1.0 / 6, 1};

TEST_F(FileCellsOf, EveryShape) {
  std::ofstream(path("shapes.vtk")) << test::mesh_of_shapes();
  test::build_input(path("shapes.vtk"), path("shapes.svol"), exact(), {.selection = {"value"}});
  Scene scene = scene_of_all();
  scene.camera.position = {4, 3, 30};
  scene.camera.focal_point = {4, 3, 0};
  scene.transfer_function.lo = 0;
  scene.transfer_function.hi = 50;
  const auto kept = open_volume("shapes.svol");
  const auto cells = open(kept, scene);
  EXPECT_EQ(cells->unknown_cells(), 0u);
  double volume = 0;
  for (const auto& tetrahedron : cells_of(*cells)) {
    volume += volume_of(tetrahedron);
    for (const auto& [x, y, z, value, factor] : tetrahedron) EXPECT_EQ(value, x + 2 * y + 4 * z);
  }
  EXPECT_NEAR(volume, 3, 1e-12);
}

TEST_F(FileCellsOf, EveryShapeWithValuesOfItsOwn) {
  std::ofstream(path("shapes.vtk")) << test::mesh_of_shapes();
  test::build_input(path("shapes.vtk"), path("shapes.svol"), exact(),
                    {.selection = {"number"}, .cells = CellValues::own});
  Scene scene = scene_of_all();
  scene.attribute = "number";
  scene.opacity = SceneOpacity{"number", scene.transfer_function};
  scene.camera.position = {4, 3, 30};
  scene.camera.focal_point = {4, 3, 0};
  std::map<double, double> volumes;
  const auto kept = open_volume("shapes.svol");
  for (const auto& tetrahedron : cells_of(*open(kept, scene))) {
    volumes[tetrahedron[0][3]] += volume_of(tetrahedron);
    EXPECT_EQ(tetrahedron[0][4], tetrahedron[0][3]);
  }
  ASSERT_EQ(volumes.size(), volumes_of_shapes.size());
  for (std::size_t cell = 0; cell < volumes_of_shapes.size(); ++cell)
    EXPECT_NEAR(volumes[static_cast<double>(cell)], volumes_of_shapes[cell], 1e-12) << cell;

  scene.contours = {{.values = {2}}};
  EXPECT_THAT(test::message_of(KeptCells::open(*kept, scene, own_room(0))),
              HasSubstr("contours: each cell has one value"));
}

TEST_F(FileCellsOf, AMeshAreAllOfItsCells) {
  const Piece piece = lattice();
  const Found expected = cells_of(piece);
  const auto volume = build(piece);
  for (const std::uint64_t bytes : {memory, std::uint64_t{1} << 16, std::uint64_t{0}}) {
    const auto cells = open(volume, scene_of_all(), bytes);
    EXPECT_GT(cells->chunks().size(), 8u);
    std::size_t about = 0;
    for (const CellSource::Chunk& chunk : cells->chunks()) about += chunk.tetrahedra;
    EXPECT_EQ(about, expected.size());
    EXPECT_TRUE(cells_of(*cells) == expected) << bytes;
  }
}

// With all memory, each part of the file is read once.
TEST_F(FileCellsOf, AMeshAreReadByThreadsOnce) {
  const Piece piece = lattice();
  const Found expected = cells_of(piece);
  const auto alone = build(piece), shared = open_volume("mesh.svol");
  const auto first = open(alone, scene_of_all()), second = open(shared, scene_of_all());
  static_cast<void>(cells_of(*first));
  std::vector<Found> found(4);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < found.size(); ++t)
    threads.emplace_back([&, t] {
      Tetrahedra scratch;
      for (std::size_t i = t; i < second->chunks().size(); i += found.size()) {
        const auto cells = second->read(second->chunks()[i], scratch);
        ASSERT_EQ(test::message_of(cells), "");
        add(**cells, found[t]);
      }
    });
  for (std::thread& thread : threads) thread.join();
  Found all;
  for (const Found& part : found) all.insert(all.end(), part.begin(), part.end());
  std::ranges::sort(all);
  EXPECT_TRUE(all == expected);
  EXPECT_EQ(shared->bytes_read(), alone->bytes_read());
  EXPECT_LE(alone->bytes_read(), alone->file_bytes());
}

// The gradients at the points of tetrahedra that a contour cuts.
std::map<std::array<double, 3>, dvec3> gradients_of(const FileCells& cells, const std::vector<double>& contours,
                                                    bool from_the_end = false) {
  std::map<std::array<double, 3>, dvec3> all;
  Tetrahedra scratch;
  std::vector<CellSource::Chunk> chunks(cells.chunks().begin(), cells.chunks().end());
  if (from_the_end) std::ranges::reverse(chunks);
  for (const CellSource::Chunk& chunk : chunks) {
    const Tetrahedra& read = *test::value_of(cells.read(chunk, scratch));
    const auto gradients = test::value_of(cells.gradients(chunk, read, contours));
    EXPECT_EQ(gradients->size(), read.points.size());
    for (const auto& corners : read.corners) {
      std::array<double, 4> values{};
      for (std::size_t k = 0; k < 4; ++k) values[k] = read.values[0][corners[k]];
      const auto [low, high] = std::ranges::minmax(values);
      if (std::ranges::none_of(contours, [&](double value) { return low < value && value <= high; })) continue;
      for (const std::uint32_t corner : corners) {
        const dvec3& p = read.points[corner];
        const auto [at, is_new] = all.try_emplace({p.x, p.y, p.z}, (*gradients)[corner]);
        EXPECT_EQ(at->second, (*gradients)[corner]) << "in two tetrahedra";
      }
    }
  }
  return all;
}

// What the chunks of a view need is read ahead.
TEST_F(FileCellsOf, AFarFileAreReadByFewRequests) {
  build(lattice());
  std::ofstream(path("shapes.vtk")) << test::mesh_of_shapes();
  test::build_input(path("shapes.vtk"), path("own.svol"), exact(), {.selection = {"number"}, .cells = CellValues::own});
  Scene all = scene_of_all(), boxed = scene_of_all(), own = scene_of_all();
  boxed.clip_box = Box{{0.1, 0.3, 0.2}, {0.5, 0.6, 0.35}};
  own.attribute = "number";
  own.opacity = SceneOpacity{"number", own.transfer_function};
  Scene contour = boxed;
  contour.transfer_function.densities = {{0, 0}};
  contour.contours = {{.values = {0.4}}};
  for (const bool knows_parts : {true, false})
    for (const Scene& scene : {all, boxed, own, contour}) {
      const std::string file = path(scene.attribute == "number" ? "own.svol" : "mesh.svol");
      const auto near = test::value_of(format::Volume::open(*open_file(file)));
      const auto nearby = open(near, scene);
      const Found expected = cells_of(*nearby);
      if (!scene.contours.empty()) static_cast<void>(gradients_of(*nearby, {0.4}));
      const auto counts = std::make_shared<test::FarFile::Counts>();
      const auto far = test::value_of(format::Volume::open(std::make_unique<test::FarFile>(file, knows_parts, counts)));
      const auto cells = open(far, scene);
      std::vector<std::uint64_t> numbers;
      for (const CellSource::Chunk& chunk : cells->chunks()) numbers.push_back(chunk.number);
      const auto ahead = test::value_of(cells->read_ahead(numbers));
      const std::uint64_t requests = counts->requests;
      EXPECT_TRUE(cells_of(*cells) == expected);
      if (!scene.contours.empty()) static_cast<void>(gradients_of(*cells, {0.4}));
      EXPECT_EQ(counts->requests, requests) << "all was read ahead";
      EXPECT_LE(requests, 12 + counts->bytes / (std::uint64_t{256} << 10));
      EXPECT_EQ(far->bytes_read(), counts->bytes);
      if (knows_parts) {
        EXPECT_LE(static_cast<double>(counts->bytes), 1.1 * static_cast<double>(near->bytes_read()));
      }
    }
}

// A point's gradient comes from all chunks with the point.
TEST_F(FileCellsOf, AMeshHaveGradientsAcrossChunks) {
  const Piece piece = lattice();
  const auto volume = build(piece);
  std::vector<GradientSum> sums(piece.points.size());
  add_gradients(piece.points, piece.tetrahedra, piece.values[0], sums);
  const std::vector<double> contours = {0.2, 0.55, 0.7};
  const auto first = gradients_of(*open(volume, scene_of_all()), contours);
  EXPECT_GT(first.size(), piece.points.size() / 8);
  EXPECT_LT(first.size(), piece.points.size());
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const dvec3& p = piece.points[i];
    const auto found = first.find({p.x, p.y, p.z});
    if (found != first.end()) {
      EXPECT_LE(glm::distance(found->second, sums[i].mean()), 1e-9);
    }
  }
  for (const std::uint64_t bytes : {std::uint64_t{1} << 18, std::uint64_t{0}})
    EXPECT_EQ(gradients_of(*open(volume, scene_of_all(), bytes), contours, true), first) << bytes;
  // All cells are held: gradients are those of all points.
  const auto kept = test::value_of(KeptCells::open(*volume, scene_of_all(), own_room(memory)));
  ASSERT_TRUE(kept->hold_all());
  ASSERT_TRUE(kept->are_held());
  const auto held = test::value_of(FileCells::open(kept, scene_of_all(), make_view(scene_of_all()).value()));
  const std::uint64_t read = volume->bytes_read();
  for (int times = 0; times < 2; ++times) EXPECT_EQ(gradients_of(*held, contours), first);
  EXPECT_EQ(volume->bytes_read(), read);
}

// Values jump between two bodies that touch: gradients do not mix.
TEST_F(FileCellsOf, TwoBodiesHaveGradientsOfTheirOwn) {
  const auto lower = [](dvec3 p) { return p.x; };
  const auto upper = [](dvec3 p) { return 50 - 2 * p.y; };
  Piece first = test::mesh_piece(test::jittered(8, 0), lower), second = test::mesh_piece(test::jittered(8, 0), upper);
  for (dvec3& point : second.points) point.z += 1;
  second.values[0].clear();
  for (const dvec3& point : second.points) second.values[0].push_back(upper(point));
  test::PieceSource source({first, second}, {.attributes = {"value"}});
  ASSERT_EQ(test::message_of(build_volume(source, path("two.svol"), exact(), [](const char*, double) {})), "");
  const auto volume = open_volume("two.svol");
  Scene scene = scene_of_all();
  scene.transfer_function.lo = -100, scene.transfer_function.hi = 100;
  scene.camera.position = {3, 4, 9};
  const auto cells = open(volume, scene);
  Tetrahedra scratch;
  std::size_t cut = 0;
  for (const CellSource::Chunk& chunk : cells->chunks()) {
    const Tetrahedra& tetrahedra = *test::value_of(cells->read(chunk, scratch));
    const auto gradients = test::value_of(cells->gradients(chunk, tetrahedra, {{0.5, 25, 49}}));
    for (const auto& corners : tetrahedra.corners) {
      const double value = tetrahedra.values[0][corners[0]];
      const auto on_side = [&](std::uint32_t corner) {
        return (tetrahedra.values[0][corner] < (value < 10 ? 0.5 : 49)) == (value < (value < 10 ? 0.5 : 49));
      };
      if (std::ranges::all_of(corners, on_side)) continue;
      for (const std::uint32_t corner : corners)
        EXPECT_LE(glm::distance((*gradients)[corner], value < 10 ? dvec3(1, 0, 0) : dvec3(0, -2, 0)), 1e-6);
      ++cut;
    }
  }
  EXPECT_GE(cut, 2u * 8 * 8);
}

// Cells without a visible value, or outside of the view, are not read. The picture has all others.
TEST_F(FileCellsOf, AViewAreThoseThatItShows) {
  const Piece piece = lattice();
  const auto volume = build(piece);
  Scene close = scene_of_all(), inside = scene_of_all(), parallel = scene_of_all(), boxed = scene_of_all(),
        cut = scene_of_all();
  close.camera.position = {0.9, 0.9, 1.2};
  close.camera.focal_point = {0.9, 0.9, 0.5};
  inside.camera.position = {0.5, 0.5, 0.3};
  inside.camera.focal_point = {0.5, 0.4, -0.3};
  parallel.camera.projection = Camera::Projection::orthographic;
  parallel.camera.parallel_height = 0.2;
  parallel.camera.focal_point = {0.9, 0.9, 0.1};
  boxed.clip_box = Box{{0.1, 0.3, 0.2}, {0.4, 0.6, 0.35}};
  cut.clip_planes = {{.point = {0.3, 0.3, 0.3}, .normal = {-1, -1, 0.2}}};
  const std::size_t all = open(volume, scene_of_all())->chunks().size();
  const std::vector<std::array<std::uint32_t, 4>> tetrahedra(piece.tetrahedra.begin(), piece.tetrahedra.end());
  for (const Scene& scene : {narrow(), close, inside, parallel, boxed, cut}) {
    const auto cells = open(volume, scene);
    EXPECT_LT(cells->chunks().size(), all);
    const auto picture = picture_of(*cells, scene).image,
               expected = test::value_of(render_reference({piece.points, piece.values[0], tetrahedra}, scene)).image;
    EXPECT_GT(std::ranges::max(expected.pixels, {}, &vec4::a).a, 0.1F);
    EXPECT_LE(compare_images(picture, expected)->max, 1e-6);
  }
}

TEST_F(FileCellsOf, AnOpacityHaveItsValues) {
  Piece piece = lattice();
  piece.values.push_back(test::sample({piece.points, {}}, [](dvec3 p) { return double{static_cast<float>(p.z)}; }));
  const auto volume = build(piece, {"value", "height"});
  Scene scene = scene_of_all();
  scene.opacity = SceneOpacity{"height", scene.transfer_function};
  scene.opacity->function.densities = {{0, 1.0}};
  EXPECT_TRUE(cells_of(*open(volume, scene)) == cells_of(piece));
  scene.opacity->function.lo = 0;
  scene.opacity->function.hi = 1;
  scene.opacity->function.densities = {{0.1, 1.0}, {0.2, 0.0}};
  const auto cells = open(volume, scene);
  EXPECT_LT(cells->chunks().size(), open(volume, scene_of_all())->chunks().size());
  double lowest = 1;
  for (const auto& tetrahedron : cells_of(*cells)) lowest = std::min(lowest, tetrahedron[0][4]);
  EXPECT_LT(lowest, 0.1);
}

TEST_F(FileCellsOf, AStepHaveItsValues) {
  const test::Mesh mesh = test::lattice(12);
  std::vector<SeriesStep> steps;
  const auto field = [](double step) { return [=](dvec3 p) { return double{static_cast<float>(step * p.x + p.y)}; }; };
  for (const double step : {0.0, 1.0, 2.0}) steps.push_back(test::mesh_step(step, mesh, field(step)));
  ASSERT_EQ(test::message_of(build_series(steps, path("series.svol"), exact(), [](const char*, double) {})), "");
  const auto series = open_volume("series.svol");
  Scene scene = scene_of_all();
  scene.transfer_function.lo = 0;
  scene.transfer_function.hi = 3;
  for (const std::size_t step : {0, 1, 2}) {
    const auto volume = test::value_of(series->at_step(step));
    scene.transfer_function.densities = {{0, 1.0}};
    EXPECT_TRUE(cells_of(*open(volume, scene)) == cells_of(test::mesh_piece(mesh, field(static_cast<double>(step)))));
    scene.transfer_function.densities = {{0.8, 0.0}, {1, 1.0}};  // values above 2.4
    EXPECT_EQ(open(volume, scene)->chunks().empty(), step < 2) << step;
  }
}

TEST_F(FileCellsOf, UnknownShapesAreLeftOutAndCounted) {
  std::ofstream(path("shapes.vtk")) << test::mesh_of_shapes();
  test::build_input(path("shapes.vtk"), path("shapes.svol"), exact(), {.selection = {"value"}});
  const std::string text = read_text_file(path("shapes.svol")).value();
  const auto bytes = std::as_bytes(std::span(text));
  const auto changed =
      test::Dissected({bytes.begin(), bytes.end()}).assemble([](test::Part part, std::size_t, format::Bytes& record) {
        constexpr auto wedge = static_cast<std::byte>(format::CellShape::wedge);
        // The shape of each chunk entry, and that of each kind.
        std::size_t at = 32, step = sizeof(format::CellChunkEntry);
        if (part == test::Part::cell_root) at = 0, step = sizeof(format::CellKind);
        if (part != test::Part::cell_root && part != test::Part::cell_entries) return;
        for (std::size_t i = 0; i < 5; ++i, at += step)
          if (record[at] == wedge) record[at] = std::byte{77};
      });
  std::ofstream(path("newer.svol"), std::ios::binary)
      .write(reinterpret_cast<const char*>(changed.data()), static_cast<std::streamsize>(changed.size()));
  Scene scene = scene_of_all();
  scene.camera.position = {4, 3, 30};
  scene.camera.focal_point = {4, 3, 0};
  scene.transfer_function.densities = {{0, 1.0}};
  const auto newer = open_volume("newer.svol");
  const auto cells = open(newer, scene);
  EXPECT_EQ(cells->unknown_cells(), 1u);
  double volume = 0;
  for (const auto& tetrahedron : cells_of(*cells)) volume += volume_of(tetrahedron);
  EXPECT_NEAR(volume, 2.5, 1e-12);
}

TEST_F(FileCellsOf, AFileWithoutCellsAreRefused) {
  test::build_mesh(
      test::lattice(4), [](dvec3 p) { return p.x; }, path("plain.svol"));
  const auto plain = open_volume("plain.svol");
  const auto refused = KeptCells::open(*plain, scene_of_all(), own_room(0));
  EXPECT_THAT(test::message_of(refused), HasSubstr("without --drop-cells"));
  Scene other = scene_of_all();
  other.attribute = "no such";
  const auto unknown = KeptCells::open(*plain, other, own_room(0));
  EXPECT_THAT(test::message_of(unknown), HasSubstr("no such"));
}

// The pieces of rays in tetrahedra with a visible value whose middle is in the clip region.
double segments_of(const Found& tetrahedra, Scene scene) {
  const ClipRegion clip = make_view(scene).value().clip;
  scene.clip_box.reset();
  scene.clip_planes.clear();
  std::vector<dvec3> points;
  std::vector<double> values;
  std::vector<std::array<std::uint32_t, 4>> inside;
  for (const auto& tetrahedron : tetrahedra) {
    dvec3 middle(0);
    for (const auto& [x, y, z, value, factor] : tetrahedron) middle += dvec3(x, y, z) / 4.0;
    if (!clip.contains(middle)) continue;
    const auto of_value = [](const auto& corner) { return corner[3]; };
    const auto [least, most] = std::ranges::minmax_element(tetrahedron, {}, of_value);
    if (!extinction_within(scene.transfer_function, of_value(*least), of_value(*most))) continue;
    const auto first = static_cast<std::uint32_t>(points.size());
    inside.push_back({first, first + 1, first + 2, first + 3});
    for (const auto& [x, y, z, value, factor] : tetrahedron) {
      points.emplace_back(x, y, z);
      values.push_back(value);
    }
  }
  return static_cast<double>(test::value_of(render_reference({points, values, inside}, scene)).segments);
}

TEST_F(FileCellsOf, AViewHaveAboutTheEstimatedSegments) {
  const auto volume = build(lattice());
  Scene all = scene_of_all();
  all.camera.position = {1.7, -1.5, 2.4};
  Scene inside = all, beside = all, parallel = all, boxed = all, cut = all;
  inside.camera.position = {0.8, 0.3, 0.6};
  inside.camera.focal_point = {0.2, 0.5, 0.1};
  beside.camera.focal_point = {0.9, 0.5, 0.5};
  parallel.camera.projection = Camera::Projection::orthographic;
  parallel.camera.parallel_height = 1.2;
  boxed.clip_box = Box{{0.1, 0.3, 0.2}, {0.4, 0.6, 0.7}};
  cut.clip_planes = {{.point = {0.5, 0.5, 0.3}, .normal = {-1, -1, 0.2}}};
  Scene peak = narrow(), high = narrow();  // few cells of most chunks
  peak.transfer_function.densities = {{0, 0}, {0.4999, 0}, {0.5, 1}, {0.5001, 0}};
  high.transfer_function.densities = {{0, 0}, {0.85, 0}, {0.86, 1}};
  for (const Scene& scene : {all, inside, beside, parallel, boxed, cut, peak, high}) {
    const auto cells = open(volume, scene);
    const double truth = segments_of(cells_of(*cells), scene), estimate = test::value_of(cells->estimate_segments());
    EXPECT_GT(truth, 300);
    EXPECT_GT(estimate, truth / 1.4);
    EXPECT_LT(estimate, truth * 1.4);
  }
}

// Rays meet few faces of flat cells from their side: if faces had all directions, ten times as many.
TEST_F(FileCellsOf, FlatLayersHaveAboutTheEstimatedSegments) {
  Piece flat = lattice();
  for (dvec3& p : flat.points) p.z *= 0.02;
  const auto volume = build(flat);
  Scene above = scene_of_all(), beside = above;
  above.camera.position = {0.5, 0.5, 2};
  above.camera.focal_point = beside.camera.focal_point = {0.5, 0.5, 0.01};
  beside.camera.position = {2, 0.5, 0.01};
  beside.camera.up = {0, 0, 1};
  for (const Scene& scene : {above, beside}) {
    const auto cells = open(volume, scene);
    const double truth = segments_of(cells_of(*cells), scene), estimate = test::value_of(cells->estimate_segments());
    EXPECT_GT(truth, 300);
    EXPECT_GT(estimate, truth / 1.4);
    EXPECT_LT(estimate, truth * 2.5);
  }
}

// Rays along the axes of a lattice run in its faces, but for a move of its points, and for the file's rounding.
TEST_F(FileCellsOf, LatticesAlongWhichRaysGraze) {
  for (const double move : {0.0, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8})
    for (const bool is_exact : {false, true})
      for (const bool orthographic : {false, true}) {
        SCOPED_TRACE(testing::Message() << move << (is_exact ? ", exact" : "")
                                        << (orthographic ? ", orthographic" : ""));
        BuildOptions options = exact();
        options.exact = {.positions = is_exact, .values = is_exact};
        test::build_mesh(test::jittered(8, move), test::waves, path("mesh.svol"), options);
        Scene scene = test::scene_of_waves(33, 33);  // an eighth of the lattice is four pixels
        scene.camera.vertical_fov_degrees = 20;
        if (orthographic) scene.camera.projection = Camera::Projection::orthographic;
        scene.camera.parallel_height = 33.0 / 32;
        const auto volume = open_volume("mesh.svol");
        for (int axis = 0; axis < 3; ++axis) {
          dvec3 away(0);
          away[axis] = 3;
          scene.camera.position = scene.camera.focal_point + away;
          scene.camera.up = axis == 1 ? dvec3(0, 0, 1) : dvec3(0, 1, 0);
          const auto cells = open(volume, scene);
          const auto drawn = test::value_of(
              CellRasterizer().draw(*cells, {.view = make_view(scene).value(), .transfer = transfer_of(scene)}));
          EXPECT_LE(compare_images(drawn.image, picture_of(*cells, scene).image)->max, 0.02) << axis;
        }
      }
}

}  // namespace
}  // namespace splatvol
