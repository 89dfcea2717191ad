// Cells come back from a file as they were in the mesh, for VTK and for svbuild.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <vtkCell.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDataArray.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "format/cell_reader.h"
#include "format/payload.h"
#include "format/ranked_points.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/long.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test_volume.h"
#include "tests/support/volume_dump.h"
#include "tools/export/cell_export.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;

const auto no_progress = [](double) {};
const Box everywhere = format::SplatSelection().box;

// A position and the values there, in single precision as `svbuild --exact` stores them. Missing ones are `missing`: a
// NaN has no order.
using Corner = std::vector<double>;
using Cell = std::vector<Corner>;   // sorted
constexpr double missing = -1e300;  // below all values

Corner corner_of(const dvec3& position, const std::vector<double>& values) {
  Corner corner = {position.x, position.y, position.z};
  for (const double value : values) corner.push_back(std::isnan(value) ? missing : double{static_cast<float>(value)});
  return corner;
}

dvec3 position_of(const Corner& corner) { return {corner[0], corner[1], corner[2]}; }

// The cells of a mesh and their corners, whatever their order and numbers.
struct Contents {
  std::set<Corner> points;
  std::map<Cell, int> cells;  // how often

  void add(Cell cell) {
    std::ranges::sort(cell);
    if (std::ranges::adjacent_find(cell) != cell.end()) return;  // svbuild leaves it out
    points.insert(cell.begin(), cell.end());
    ++cells[cell];
  }

  [[nodiscard]] Contents in(const Box& box) const {
    Contents part;
    for (const auto& [cell, count] : cells) {
      Box round;
      for (const Corner& corner : cell) round.include(position_of(corner));
      bool meets = true;
      for (int axis = 0; axis < 3; ++axis)
        meets = meets && round.low[axis] <= box.high[axis] && round.high[axis] >= box.low[axis];
      if (!meets) continue;
      part.cells[cell] = count;
      part.points.insert(cell.begin(), cell.end());
    }
    return part;
  }
};

Contents contents_of(Source& source) {
  Contents contents;
  for (;;) {
    const auto piece = value_of(source.next());
    if (!piece) return contents;
    for (const auto& corners : piece->tetrahedra) {
      Cell cell;
      for (const std::uint32_t corner : corners) {
        std::vector<double> values;
        for (const std::vector<double>& attribute : piece->values) values.push_back(attribute[corner]);
        cell.push_back(corner_of(piece->points[corner], values));
      }
      contents.add(std::move(cell));
    }
  }
}

double volume_of(const Cell& cell) {
  std::array<dvec3, 4> p;
  for (std::size_t k = 0; k < 4; ++k) p[k] = position_of(cell[k]);

  return glm::dot(p[1] - p[0], glm::cross(p[2] - p[0], p[3] - p[0])) / 6;
}

// What VTK reads. Expects tetrahedra of volumes that are not negative, and no point without a cell.
struct VtkMesh {
  Contents contents;
  double volume = 0;
  vtkIdType points = 0, cells = 0;
};

// The values of an attribute in an array of VTK: a component or the magnitude of a vector, or a number.
struct VtkValues {
  vtkDataArray* array = nullptr;
  int component = -1;

  static VtkValues find(vtkPointData* data, const std::string& name) {
    if (vtkDataArray* array = data->GetArray(name.c_str())) return {array};
    const std::size_t bracket = name.rfind('[');
    if (bracket == std::string::npos) return {};
    return {data->GetArray(name.substr(0, bracket).c_str()), name[bracket + 1] - '0'};
  }
  [[nodiscard]] double at(vtkIdType point) const {
    if (component >= 0) return array->GetComponent(point, component);
    if (array->GetNumberOfComponents() == 1) return array->GetComponent(point, 0);
    const double* v = array->GetTuple3(point);
    return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  }
};

VtkMesh read_by_vtk(const std::string& path, const std::vector<std::string>& attributes) {
  vtkNew<vtkXMLUnstructuredGridReader> reader;
  reader->SetFileName(path.c_str());
  reader->Update();
  vtkUnstructuredGrid* grid = reader->GetOutput();
  VtkMesh mesh;
  mesh.points = grid->GetNumberOfPoints();
  mesh.cells = grid->GetNumberOfCells();
  std::vector<VtkValues> arrays;
  std::set<vtkDataArray*> different;
  for (const std::string& name : attributes) {
    arrays.push_back(VtkValues::find(grid->GetPointData(), name));
    EXPECT_NE(arrays.back().array, nullptr) << name;
    if (!arrays.back().array) return mesh;
    different.insert(arrays.back().array);
  }
  EXPECT_EQ(grid->GetPointData()->GetNumberOfArrays(), static_cast<int>(different.size()));
  vtkNew<vtkIdList> ids;
  for (vtkIdType i = 0; i < mesh.cells; ++i) {
    EXPECT_EQ(grid->GetCellType(i), VTK_TETRA);
    grid->GetCellPoints(i, ids);
    EXPECT_EQ(ids->GetNumberOfIds(), 4);
    if (ids->GetNumberOfIds() != 4) return mesh;
    Cell cell;
    for (int k = 0; k < 4; ++k) {
      dvec3 position;
      grid->GetPoint(ids->GetId(k), &position.x);
      std::vector<double> values;
      for (const VtkValues& array : arrays) values.push_back(array.at(ids->GetId(k)));
      cell.push_back(corner_of(position, values));
    }
    EXPECT_GE(volume_of(cell), 0);
    mesh.volume += volume_of(cell);
    mesh.contents.add(std::move(cell));
  }
  EXPECT_EQ(mesh.contents.points.size(), static_cast<std::size_t>(mesh.points));
  return mesh;
}

