// Which solutions of a CGNS file are values, at which time, and where.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <vtk_cgns.h>

#include <array>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "tests/builder/sources/read_input.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"
#include VTK_CGNS(cgnslib.h)

namespace splatvol::test {
namespace {

using namespace ::testing;

constexpr auto vertex = CGNS_ENUMV(Vertex), cell_center = CGNS_ENUMV(CellCenter);

/// A file of structured zones of 2 x 1 x 1 cells, along x.
class CgnsWriter {
 public:
  explicit CgnsWriter(const std::string& path) {
    EXPECT_EQ(cg_open(path.c_str(), CG_MODE_WRITE, &file_), 0) << cg_get_error();
    cg_base_write(file_, "Base", 3, 3, &base_);
  }
  ~CgnsWriter() { EXPECT_EQ(cg_close(file_), 0) << cg_get_error(); }
  CgnsWriter(const CgnsWriter&) = delete;
  CgnsWriter& operator=(const CgnsWriter&) = delete;

  int zone(const std::string& name, double x = 0, std::array<const char*, 3> axes = {"X", "Y", "Z"}) const {
    const std::array<cgsize_t, 9> size = {3, 2, 2, 2, 1, 1, 0, 0, 0};
    int zone = 0, ignored = 0;
    cg_zone_write(file_, base_, name.c_str(), size.data(), CGNS_ENUMV(Structured), &zone);
    std::array<std::vector<double>, 3> points;
    for (int p = 0; p < 12; ++p) {
      points[0].push_back(x + p % 3);
      points[1].push_back(p / 3 % 2);
      points[2].push_back(p / 6);
    }
    for (std::size_t axis = 0; axis < 3; ++axis)
      cg_coord_write(file_, base_, zone, CGNS_ENUMV(RealDouble), fmt::format("Coordinate{}", axes[axis]).c_str(),
                     points[axis].data(), &ignored);
    return zone;
  }

  /// A tetrahedron of one polyhedron: VTK's reader reads its mesh.
  int polyhedron(const std::string& name, double x) const {
    const std::array<cgsize_t, 3> size = {4, 1, 0};
    int zone = 0, ignored = 0;
    cg_zone_write(file_, base_, name.c_str(), size.data(), CGNS_ENUMV(Unstructured), &zone);
    const std::array<std::array<double, 4>, 3> points = {{{x, x + 1, x, x}, {0, 0, 1, 0}, {0, 0, 0, 1}}};
    for (std::size_t axis = 0; axis < 3; ++axis)
      cg_coord_write(file_, base_, zone, CGNS_ENUMV(RealDouble), fmt::format("Coordinate{}", "XYZ"[axis]).c_str(),
                     points[axis].data(), &ignored);
    const std::array<cgsize_t, 12> faces = {1, 3, 2, 1, 2, 4, 2, 3, 4, 1, 4, 3};
    const std::array<cgsize_t, 5> face_ends = {0, 3, 6, 9, 12};
    const std::array<cgsize_t, 4> cell = {1, 2, 3, 4};
    const std::array<cgsize_t, 2> cell_ends = {0, 4};
    cg_poly_section_write(file_, base_, zone, "Faces", CGNS_ENUMV(NGON_n), 1, 4, 0, faces.data(), face_ends.data(),
                          &ignored);
    cg_poly_section_write(file_, base_, zone, "Cells", CGNS_ENUMV(NFACE_n), 5, 5, 0, cell.data(), cell_ends.data(),
                          &ignored);
    return zone;
  }