struct CellExport : FolderTest {
  std::shared_ptr<const format::Volume> build(Source& source, const std::string& name, bool exact = true,
                                              bool keep_cells = true) const {
    BuildOptions options{.memory = 64 << 20, .exact = {.positions = exact, .values = exact}, .keep_cells = keep_cells};
    EXPECT_TRUE(build_volume(source, path(name), options, [](const char*, double) {}).has_value());
    return format::Volume::open(open_file(path(name)).value()).value();
  }

  Result<CellsReport> try_export(const format::Volume& volume, const Box& box = everywhere,
                                 const std::vector<std::string>& attributes = {}) const {
    const auto selection = format::select_splats(volume, std::nullopt, attributes, box).value();
    return export_cells(volume, path("out.vtu"), selection, no_progress);
  }

  // Exports to out.vtu, and returns what VTK reads of it.
  VtkMesh export_and_read(const format::Volume& volume, const Box& box = everywhere,
                          const std::vector<std::string>& attributes = {}) const {
    const CellsReport report = value_of(try_export(volume, box, attributes));
    std::vector<std::string> names = attributes;
    if (names.empty()) {
      for (const format::Attribute& attribute : volume.info().attributes) names.push_back(attribute.name);
      for (const format::Alias& alias : volume.info().aliases) names.push_back(alias.name);
    }
    VtkMesh mesh = read_by_vtk(path("out.vtu"), names);
    EXPECT_EQ(report.cells, static_cast<std::uint64_t>(mesh.cells));
    EXPECT_EQ(report.points, static_cast<std::uint64_t>(mesh.points));
    EXPECT_EQ(report.left_out, 0U);
    EXPECT_NEAR(report.volume, mesh.volume, 1e-12 * mesh.volume);
    EXPECT_EQ(report.file_bytes, std::filesystem::file_size(path("out.vtu")));
    return mesh;
  }

  // Builds the export again, and expects the same cells and the same export of them.
  std::shared_ptr<const format::Volume> build_again(const format::Volume& volume) const {
    const std::string exported = read("out.vtu");
    const auto again = build(*value_of(open_source({path("out.vtu")}, {})), "again.svol");
    EXPECT_TRUE(volume.info().cells && again->info().cells);
    EXPECT_EQ(again->info().cells->hash, volume.info().cells->hash);
    EXPECT_EQ(again->info().resolution_counts, volume.info().resolution_counts);
    EXPECT_TRUE(try_export(*again));
    EXPECT_TRUE(read("out.vtu") == exported);
    return again;
  }

  // The same, and expects the same columns. Requires an input of single precision without vectors: svbuild computes
  // material from their magnitudes before they are rounded.
  void expect_same_when_built_again(const format::Volume& volume) const {
    const auto again = build_again(volume);
    EXPECT_EQ(columns_of(*again), columns_of(volume));
  }

  // The text of a volume without what tells where it comes from.
  static std::string columns_of(const format::Volume& volume) {
    std::string text = value_of(dump_volume(volume)), kept;
    for (std::size_t begin = 0; begin < text.size();) {
      const std::size_t end = std::min(text.find('\n', begin), text.size());
      const std::string line = text.substr(begin, end - begin);
      if (line.find("provenance") == std::string::npos) kept += line + "\n";
      begin = end + 1;
    }
    return kept;
  }
};

TEST_F(CellExport, GeneratedMeshesComeBack) {
  for (const std::string input : {"gen:mesh:cells=2e4,pieces=1", "gen:mesh:cells=5e4,pieces=27"}) {
    const auto source = value_of(open_source({input}, {}));
    const auto volume = build(*source, "in.svol");
    const VtkMesh mesh = export_and_read(*volume);
    const Contents input_mesh = contents_of(*value_of(open_source({input}, {})));
    EXPECT_EQ(mesh.contents.cells, input_mesh.cells) << input;
    EXPECT_EQ(mesh.contents.points, input_mesh.points) << input;
    EXPECT_NEAR(mesh.volume, 4 * 4 * 2, 1e-11) << "the box B of builder/sources/generator.h";
    expect_same_when_built_again(*volume);
  }
}

// Cells of any shape and orientation that share no point, in pieces.
TEST_F(CellExport, CellsOfAnyOrientationComeBack) {
  const Mesh mesh = random_tetrahedra(500);
  PieceSource source(cut(mesh_piece(mesh, [](dvec3 p) { return double{static_cast<float>(p.x)}; }), 7));
  const auto volume = build(source, "in.svol");
  const VtkMesh read = export_and_read(*volume);
  EXPECT_EQ(read.cells, 500);
  EXPECT_EQ(read.points, 2000);
  EXPECT_NEAR(read.volume, test::volume(mesh), 1e-12 * read.volume);
  PieceSource again({mesh_piece(mesh, [](dvec3 p) { return double{static_cast<float>(p.x)}; })});
  EXPECT_EQ(read.contents.cells, contents_of(again).cells);
}

TEST_F(CellExport, MissingValuesAndAliasesComeBack) {
  Piece piece = mesh_piece(jittered(12, 0.3), [](dvec3 p) { return double{static_cast<float>(p.x)}; });
  piece.values.push_back(piece.values[0]);
  piece.values.push_back(piece.values[0]);
  for (std::size_t i = 0; i < piece.points.size(); ++i)
    piece.values[1][i] = i % 5 == 2 ? missing_value : double{static_cast<float>(100 * piece.points[i].y)};
  const PieceSourceTraits traits{.attributes = {"p", "T", "p again"}};
  PieceSource source(cut(piece, 4), traits);
  const auto volume = build(source, "in.svol");
  ASSERT_EQ(volume->info().aliases, (std::vector<format::Alias>{{"p again", 0}}));

  PieceSource whole({piece}, traits);
  const Contents input = contents_of(whole);
  EXPECT_EQ(export_and_read(*volume).contents.points, input.points);
  expect_same_when_built_again(*volume);

  for (const auto& [name, column] : {std::pair<std::string, std::size_t>{"p again", 0}, {"T", 1}}) {
    const Contents one = export_and_read(*volume, everywhere, {name}).contents;
    EXPECT_EQ(one.cells.size(), input.cells.size());
    std::set<Corner> expected;
    for (const Corner& corner : input.points) expected.insert({corner[0], corner[1], corner[2], corner[3 + column]});
    EXPECT_EQ(one.points, expected);
  }
}

// Without --exact, positions and values are within the errors that the metadata state.
TEST_F(CellExport, RoundingIsWithinTheStatedErrors) {
  const auto map = [](dvec3 p) { return dvec3(4.5e5, 5.4e6, -300) + p * dvec3(2e4, 3e4, 40); };
  const auto field = [](dvec3 p) { return std::sin(1e-3 * p.x) + p.z; };
  const Mesh mesh = lattice(16, map);
  PieceSource source(cut(mesh_piece(mesh, field), 3), {.attributes = {"value"}, .bounds = true});
  const auto volume = build(source, "in.svol", false);
  const format::VolumeInfo& info = volume->info();
  ASSERT_GT(info.position_error, 0);
  const VtkMesh read = export_and_read(*volume);
  EXPECT_EQ(read.cells, static_cast<vtkIdType>(mesh.tetrahedra.size()));
  EXPECT_EQ(read.contents.points.size(), mesh.points.size());
  EXPECT_NEAR(read.volume, test::volume(mesh), 1e-4 * read.volume);

  // Spacings are far above the error, so the lattice tells which point is which.
  std::map<Corner, dvec3> nearest;
  const auto index_of = [&](const dvec3& p) {
    return corner_of(glm::round((p - map(dvec3(0))) / dvec3(2e4, 3e4, 40) * 16.0), {});
  };
  for (const dvec3& p : mesh.points) nearest[index_of(p)] = p;
  for (const Corner& corner : read.contents.points) {
    const auto found = nearest.find(index_of(position_of(corner)));
    ASSERT_NE(found, nearest.end());
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_LE(std::abs(position_of(corner)[axis] - found->second[axis]), info.position_error);
    EXPECT_LE(std::abs(corner[3] - field(found->second)), info.attributes[0].error + 1e-7 * std::abs(corner[3]));
    nearest.erase(found);
  }
  EXPECT_TRUE(nearest.empty());
}