  int solution(int zone, const std::string& name, CGNS_ENUMT(GridLocation_t) location) const {
    int number = 0;
    cg_sol_write(file_, base_, zone, name.c_str(), location, &number);
    return number;
  }
  int solution_at(int zone, const std::string& name, CGNS_ENUMT(GridLocation_t) location,
                  CGNS_ENUMT(PointSetType_t) type, cgsize_t count, const std::vector<cgsize_t>& numbers) const {
    int number = 0;
    EXPECT_EQ(cg_sol_ptset_write(file_, base_, zone, name.c_str(), location, type, count, numbers.data(), &number), 0)
        << cg_get_error();
    return number;
  }
  void field(int zone, int solution, const std::string& name, const std::vector<double>& values) const {
    int ignored = 0;
    EXPECT_EQ(
        cg_field_write(file_, base_, zone, solution, CGNS_ENUMV(RealDouble), name.c_str(), values.data(), &ignored), 0)
        << cg_get_error();
  }

  /// Writes an array into a node of a zone.
  void array_in(int zone, const char* label, int number, const char* name, const std::vector<double>& values,
                const std::vector<cgsize_t>& size) const {
    cg_goto(file_, base_, "Zone_t", zone, label, number, "end");
    EXPECT_EQ(cg_array_write(name, CGNS_ENUMV(RealDouble), static_cast<int>(size.size()), size.data(), values.data()),
              0)
        << cg_get_error();
  }
  void discrete(int zone, const char* array, const std::vector<double>& values) const {
    int number = 0;
    EXPECT_EQ(cg_discrete_write(file_, base_, zone, "Discrete", &number), 0) << cg_get_error();
    array_in(zone, "DiscreteData_t", number, array, values, {3, 2, 2});
  }
  void region(int zone, const char* array, const std::vector<double>& values) const {
    int number = 0;
    const std::array<cgsize_t, 6> range = {1, 1, 1, 3, 2, 2};
    EXPECT_EQ(cg_subreg_ptset_write(file_, base_, zone, "Region", 3, vertex, CGNS_ENUMV(PointRange), 2, range.data(),
                                    &number),
              0)
        << cg_get_error();
    array_in(zone, "ZoneSubRegion_t", number, array, values, {12});
  }

  void rind(int zone, int solution, const std::array<int, 6>& planes) const {
    cg_goto(file_, base_, "Zone_t", zone, "FlowSolution_t", solution, "end");
    EXPECT_EQ(cg_rind_write(planes.data()), 0) << cg_get_error();
  }

  void steps_without_times(const std::vector<int>& iterations) const {
    cg_biter_write(file_, base_, "Steps", 2);
    cg_goto(file_, base_, "BaseIterativeData_t", 1, "end");
    const auto count = static_cast<cgsize_t>(iterations.size());
    if (count > 0) cg_array_write("IterationValues", CGNS_ENUMV(Integer), 1, &count, iterations.data());
  }
  void times(const std::vector<double>& times) const {
    cg_biter_write(file_, base_, "Steps", static_cast<int>(times.size()));
    cg_goto(file_, base_, "BaseIterativeData_t", 1, "end");
    const auto count = static_cast<cgsize_t>(times.size());
    cg_array_write("TimeValues", CGNS_ENUMV(RealDouble), 1, &count, times.data());
  }
  /// The zones of each step, as many for all; an empty name stands for none.
  void zones_of_steps(const std::vector<std::vector<std::string>>& zones) const {
    std::string text;
    for (const auto& of_step : zones)
      for (const std::string& name : of_step) text += fmt::format("{:32}", name.empty() ? "Null" : name);
    const std::vector<int> counts(zones.size(), static_cast<int>(zones[0].size()));
    const auto steps = static_cast<cgsize_t>(zones.size());
    const std::array<cgsize_t, 3> size = {32, static_cast<cgsize_t>(zones[0].size()), steps};
    cg_goto(file_, base_, "BaseIterativeData_t", 1, "end");
    cg_array_write("NumberOfZones", CGNS_ENUMV(Integer), 1, &steps, counts.data());
    EXPECT_EQ(cg_array_write("ZonePointers", CGNS_ENUMV(Character), 3, size.data(), text.data()), 0) << cg_get_error();
  }
  void solutions_of_steps(int zone, const std::vector<std::string>& names) const {
    std::string text;
    for (const std::string& name : names) text += fmt::format("{:32}", name);
    const std::array<cgsize_t, 2> size = {32, static_cast<cgsize_t>(names.size())};
    cg_ziter_write(file_, base_, zone, "Solutions");
    cg_goto(file_, base_, "Zone_t", zone, "ZoneIterativeData_t", 1, "end");
    cg_array_write("FlowSolutionPointers", CGNS_ENUMV(Character), 2, size.data(), text.data());
  }