TEST_F(CellExport, ABoxTakesTheCellsThatMeetIt) {
  const auto source = value_of(open_source({"gen:mesh:cells=5e4,pieces=8"}, {}));
  const auto volume = build(*source, "in.svol");
  const Contents all = export_and_read(*volume).contents;
  const std::vector<Box> boxes = {{dvec3(-0.3, 0.1, -0.2), dvec3(0.4, 0.9, 0.3)},      // within
                                  {dvec3(0.11, 0.12, 0.13), dvec3(0.11, 0.12, 0.13)},  // one position
                                  {dvec3(-9), dvec3(9)},
                                  {dvec3(-9, -9, -9), dvec3(-2, 9, 9)},  // touches a side
                                  {dvec3(1.9, -9, -9), dvec3(9)}};
  for (const Box& box : boxes) {
    const Contents expected = all.in(box);
    ASSERT_FALSE(expected.cells.empty());
    const Contents part = export_and_read(*volume, box).contents;
    EXPECT_EQ(part.cells, expected.cells);
    EXPECT_EQ(part.points, expected.points);
  }
  std::filesystem::remove(path("out.vtu"));
  const Box outside{dvec3(2.0001, 0, 0), dvec3(3, 1, 1)};
  EXPECT_EQ(try_export(*volume, outside).error().message, path("in.svol") + ": no cells in the box");
  EXPECT_FALSE(std::filesystem::exists(path("out.vtu")));
}

TEST_F(CellExport, ASmallBoxReadsLittle) {
  const auto source = value_of(open_source({"gen:mesh:cells=1e6,pieces=8"}, {}));
  build(*source, "in.svol");
  std::vector<std::uint64_t> read;
  for (const Box& box : {Box{dvec3(0.5), dvec3(0.52)}, everywhere}) {
    const auto volume = format::Volume::open(open_file(path("in.svol")).value()).value();
    ASSERT_TRUE(try_export(*volume, box));
    read.push_back(volume->bytes_read());
  }
  const std::uint64_t file = std::filesystem::file_size(path("in.svol"));
  EXPECT_LT(read[0], file / 10);
  EXPECT_LT(read[1], file) << "the moments are not read, and the cells once";
}

TEST_F(CellExport, AFileWithoutCellsIsRefused) {
  const auto source = value_of(open_source({"gen:mesh:cells=1e3"}, {}));
  const auto volume = build(*source, "in.svol", true, false);
  EXPECT_EQ(
      try_export(*volume).error().message,
      path("in.svol") +
          ": keeps no cells: build it from a mesh, or from points by --connectivity delaunay, without --drop-cells");
  EXPECT_EQ(names(), std::vector<std::string>{"in.svol"});
}

TEST_F(CellExport, AnExportIsReplacedAndAMeshIsNot) {
  const auto source = value_of(open_source({"gen:mesh:cells=1e3"}, {}));
  const auto volume = build(*source, "in.svol");
  EXPECT_TRUE(try_export(*volume));
  EXPECT_TRUE(try_export(*volume));
  write("out.vtu", "<VTKFile type=\"UnstructuredGrid\"/>");
  EXPECT_THAT(try_export(*volume).error().message, HasSubstr("--force"));
}

// Cubes of a bent lattice, n^3 of them, as hexahedra or polyhedra. The value of each is its number; of the last one it
// is missing.
dvec3 bent(int x, int y, int z) { return dvec3(x, y, z) + 0.1 * glm::sin(dvec3(y + z, x + 2 * z, x - y)); }

std::array<dvec3, 8> corners_of_cube(int cube, int n) {  // as VTK numbers them
  std::array<dvec3, 8> corners;
  for (int k = 0; k < 8; ++k)
    corners[static_cast<std::size_t>(k)] =
        bent(cube % n + (k % 4 == 1 || k % 4 == 2 ? 1 : 0), cube / n % n + (k % 4 > 1 ? 1 : 0), cube / n / n + k / 4);
  return corners;
}

std::string cubes(int n, bool as_polyhedra) {
  const int count = n * n * n;
  std::string points, cells, values;
  for (int cube = 0; cube < count; ++cube) {
    for (const dvec3& p : corners_of_cube(cube, n)) points += fmt::format("{:.17g} {:.17g} {:.17g}\n", p.x, p.y, p.z);
    const auto corner = [&](int k) { return fmt::format(" {}", 8 * cube + k); };
    if (as_polyhedra) {
      cells += "31 6";
      for (const std::array<int, 4>& face :
           {std::array{0, 4, 7, 3}, {1, 2, 6, 5}, {0, 1, 5, 4}, {3, 7, 6, 2}, {0, 3, 2, 1}, {4, 5, 6, 7}})
        cells += " 4" + corner(face[0]) + corner(face[1]) + corner(face[2]) + corner(face[3]);
    } else {
      cells += "8";
      for (int k = 0; k < 8; ++k) cells += corner(k);
    }
    cells += "\n";
    values += cube == count - 1 ? "1e300\n" : fmt::format("{}\n", cube);
  }
  std::string types;
  for (int cube = 0; cube < count; ++cube) types += as_polyhedra ? "42\n" : "12\n";
  return fmt::format(
      "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {} double\n{}CELLS {} {}\n{}"
      "CELL_TYPES {}\n{}CELL_DATA {}\nSCALARS c double 1\nLOOKUP_TABLE default\n{}",
      8 * count, points, count, count * (as_polyhedra ? 32 : 9), cells, count, types, count, values);
}

// Cells of svbuild --cells own have the values. Their corners are no points of the file, and have none.
TEST_F(CellExport, CellsOfTheirOwnHaveTheirValues) {
  constexpr int n = 6, count = n * n * n;
  for (const bool as_polyhedra : {false, true}) {
    write("cubes.vtk", cubes(n, as_polyhedra));
    const auto volume = build(*value_of(open_source({path("cubes.vtk")}, {.cells = CellValues::own})), "own.svol");
    const CellsReport report = value_of(try_export(*volume));
    vtkNew<vtkXMLUnstructuredGridReader> reader;
    reader->SetFileName(path("out.vtu").c_str());
    reader->Update();
    vtkUnstructuredGrid* const grid = reader->GetOutput();
    vtkDataArray* const values = grid->GetCellData()->GetArray("c");
    ASSERT_NE(values, nullptr);
    EXPECT_EQ(grid->GetPointData()->GetNumberOfArrays(), 0);
    EXPECT_EQ(report.points, static_cast<std::uint64_t>((n + 1) * (n + 1) * (n + 1)));
    EXPECT_EQ(report.points, static_cast<std::uint64_t>(grid->GetNumberOfPoints()));
    EXPECT_EQ(report.cells, static_cast<std::uint64_t>(grid->GetNumberOfCells()));
    ASSERT_EQ(values->GetNumberOfTuples(), grid->GetNumberOfCells());
    EXPECT_EQ(report.file_bytes, std::filesystem::file_size(path("out.vtu")));

    double volume_of_all = 0;
    std::set<int> found;
    vtkNew<vtkIdList> ids;
    for (vtkIdType cell = 0; cell < grid->GetNumberOfCells(); ++cell) {
      EXPECT_EQ(grid->GetCellType(cell), as_polyhedra ? VTK_TETRA : VTK_HEXAHEDRON);
      const double value = values->GetTuple1(cell);
      const int cube = std::isnan(value) ? count - 1 : static_cast<int>(value);
      found.insert(cube);
      grid->GetCellPoints(cell, ids);
      std::vector<dvec3> corners(static_cast<std::size_t>(ids->GetNumberOfIds()));
      for (std::size_t k = 0; k < corners.size(); ++k)
        grid->GetPoint(ids->GetId(static_cast<vtkIdType>(k)), &corners[k].x);
      const auto expected = corners_of_cube(cube, n);
      for (const dvec3& corner : corners)
        EXPECT_TRUE(std::ranges::any_of(expected, [&](const dvec3& p) { return glm::length(p - corner) < 0.01; }));
      if (as_polyhedra) {
        const double of_cell =
            glm::dot(corners[1] - corners[0], glm::cross(corners[2] - corners[0], corners[3] - corners[0])) / 6;
        EXPECT_GE(of_cell, 0);
        volume_of_all += of_cell;
      }
    }
    EXPECT_EQ(found.size(), static_cast<std::size_t>(count));
    if (as_polyhedra) {
      EXPECT_NEAR(volume_of_all, report.volume, 1e-9 * report.volume);
    }

    EXPECT_LT(value_of(try_export(*volume, {dvec3(1.5), dvec3(1.6)})).cells, report.cells / 4);
  }
}

// A section of cells that the test makes by itself, from a volume whose ranks it knows.
class OwnSection {
 public:
  explicit OwnSection(const TestVolume& volume) : volume_(volume), file_numbers_(volume.positions.size()) {
    std::iota(file_numbers_.begin(), file_numbers_.end(), 0U);
    std::ranges::sort(file_numbers_, {}, [&](std::size_t i) { return volume.point_paths[i]; });
    const std::vector<std::uint64_t>& counts = volume.info.resolution_counts;
    format::RankPage page{0, std::vector<std::uint64_t>(counts.size()), {}};
    for (const std::size_t i : file_numbers_)
      page.segments.push_back(static_cast<std::uint8_t>(std::ranges::upper_bound(counts, i) - counts.begin()));
    const format::Bytes packed = format::pack_rank_page(page, rank_page_);
    append(packed);
  }

  // Returns the position and value of a point by its rank.
  Corner corner(std::uint64_t rank) const {
    const std::size_t i = file_numbers_[rank];
    return corner_of(volume_.positions[i], {volume_.info.attributes[0].value(double{volume_.stored[0][i]})});
  }