 private:
  int file_ = 0, base_ = 0;
};

struct CgnsSolutionsTest : FolderTest {
  [[nodiscard]] Input read(std::optional<double> time = {}, CellValues cells = CellValues::averaged) const {
    SourceOptions options;
    options.time = time;
    options.cells = cells;
    return value_of(read_input({path("a.cgns")}, options));
  }
  static std::vector<double> values(const Input& input, const std::string& attribute, std::size_t piece = 0) {
    return input.pieces.at(piece).values.at(input.index_of(attribute));
  }
};

const std::vector<double> points_up = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
const std::vector<double> points_down = {11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0};

// Of two fields with one name, the last one's keeps it.
TEST_F(CgnsSolutionsTest, SeveralAtOneLocationAreAllRead) {
  {
    const CgnsWriter file(path("a.cgns"));
    const int zone = file.zone("One");
    const int first = file.solution(zone, "Init", vertex), second = file.solution(zone, "End", vertex);
    const int of_cells = file.solution(zone, "Cells", cell_center);
    file.field(zone, first, "Density", points_down);
    file.field(zone, second, "Density", points_up);
    file.field(zone, second, "Mach", points_up);
    file.field(zone, of_cells, "Volume", {1, 2});
    // A zone with one of the solutions gives its values to the same attributes.
    const int other = file.zone("Two", 2);
    file.field(other, file.solution(other, "Init", vertex), "Density", points_up);
  }
  const Input input = read();
  EXPECT_THAT(input.attributes, UnorderedElementsAre("Density", "Density (Init)", "Mach", "Volume"));
  EXPECT_EQ(values(input, "Density"), points_up);
  EXPECT_EQ(values(input, "Density (Init)"), points_down);
  EXPECT_EQ(values(input, "Mach"), points_up);
  EXPECT_EQ(values(input, "Density (Init)", 1), points_up);
  EXPECT_THAT(values(input, "Density", 1), Each(IsNan()));
  EXPECT_THAT(input.census.losses, IsEmpty());
  EXPECT_THAT(values(read({}, CellValues::own), "Volume"), ElementsAre(1, 2));
}

// The same where VTK's reader reads the meshes.
TEST_F(CgnsSolutionsTest, SeveralAtOneLocationOfPolyhedra) {
  {
    const CgnsWriter file(path("a.cgns"));
    for (const int z : {0, 1, 2}) {
      const int zone = file.polyhedron(fmt::format("Zone{}", z), 2 * z);
      const std::vector<double> values = {1.0 * z, 2.0 * z, 3.0 * z, 4.0 * z};
      file.field(zone, file.solution(zone, "First", vertex), "p", {9, 9, 9, 9});
      file.field(zone, file.solution(zone, "Last", vertex), "p", values);
    }
  }
  const Input input = read();
  ASSERT_EQ(input.pieces.size(), 3u);
  EXPECT_NEAR(input.volume, 0.5, 1e-12);
  for (std::size_t z = 0; z < 3; ++z) {
    EXPECT_THAT(values(input, "p (First)", z), Each(9));
    EXPECT_EQ(values(input, "p", z), (std::vector<double>{1.0 * z, 2.0 * z, 3.0 * z, 4.0 * z}));
  }
}

TEST_F(CgnsSolutionsTest, ValuesOfSomePointsOrCells) {
  const auto write = [&](cgsize_t point, const std::vector<cgsize_t>& other = {3, 2, 2}) {
    const CgnsWriter file(path("a.cgns"));
    const int zone = file.zone("One");
    // Numbers of points along each axis.
    std::vector<cgsize_t> list = {point, 1, 1};
    list.insert(list.end(), other.begin(), other.end());
    file.field(zone, file.solution_at(zone, "List", vertex, CGNS_ENUMV(PointList), 2, list), "list", {5, 6});
    file.field(zone, file.solution_at(zone, "Range", vertex, CGNS_ENUMV(PointRange), 2, {2, 1, 2, 3, 2, 2}), "range",
               {1, 2, 3, 4});
    file.field(zone, file.solution_at(zone, "Cell", cell_center, CGNS_ENUMV(PointRange), 2, {2, 1, 1, 2, 1, 1}), "cell",
               {7});
  };
  write(1);
  const double none = missing_value;
  const Input input = read();
  EXPECT_THAT(values(input, "list"), ElementsAre(5, IsNan(), IsNan(), IsNan(), IsNan(), IsNan(), IsNan(), IsNan(),
                                                 IsNan(), IsNan(), IsNan(), 6));
  EXPECT_THAT(values(input, "range"),
              Pointwise(NanSensitiveDoubleEq(), {none, none, none, none, none, none, none, 1., 2., none, 3., 4.}));
  EXPECT_THAT(values(read({}, CellValues::own), "cell"), ElementsAre(IsNan(), 7));
  EXPECT_THAT(input.census.losses, IsEmpty());
  write(4);
  EXPECT_THAT(error_of({path("a.cgns")}), HasSubstr("the solution List names a point or cell that is not there"));
  write(1, {1, 1, 1});
  EXPECT_THAT(error_of({path("a.cgns")}), HasSubstr("the solution List has two values of a point or cell"));
}

TEST_F(CgnsSolutionsTest, WithoutPointersBelongToTimesByTheirOrder) {
  const auto write = [&](int solutions) {
    const CgnsWriter file(path("a.cgns"));
    file.times({0, 1});
    const int zone = file.zone("One");
    for (int s = 0; s < solutions; ++s)
      file.field(zone, file.solution(zone, fmt::format("Flow#{}", 9 + s), vertex), "T",
                 s == 0 ? points_up : points_down);
    file.field(zone, file.solution(zone, "Constant", cell_center), "c", {1, 2});
  };
  write(2);
  for (const double time : {0., 1.}) {
    const Input input = read(time);
    EXPECT_THAT(input.attributes, UnorderedElementsAre("T", "c"));
    EXPECT_EQ(values(input, "T"), time == 0 ? points_up : points_down);
    EXPECT_THAT(input.census.losses, IsEmpty());
  }
  write(3);
  EXPECT_THAT(read(0).census.losses, ElementsAre(HasSubstr("zone One: 3 solutions of points that no FlowSolution")));
}

TEST_F(CgnsSolutionsTest, StepsWithoutTimesHaveNumbers) {
  for (const bool iterations : {false, true}) {
    {
      const CgnsWriter file(path("a.cgns"));
      file.steps_without_times(iterations ? std::vector<int>{100, 250} : std::vector<int>{});
      const int zone = file.zone("One");
      file.field(zone, file.solution(zone, "Flow1", vertex), "T", points_up);
      file.field(zone, file.solution(zone, "Flow2", vertex), "T", points_down);
    }
    const Input input = read(iterations ? 240 : 0.9);
    ASSERT_TRUE(input.step.has_value());
    EXPECT_EQ(input.step->time, iterations ? 250 : 1);
    EXPECT_EQ(values(input, "T"), points_down);
  }
}

TEST_F(CgnsSolutionsTest, ThoseThatNoPointerNamesBelongToAllTimes) {
  {
    const CgnsWriter file(path("a.cgns"));
    file.times({1, 0});
    const int zone = file.zone("One");
    file.field(zone, file.solution(zone, "Late", vertex), "T", points_down);
    file.field(zone, file.solution(zone, "Early", vertex), "T", points_up);
    file.field(zone, file.solution(zone, "Mean", vertex), "m", points_up);
    file.solutions_of_steps(zone, {"Late", "Early"});
  }
  EXPECT_THAT(read(0).step->times, ElementsAre(0, 1));
  EXPECT_EQ(values(read(0), "T"), points_up);
  EXPECT_EQ(values(read(1), "T"), points_down);
  EXPECT_EQ(values(read(0), "m"), points_up);
  EXPECT_EQ(values(read(1), "m"), points_up);
}

TEST_F(CgnsSolutionsTest, ZonesBelongToTheTimesThatNameThem) {
  {
    const CgnsWriter file(path("a.cgns"));
    file.times({0, 1});
    for (const int z : {0, 1, 2}) {
      const int zone = file.zone(fmt::format("Zone{}", z), 2 * z);
      file.field(zone, file.solution(zone, "Flow", vertex), "T", points_up);
    }
    file.zones_of_steps({{"Zone0", ""}, {"Zone0", "Zone1"}});
  }
  EXPECT_EQ(read(0).pieces.size(), 2u) << "no step names the last zone: it belongs to all";
  EXPECT_EQ(read(1).pieces.size(), 3u);
}

// Planes of values beyond the zone, as solvers keep them.
TEST_F(CgnsSolutionsTest, ValuesBeyondTheZoneAreLeftOut) {
  {
    const CgnsWriter file(path("a.cgns"));
    const int zone = file.zone("One");
    const int solution = file.solution(zone, "Flow", cell_center);
    file.rind(zone, solution, {1, 1, 0, 1, 0, 0});
    file.field(zone, solution, "T", {-1, 1, 2, -1, -1, -1, -1, -1});  // 4 x 2 x 1
  }
  EXPECT_THAT(values(read({}, CellValues::own), "T"), ElementsAre(1, 2));
}

// At one time, the solution that the file names is the one that counts.
TEST_F(CgnsSolutionsTest, FieldsOfTheNamedSolutionKeepTheirNames) {
  {
    const CgnsWriter file(path("a.cgns"));
    file.times({3});
    const int zone = file.zone("One");
    file.field(zone, file.solution(zone, "Flow", vertex), "T", points_up);
    file.field(zone, file.solution(zone, "Start", vertex), "T", points_down);
    file.solutions_of_steps(zone, {"Flow"});
  }
  EXPECT_EQ(values(read(), "T"), points_up);
  EXPECT_EQ(values(read(), "T (Start)"), points_down);
}

TEST_F(CgnsSolutionsTest, ArraysThatAreNoSolutionsAreNamed) {
  {
    const CgnsWriter file(path("a.cgns"));
    const int zone = file.zone("One");
    file.field(zone, file.solution(zone, "Up", vertex), "T", points_up);
    file.discrete(zone, "residual", points_up);
    file.region(zone, "heat", points_down);
  }
  const Input input = read();
  EXPECT_THAT(input.attributes, ElementsAre("T"));
  EXPECT_THAT(input.census.losses, ElementsAre("heat: left out, no solution of points or of cells",
                                               "residual: left out, no solution of points or of cells"));
}

TEST_F(CgnsSolutionsTest, OtherCoordinatesAreRefused) {
  {
    const CgnsWriter file(path("a.cgns"));
    file.zone("Rotor", 0, {"R", "Theta", "Z"});
  }
  EXPECT_THAT(error_of({path("a.cgns")}),
              HasSubstr("the zone Rotor has the coordinates CoordinateR, CoordinateTheta, CoordinateZ, and not "
                        "CoordinateX"));
}

}  // namespace
}  // namespace splatvol::test