  // Adds a chunk. Its cells are tetrahedra, whatever the entry says.
  void add_chunk(const std::vector<std::uint64_t>& corners, format::CellShape shape, format::CellField field) {
    const format::CellChunk cells{format::CellShape::tetrahedron, format::CellField::corners, corners, {}, {}};
    const format::LocalCells local = format::number_corners(corners);
    std::vector<dvec3> positions;
    for (const std::uint64_t rank : local.ranks) positions.push_back(position_of(corner(rank)));
    const format::CellExtent extent = format::measure_cells(cells, local, positions);
    format::PackedCells packed = format::pack_cells(cells, local.ranks.size());
    packed.entry.offset = bytes_.size();
    packed.entry.shape = shape;
    packed.entry.field = field;
    packed.entry.area = extent.area;
    std::copy_n(&extent.box.low.x, 3, packed.entry.low);
    std::copy_n(&extent.box.high.x, 3, packed.entry.high);
    append(packed.bytes);
    chunks_.push_back(packed.entry);
    kinds_.push_back({.shape = shape,
                      .field = field,
                      .zero = {},
                      .cells = packed.entry.cells,
                      .packed_bytes = packed.entry.packed_bytes,
                      .turned = 0});
  }

  // Ends a page of chunks.
  void close_page() {
    format::CellPageRef ref{};
    Box box;
    for (const format::CellChunkEntry& entry : chunks_) {
      box.include(dvec3(entry.low[0], entry.low[1], entry.low[2]));
      box.include(dvec3(entry.high[0], entry.high[1], entry.high[2]));
      ref.area += entry.area;
    }
    std::copy_n(&box.low.x, 3, ref.low);
    std::copy_n(&box.high.x, 3, ref.high);
    format::Bytes table, parts;
    const format::Bytes summaries = format::pack_summaries(std::vector<format::ValueSummary>(chunks_.size()));
    for (const auto raw : {std::as_bytes(std::span(chunks_)), std::span<const std::byte>(summaries)}) {
      const format::Bytes packed = format::pack(raw);
      format::append_record(table,
                            format::IndexPagePart{static_cast<std::uint32_t>(packed.size()),
                                                  static_cast<std::uint32_t>(raw.size()), format::hash_bytes(packed)});
      parts.insert(parts.end(), packed.begin(), packed.end());
    }
    ref.offset = page_bytes_.size();
    ref.chunks_offset = chunks_.front().offset;
    ref.page_bytes = static_cast<std::uint32_t>(table.size() + parts.size());
    ref.chunks = static_cast<std::uint32_t>(chunks_.size());
    ref.hash = format::hash_bytes(table);
    page_bytes_.insert(page_bytes_.end(), table.begin(), table.end());
    page_bytes_.insert(page_bytes_.end(), parts.begin(), parts.end());
    pages_.push_back(ref);
    chunks_.clear();
  }

  [[nodiscard]] format::Bytes finish() {
    for (format::CellPageRef& page : pages_) page.offset += bytes_.size();
    append(page_bytes_);
    format::Bytes root;
    for (const format::CellKind& kind : kinds_) format::append_record(root, kind);
    for (const format::CellPageRef& page : pages_) format::append_record(root, page);
    format::append_record(root, rank_page_);
    format::append_record(root, format::CellsTail{.hash = format::hash_bytes(root),
                                                  .chunks = kinds_.size(),
                                                  .pages = pages_.size(),
                                                  .vertices = 0,
                                                  .kinds = static_cast<std::uint32_t>(kinds_.size()),
                                                  .version = format::cells_version});
    append(root);
    return bytes_;
  }

 private:
  void append(const format::Bytes& bytes) { bytes_.insert(bytes_.end(), bytes.begin(), bytes.end()); }

  const TestVolume& volume_;
  std::vector<std::size_t> file_numbers_;  // [rank]
  format::Bytes bytes_;
  format::PackedPageRef rank_page_{};
  std::vector<format::CellChunkEntry> chunks_;  // of the page
  format::Bytes page_bytes_;                    // of all pages, which follow the chunks
  std::vector<format::CellPageRef> pages_;
  std::vector<format::CellKind> kinds_;  // one for each chunk
};

// Cubes as hexahedra, pairs of wedges and pyramids, of which rounding moves corners past each other.
std::string mixed_cells() {
  constexpr int n = 9;
  std::vector<dvec3> points;
  const auto node = [](int x, int y, int z) { return x + (n + 1) * (y + (n + 1) * z); };
  for (int z = 0; z <= n; ++z)
    for (int y = 0; y <= n; ++y)
      for (int x = 0; x <= n; ++x)
        points.push_back(dvec3(x, y, z) + 1e-5 * glm::sin(dvec3(y + 3 * z, 2 * x + z, x - 2 * y)));
  std::vector<std::pair<int, std::vector<int>>> cells;  // type, nodes
  for (int z = 0; z < n; ++z)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        std::array<int, 8> c{};
        for (int k = 0; k < 8; ++k)
          c[k] = node(x + (k % 4 == 1 || k % 4 == 2 ? 1 : 0), y + (k % 4 > 1 ? 1 : 0), z + k / 4);
        if ((x + y + z) % 3 == 0) {
          cells.push_back({VTK_HEXAHEDRON, {c.begin(), c.end()}});
        } else if ((x + y + z) % 3 == 1) {
          cells.push_back({VTK_WEDGE, {c[0], c[1], c[2], c[4], c[5], c[6]}});
          cells.push_back({VTK_WEDGE, {c[0], c[2], c[3], c[4], c[6], c[7]}});
        } else {
          const int middle = static_cast<int>(points.size());
          points.push_back(0.5 * (points[static_cast<std::size_t>(c[0])] + points[static_cast<std::size_t>(c[6])]));
          for (const auto& [i, j, k, l] :
               {std::array{0, 4, 7, 3}, {1, 2, 6, 5}, {0, 1, 5, 4}, {3, 7, 6, 2}, {0, 3, 2, 1}, {4, 5, 6, 7}})
            cells.push_back({VTK_PYRAMID, {c[l], c[k], c[j], c[i], middle}});
        }
      }
  std::string positions, values, lists, types, of_cells;
  std::size_t numbers = 0;
  for (const dvec3& p : points) {
    positions += fmt::format("{} {} {}\n", p.x, p.y, p.z);
    values += fmt::format("{}\n", p.x + 2 * p.y + p.z);
  }
  for (const auto& [type, nodes] : cells) {
    lists += fmt::format("{} {}\n", nodes.size(), fmt::join(nodes, " "));
    types += fmt::format("{}\n", type);
    of_cells += fmt::format("{}\n", nodes[0] % 7);
    numbers += 1 + nodes.size();
  }
  return fmt::format(
      "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {0} double\n{1}CELLS {2} {3}\n{4}"
      "CELL_TYPES {2}\n{5}POINT_DATA {0}\nSCALARS p double 1\nLOOKUP_TABLE default\n{6}"
      "CELL_DATA {2}\nSCALARS c double 1\nLOOKUP_TABLE default\n{7}",
      points.size(), positions, cells.size(), numbers, lists, types, values, of_cells);
}

// The tetrahedra of all cells of a file, by the positions of their corners.
std::multiset<Cell> tetrahedra_of(const format::Volume& volume) {
  std::multiset<Cell> tetrahedra;
  const auto cells = value_of(format::CellReader::open(volume));
  format::RankedPoints points(*cells, own_room(1 << 20));
  format::CellVertices vertices([&](std::size_t page) { return cells->read_vertex_page(page); }, own_room(1 << 20));
  for (std::size_t page = 0; page < cells->pages().size(); ++page)
    for (const format::CellChunkEntry& entry : value_of(cells->read_page(page, {})).chunks) {
      const format::CellChunk chunk = value_of(cells->read_chunk(entry));
      for (std::size_t cell = 0; cell < chunk.size(); ++cell) {
        std::vector<format::RankedPoints::Place> places;
        std::vector<dvec3> corners;
        if (chunk.field == format::CellField::constant) {
          EXPECT_TRUE(vertices.read_positions(chunk.corners_at(cell), corners));
        } else {
          EXPECT_TRUE(points.find(chunk.corners_at(cell), places));
          EXPECT_TRUE(points.read_positions(places, corners));
        }
        format::for_each_tetrahedron(chunk, cell, [&](const std::array<std::uint8_t, 4>& at) {
          Cell tetrahedron;
          for (const std::uint8_t k : at) tetrahedron.push_back(corner_of(corners[k], {}));
          std::ranges::sort(tetrahedron);
          tetrahedra.insert(std::move(tetrahedron));
        });
      }
    }
  return tetrahedra;
}

// Where rounding makes a reader choose other diagonals, cells are written as the file has them.
TEST_F(CellExport, CellsComeBackWithTheDiagonalsOfTheFile) {
  write("mixed.vtk", mixed_cells());
  for (const CellValues values : {CellValues::averaged, CellValues::own})
    for (const bool exact : {true, false}) {
      const SourceOptions of_mesh{.selection = {values == CellValues::own ? "c" : "p"}, .cells = values};
      const auto volume = build(*value_of(open_source({path("mixed.vtk")}, of_mesh)), "in.svol", exact);
      const CellsReport report = value_of(try_export(*volume));
      const std::uint64_t shapes = 243 + 2 * 243 + 6 * 243;
      EXPECT_EQ(report.split > 0, !exact);
      EXPECT_LT(report.split, shapes) << "others stay as they are";
      EXPECT_EQ(report.cells > shapes, !exact);
      const auto again = build(*value_of(open_source({path("out.vtu")}, of_mesh)), "again.svol");
      EXPECT_TRUE(tetrahedra_of(*again) == tetrahedra_of(*volume));
      // A box gives the same cells.
      const Box box{dvec3(2.5), dvec3(4.5)};
      const CellsReport part = value_of(try_export(*volume, box));
      EXPECT_EQ(part.split > 0, !exact);
      const auto again_part = build(*value_of(open_source({path("out.vtu")}, of_mesh)), "again.svol");
      const auto all = tetrahedra_of(*volume), some = tetrahedra_of(*again_part);
      EXPECT_TRUE(std::ranges::includes(all, some));
    }
}

// Chunks of a later version stand beside those that are known.
TEST_F(CellExport, UnknownShapesAreLeftOutAndCounted) {
  const std::size_t points = 400;
  std::vector<dvec3> positions = random_points(points, 5u);
  std::vector<double> values;
  for (const dvec3& p : positions) values.push_back(p.x);
  TestVolume volume = make_test_volume(positions, {values});
  volume.info.cells = format::CellsInfo{};
  constexpr auto tetrahedron = format::CellShape::tetrahedron;
  constexpr auto corners = format::CellField::corners;
  constexpr auto other_shape = static_cast<format::CellShape>(99);
  constexpr auto other_field = static_cast<format::CellField>(77);

  // Cells of the ranks r to r + 3. The last chunk names the highest ranks only.
  OwnSection section(volume);
  Contents known;
  std::vector<Box> boxes;
  const auto add = [&](std::uint64_t begin, std::uint64_t end, format::CellShape shape, format::CellField field) {
    std::vector<std::uint64_t> ranks;
    Box& box = boxes.emplace_back();
    for (std::uint64_t r = begin; r + 3 < end; ++r) {
      Cell cell;
      for (std::uint64_t k = r; k < r + 4; ++k) {
        ranks.push_back(k);
        cell.push_back(section.corner(k));
        box.include(position_of(cell.back()));
      }
      if (shape == tetrahedron && field == corners) known.add(cell);
    }
    section.add_chunk(ranks, shape, field);
  };
  add(0, 103, tetrahedron, corners);
  add(100, 155, other_shape, corners);
  section.close_page();
  add(150, 203, tetrahedron, other_field);
  add(200, 253, tetrahedron, corners);
  section.close_page();
  add(points - 5, points, other_shape, other_field);
  section.close_page();
  const format::Bytes bytes = section.finish();
  ASSERT_TRUE(write_test_volume(volume, path("in.svol"),
                                [&](const auto&, const format::AppendBytes& append) { return append(bytes); }));
  const auto opened = format::Volume::open(open_file(path("in.svol")).value()).value();

  const CellsReport report = value_of(try_export(*opened));
  EXPECT_EQ(report.cells, 100 + 50);
  EXPECT_EQ(report.left_out, 52 + 50 + 2);
  const VtkMesh all = read_by_vtk(path("out.vtu"), {"a0"});
  EXPECT_TRUE(all.contents.points == known.points);
  EXPECT_TRUE(all.contents.cells == known.cells);

  std::filesystem::remove(path("out.vtu"));
  const dvec3 outermost = boxes[4].high;  // in no other box
  for (std::size_t chunk = 0; chunk < 4; ++chunk)
    ASSERT_TRUE(glm::any(glm::lessThan(boxes[chunk].high, outermost))) << chunk;
  EXPECT_THAT(try_export(*opened, {outermost, outermost}).error().message, HasSubstr("does not know"));
  EXPECT_FALSE(std::filesystem::exists(path("out.vtu")));
}

// Meshes of the real world: with hexahedra, copies of vertices and points without cells.
TEST_F(CellExport, RealMeshesComeBack) {
  bool is_there = false;
  for (const std::string& name : sample_of<std::string>({"bluntfin", "post", "wing"})) {
    const std::string input = SPLATVOL_SHARED "/data/" + name + ".vtu";
    if (!std::filesystem::exists(input)) continue;
    is_there = true;
    const auto source = value_of(open_source({input}, {}));
    const auto volume = build(*source, "in.svol");
    const Contents mesh = export_and_read(*volume).contents;
    const Contents expected = contents_of(*value_of(open_source({input}, {})));
    EXPECT_TRUE(mesh.cells == expected.cells) << name;
    EXPECT_TRUE(mesh.points == expected.points) << name;
    build_again(*volume);
  }
  if (!is_there) GTEST_SKIP() << "no meshes in " SPLATVOL_SHARED "/data";
}

}  // namespace
}  // namespace splatvol::test
