#include "builder/sources/cgns/cgns_zones.h"

#include <fmt/format.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDoubleArray.h>
#include <vtkInformation.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkSmartPointer.h>
#include <vtkStructuredGrid.h>
#include <vtkUnstructuredGrid.h>
#include <vtk_cgns.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <span>
#include <string_view>
#include <utility>

#include "builder/sources/cgns/cgns_links.h"
#include "builder/sources/read_text.h"
#include "builder/sources/time_steps.h"
#include "builder/sources/vtk/messages.h"
#include VTK_CGNS(cgnslib.h)

namespace splatvol {
namespace {

using Name = std::array<char, 64>;  // 32 at most

/// Returns the components of a vector of this name, if there are all three. Requires sorted names.
std::optional<std::array<std::string, 3>> cgns_components(const std::vector<std::string>& names,
                                                          const std::string& vector) {
  constexpr std::array<std::array<const char*, 3>, 2> all_ends = {{{"X", "Y", "Z"}, {"_x", "_y", "_z"}}};
  for (const auto& ends : all_ends) {
    std::array<std::string, 3> components;
    std::ranges::transform(ends, components.begin(), [&](const char* end) { return vector + end; });
    if (std::ranges::all_of(components, [&](const auto& name) { return std::ranges::binary_search(names, name); }))
      return components;
  }
  return std::nullopt;
}
using Type = CGNS_ENUMT(ElementType_t);

/// Fails with the library's message unless a call has succeeded.
void check(int result) {
  if (result != CG_OK) throw ReaderError("CGNS: {}", cg_get_error());
}

constexpr std::string_view own_grid = "GridCoordinates";  // of a zone; others belong to steps
constexpr cgsize_t most_entries = cgsize_t{1} << 30;      // of an array that tells of steps

/// An array of the current node.
struct NodeArray {
  int number;
  std::string name;
  CGNS_ENUMT(DataType_t) type;
  std::vector<cgsize_t> size;
};

std::vector<NodeArray> node_arrays() {
  std::vector<NodeArray> arrays;
  int count = 0;
  if (cg_narrays(&count) != CG_OK) return arrays;
  for (int number = 1; number <= count; ++number) {
    Name name{};
    CGNS_ENUMT(DataType_t) type{};
    int dimensions = 0;
    std::array<cgsize_t, 12> size{};
    check(cg_array_info(number, name.data(), &type, &dimensions, size.data()));
    arrays.push_back({number, name.data(), type, {size.begin(), size.begin() + std::clamp(dimensions, 0, 12)}});
  }
  return arrays;
}

/// Reads the names in an array of the current node, 32 characters each. Empty: it names nothing.
std::vector<std::string> read_names(const NodeArray& array) {
  constexpr cgsize_t length = 32;
  cgsize_t count = 1;
  for (std::size_t i = 1; i < array.size.size(); ++i) {
    if (array.size[i] < 1 || array.size[i] > most_entries / count) throw ReaderError("CGNS: {} is damaged", array.name);
    count *= array.size[i];
  }
  if (array.type != CGNS_ENUMV(Character) || array.size.size() < 2 || array.size[0] != length)
    throw ReaderError("CGNS: {} is damaged", array.name);
  std::string text(static_cast<std::size_t>(length * count), ' ');
  check(cg_array_read(array.number, text.data()));
  std::vector<std::string> names;
  for (std::size_t at = 0; at < text.size(); at += static_cast<std::size_t>(length)) {
    const std::string_view entry = std::string_view(text).substr(at, static_cast<std::size_t>(length));
    const std::string_view name = trimmed(entry.substr(0, entry.find('\0')));
    names.emplace_back(name == "Null" ? std::string_view() : name);
  }
  return names;
}

/// A name without the number at its end.
std::string_view stem_of(std::string_view name) { return name.substr(0, name.find_last_not_of("0123456789") + 1); }

/// A type of elements: its type in VTK, its dimension, and where VTK's points stand among those of CGNS. Empty: in the
/// same order.
struct ElementKind {
  Type type;
  int vtk_type;
  int dimension;
  std::vector<std::size_t> order = {};
};

const std::vector<ElementKind>& element_kinds() {
  static const std::vector<ElementKind> kinds = {
      {CGNS_ENUMV(NODE), VTK_VERTEX, 0},
      {CGNS_ENUMV(BAR_2), VTK_LINE, 1},
      {CGNS_ENUMV(BAR_3), VTK_QUADRATIC_EDGE, 1},
      {CGNS_ENUMV(TRI_3), VTK_TRIANGLE, 2},
      {CGNS_ENUMV(TRI_6), VTK_QUADRATIC_TRIANGLE, 2},
      {CGNS_ENUMV(QUAD_4), VTK_QUAD, 2},
      {CGNS_ENUMV(QUAD_8), VTK_QUADRATIC_QUAD, 2},
      {CGNS_ENUMV(QUAD_9), VTK_BIQUADRATIC_QUAD, 2},
      {CGNS_ENUMV(TETRA_4), VTK_TETRA, 3},
      {CGNS_ENUMV(TETRA_10), VTK_QUADRATIC_TETRA, 3},
      {CGNS_ENUMV(PYRA_5), VTK_PYRAMID, 3},
      {CGNS_ENUMV(PYRA_13), VTK_QUADRATIC_PYRAMID, 3},
      {CGNS_ENUMV(PENTA_6), VTK_WEDGE, 3},
      {CGNS_ENUMV(PENTA_15), VTK_QUADRATIC_WEDGE, 3, {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 14, 9, 10, 11}},
      {CGNS_ENUMV(PENTA_18),
       VTK_BIQUADRATIC_QUADRATIC_WEDGE,
       3,
       {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 14, 9, 10, 11, 15, 16, 17}},
      {CGNS_ENUMV(HEXA_8), VTK_HEXAHEDRON, 3},
      {CGNS_ENUMV(HEXA_20), VTK_QUADRATIC_HEXAHEDRON, 3, {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,
                                                          10, 11, 16, 17, 18, 19, 12, 13, 14, 15}},
      {CGNS_ENUMV(HEXA_27), VTK_TRIQUADRATIC_HEXAHEDRON, 3, {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 16, 17,
                                                             18, 19, 12, 13, 14, 15, 24, 22, 21, 23, 20, 25, 26}}};
  return kinds;
}

const ElementKind& kind_of(Type type) {
  const auto found = std::ranges::find(element_kinds(), type, &ElementKind::type);
  if (found == element_kinds().end())
    throw ReaderError("elements of CGNS's type {} cannot be read beside others",
                      type > 0 && type < NofValidElementTypes ? cg_ElementTypeName(type) : "unknown");
  return *found;
}

/// Whether VTK's reader takes a section for cells: polygons, whatever their numbers are, and all but surfaces.
bool may_hold_cells(Type type) {
  const auto found = std::ranges::find(element_kinds(), type, &ElementKind::type);
  return found == element_kinds().end() || found->dimension == 3;
}

struct Section {
  int number;
  Type type;
  cgsize_t first, last;  // elements
};

/// A zone of an open file, by the numbers of the library.
class ZoneReader {
 public:
  ZoneReader(int file, int base, int zone) : file_(file), base_(base), zone_(zone) {
    check(cg_zone_read(file, base, zone, name_.data(), size_.data()));
    check(cg_zone_type(file, base, zone, &type_));
    if (type_ == CGNS_ENUMV(Structured)) check(cg_index_dim(file, base, zone, &axes_));
    if (axes_ < 1 || axes_ > 3) throw ReaderError("CGNS: a zone of {} dimensions", axes_);
    for (std::size_t axis = 0; axis < static_cast<std::size_t>(axes_); ++axis) {
      points_[axis] = size_[axis];
      cells_[axis] = size_[axis + static_cast<std::size_t>(axes_)];
      if (is_structured() && cells_[axis] != points_[axis] - 1)
        throw ReaderError("CGNS: the size of {} is damaged", name());
    }
  }

  [[nodiscard]] const char* name() const { return name_.data(); }
  [[nodiscard]] bool is_structured() const { return type_ == CGNS_ENUMV(Structured); }
  [[nodiscard]] bool is_flat() const { return is_structured() && *std::ranges::min_element(points_) < 2; }

  /// Whether the cells have the numbers from 1 on, and all other elements higher ones.
  [[nodiscard]] bool has_cells_first() const {
    cgsize_t next = 1;
    bool has_cells = false, has_polygons = false;
    const std::vector<Section> all = sections();
    for (const Section& section : all) {
      has_polygons = has_polygons || section.type == CGNS_ENUMV(NGON_n) || section.type == CGNS_ENUMV(NFACE_n);
      if (!may_hold_cells(section.type)) continue;
      has_cells = true;
      if (section.first != next) return has_polygons;
      next = section.last + 1;
    }
    return has_polygons || !has_cells || next == cells_[0] + 1;
  }

  vtkSmartPointer<vtkDataSet> read(std::optional<std::size_t> step) const {
    if (!is_structured() && type_ != CGNS_ENUMV(Unstructured)) throw ReaderError("CGNS: a zone of no known type");
    vtkSmartPointer<vtkDataSet> data;
    if (is_structured()) {
      const auto grid = vtkSmartPointer<vtkStructuredGrid>::New();
      grid->SetDimensions(static_cast<int>(points_[0]), static_cast<int>(points_[1]), static_cast<int>(points_[2]));
      grid->SetPoints(read_points());
      data = grid;
    } else {
      data = read_elements();
    }
    if (step && moves()) throw ReaderError("CGNS: a zone that moves, and whose surfaces are numbered before its cells");
    return data;
  }

  /// Whether read() knows all elements, as far as their sections tell.
  [[nodiscard]] bool has_known_elements() const {
    const std::vector<Section> all = sections();
    return std::ranges::all_of(all, [](const Section& section) {
      return std::ranges::find(element_kinds(), section.type, &ElementKind::type) != element_kinds().end();
    });
  }

  /// Whether the points are not the same in all steps.
  [[nodiscard]] bool moves() const {
    const auto grids = pointers("GridCoordinates");
    return std::ranges::any_of(grids, [](const std::vector<std::string>& of_steps) {
      return std::ranges::any_of(of_steps, [](const std::string& grid) { return !grid.empty() && grid != own_grid; });
    });
  }

  /// Fails unless the zone has cartesian coordinates.
  void check_coordinates() const {
    int count = 0;
    check(cg_ncoords(file_, base_, zone_, &count));
    std::string names;
    for (int number = 1; number <= count; ++number) {
      Name name{};
      CGNS_ENUMT(DataType_t) type{};
      check(cg_coord_info(file_, base_, zone_, number, &type, name.data()));
      if (std::string_view(name.data()) == "CoordinateX") return;
      names += fmt::format("{}{}", names.empty() ? "" : ", ", name.data());
    }
    if (count == 0) return;
    throw ReaderError(
        "CGNS: the zone {} has the coordinates {}, and not CoordinateX, CoordinateY and CoordinateZ, which are read: "
        "write these, and vectors by their components along x, y and z",
        name(), names);
  }

  /// The solutions with values of points or of cells that belong to a step, the one with number `step` of `steps`. With
  /// several steps, the file names those of each by pointers. Solutions without a pointer belong to the steps by their
  /// order, if there are as many at their location; else to all steps. Names what is not as it should be in `losses`.
  [[nodiscard]] std::vector<CgnsSolution> solutions_at(std::optional<std::size_t> step, std::size_t steps,
                                                       std::set<std::string>& losses) const {
    std::vector<CgnsSolution> all = solutions();
    if (!step) return all;
    std::set<std::string> named, wanted;
    for (const std::vector<std::string>& of_steps : pointers("FlowSolution")) {
      if (of_steps.size() < steps) throw ReaderError("CGNS: the FlowSolutionPointers of {} are damaged", this->name());
      named.insert(of_steps.begin(), of_steps.end());
      if (!of_steps[*step].empty()) wanted.insert(of_steps[*step]);
    }
    for (const std::string& name : wanted)
      if (std::ranges::find(all, name, &CgnsSolution::name) == all.end() && !is_hidden(name))
        losses.insert(fmt::format("zone {}: the solution {} of this time is not there", this->name(), name));
    for (const bool of_cells : {false, true}) {
      std::vector<CgnsSolution> free;
      for (const CgnsSolution& solution : all)
        if (solution.of_cells == of_cells && !named.contains(solution.name)) free.push_back(solution);
      if (steps > 1 && free.size() == steps) {
        sort_by_number(free);
        const CgnsSolution& of_step = free[*step];
        std::erase_if(all, [&](const CgnsSolution& solution) {
          return solution.number != of_step.number &&
                 std::ranges::find(free, solution.number, &CgnsSolution::number) != free.end();
        });
        std::ranges::find(all, of_step.number, &CgnsSolution::number)->label = stem_of(of_step.name);
      } else if (steps > 1 && free.size() > 1) {
        losses.insert(fmt::format(
            "zone {}: {} solutions of {} that no FlowSolutionPointers name, for {} time steps: taken at each of them",
            this->name(), free.size(), of_cells ? "cells" : "points", steps));
      }
    }
    std::erase_if(all, [&](const CgnsSolution& solution) {
      return named.contains(solution.name) && !wanted.contains(solution.name);
    });
    // Those that the file names come last: their fields keep their names.
    std::ranges::stable_partition(all, [&](const CgnsSolution& solution) { return !wanted.contains(solution.name); });
    for (CgnsSolution& solution : all)
      if (steps > 1 && wanted.contains(solution.name)) solution.label = stem_of(solution.name);
    return all;
  }

  /// The names of a solution's arrays of numbers, sorted.
  [[nodiscard]] std::vector<std::string> fields_of(int solution) const {
    std::vector<std::string> names;
    int fields = 0;
    check(cg_nfields(file_, base_, zone_, solution, &fields));
    for (int field = 1; field <= fields; ++field) {
      Name name{};
      CGNS_ENUMT(DataType_t) type{};
      check(cg_field_info(file_, base_, zone_, solution, field, &type, name.data()));
      if (type != CGNS_ENUMV(Character)) names.emplace_back(name.data());
    }
    std::ranges::sort(names);
    return names;
  }

  /// Reads an array for all points or cells of the zone.
  [[nodiscard]] vtkSmartPointer<vtkDataArray> read_array(const CgnsArray& array) const {
    const std::array<cgsize_t, 3>& size = array.solution.of_cells ? cells_ : points_;
    const auto values = vtkSmartPointer<vtkDoubleArray>::New();
    values->SetName(array.shape.name.c_str());
    values->SetNumberOfComponents(array.shape.components);
    const std::uint64_t count = count_of(size);
    const std::optional<std::vector<vtkIdType>> places = places_of(array.solution);
    std::vector<std::string> fields = {array.field};
    if (array.shape.components > 1) {
      const auto components = cgns_components(fields_of(array.solution.number), array.field);
      fields.assign(components->begin(), components->end());
    }
    check_sizes(array.solution, fields, places ? places->size() : count);
    values->SetNumberOfTuples(static_cast<vtkIdType>(count));
    if (places) values->Fill(missing_value);
    for (std::size_t c = 0; c < fields.size(); ++c)
      read_component(array.solution.number, fields[c], size, places, *values, static_cast<int>(c));
    return values;
  }

 private:
  /// The sections, sorted by the numbers of their elements.
  [[nodiscard]] std::vector<Section> sections() const {
    std::vector<Section> all;
    int count = 0;
    if (!is_structured()) check(cg_nsections(file_, base_, zone_, &count));
    for (int number = 1; number <= count; ++number) {
      Name name{};
      Section section{.number = number, .type = {}, .first = 0, .last = 0};
      int border = 0, has_parents = 0;
      check(cg_section_read(file_, base_, zone_, number, name.data(), &section.type, &section.first, &section.last,
                            &border, &has_parents));
      if (section.first < 1 || section.last < section.first || section.last == std::numeric_limits<cgsize_t>::max())
        throw ReaderError("CGNS: the range of the section {} is damaged", name.data());
      all.push_back(section);
    }
    std::ranges::sort(all, {}, &Section::first);
    return all;
  }

  /// The points or cells of the zone.
  [[nodiscard]] std::uint64_t count_of(const std::array<cgsize_t, 3>& size) const {
    std::uint64_t count = 1;
    for (const cgsize_t along : size) {
      if (along < 1 || static_cast<std::uint64_t>(along) > std::numeric_limits<std::uint32_t>::max() / count)
        throw ReaderError("CGNS: the zone {} has no points or cells, or more than 2^32", name());
      count *= static_cast<std::uint64_t>(along);
    }
    return count;
  }

  [[nodiscard]] vtkSmartPointer<vtkPoints> read_points() const {
    const std::uint64_t count = count_of(points_);
    auto points = vtkSmartPointer<vtkPoints>::New();
    points->SetDataTypeToDouble();
    points->SetNumberOfPoints(static_cast<vtkIdType>(count));
    std::vector<double> values(count);
    const std::array<cgsize_t, 3> first = {1, 1, 1};
    constexpr std::array<const char*, 3> axes = {"CoordinateX", "CoordinateY", "CoordinateZ"};
    for (std::size_t axis = 0; axis < axes.size(); ++axis) {
      check(cg_coord_read(file_, base_, zone_, axes[axis], CGNS_ENUMV(RealDouble), first.data(), points_.data(),
                          values.data()));
      for (std::size_t i = 0; i < count; ++i)
        points->GetData()->SetComponent(static_cast<vtkIdType>(i), static_cast<int>(axis), values[i]);
    }
    return points;
  }

  [[nodiscard]] vtkSmartPointer<vtkUnstructuredGrid> read_elements() const {
    const auto volumes = vtkSmartPointer<vtkUnstructuredGrid>::New(),
               others = vtkSmartPointer<vtkUnstructuredGrid>::New();
    const vtkSmartPointer<vtkPoints> points = read_points();
    for (const Section& section : sections()) read_section(section, points->GetNumberOfPoints(), *volumes, *others);
    const auto& grid = volumes->GetNumberOfCells() > 0 ? volumes : others;
    grid->SetPoints(points);
    return grid;
  }

  void read_section(const Section& section, vtkIdType points, vtkUnstructuredGrid& volumes,
                    vtkUnstructuredGrid& others) const {
    cgsize_t size = 0;
    check(cg_ElementDataSize(file_, base_, zone_, section.number, &size));
    if (section.last - section.first >= size) throw ReaderError("CGNS: the range of a section is damaged");
    const bool is_mixed = section.type == CGNS_ENUMV(MIXED);
    std::vector<cgsize_t> numbers(static_cast<std::size_t>(size));
    std::vector<cgsize_t> offsets(is_mixed ? static_cast<std::size_t>(section.last - section.first) + 2 : 0);
    check(is_mixed ? cg_poly_elements_read(file_, base_, zone_, section.number, numbers.data(), offsets.data(), nullptr)
                   : cg_elements_read(file_, base_, zone_, section.number, numbers.data(), nullptr));
    std::span<const cgsize_t> rest = numbers;
    for (cgsize_t element = section.first; element <= section.last; ++element) {
      Type type = section.type;
      if (is_mixed && !rest.empty()) {
        type = static_cast<Type>(rest.front());
        rest = rest.subspan(1);
      }
      const ElementKind& kind = kind_of(type);
      int count = 0;
      if (cg_npe(type, &count) != CG_OK || count < 1 || static_cast<std::size_t>(count) > rest.size())
        throw ReaderError("CGNS: the section of element {} is too short", element);
      insert(kind, rest.first(static_cast<std::size_t>(count)), points, kind.dimension == 3 ? volumes : others);
      rest = rest.subspan(static_cast<std::size_t>(count));
    }
  }

  static void insert(const ElementKind& kind, std::span<const cgsize_t> numbers, vtkIdType points,
                     vtkUnstructuredGrid& grid) {
    std::array<vtkIdType, 27> cell{};
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      const cgsize_t point = numbers[kind.order.empty() ? i : kind.order[i]];
      if (point < 1 || point > points) throw ReaderError("CGNS: an element names point {} of {}", point, points);
      cell[i] = static_cast<vtkIdType>(point - 1);
    }
    grid.InsertNextCell(kind.vtk_type, static_cast<vtkIdType>(numbers.size()), cell.data());
  }

  /// Fails if a field has fewer than `count` values. It may have more: those beyond the zone.
  void check_sizes(const CgnsSolution& solution, const std::vector<std::string>& fields, std::uint64_t count) const {
    check(cg_goto(file_, base_, "Zone_t", zone_, "FlowSolution_t", solution.number, "end"));
    for (const NodeArray& array : node_arrays()) {
      double values = 1;
      for (const cgsize_t along : array.size) values *= static_cast<double>(along);
      if (std::ranges::find(fields, array.name) != fields.end() && values < static_cast<double>(count))
        throw ReaderError("CGNS: {} of the zone {} has {} values instead of {}", array.name, name(), values, count);
    }
  }

  /// All solutions with values of points or of cells.
  [[nodiscard]] std::vector<CgnsSolution> solutions() const {
    std::vector<CgnsSolution> all;
    int count = 0;
    check(cg_nsols(file_, base_, zone_, &count));
    for (int number = 1; number <= count; ++number) {
      Name name{};
      CGNS_ENUMT(GridLocation_t) location{};
      check(cg_sol_info(file_, base_, zone_, number, name.data(), &location));
      if (location == CGNS_ENUMV(Vertex) || location == CGNS_ENUMV(CellCenter))
        all.push_back({number, name.data(), location == CGNS_ENUMV(CellCenter), name.data()});
    }
    return all;
  }

  /// Whether there is a solution of this name that belongs to neither points nor cells.
  [[nodiscard]] bool is_hidden(const std::string& solution) const {
    int count = 0;
    check(cg_nsols(file_, base_, zone_, &count));
    for (int number = 1; number <= count; ++number) {
      Name name{};
      CGNS_ENUMT(GridLocation_t) location{};
      check(cg_sol_info(file_, base_, zone_, number, name.data(), &location));
      if (solution == name.data()) return true;
    }
    return !hidden_cgns_arrays().empty();
  }

  /// Sorts solutions whose names differ by the numbers at their ends only: files may not keep the order in which they
  /// were written.
  static void sort_by_number(std::vector<CgnsSolution>& solutions) {
    const auto number = [](const CgnsSolution& solution) {
      return number_of<std::uint64_t>(std::string_view(solution.name).substr(stem_of(solution.name).size()));
    };
    const std::string_view stem = stem_of(solutions.front().name);
    if (std::ranges::all_of(solutions, [&](const CgnsSolution& s) { return stem_of(s.name) == stem && number(s); }))
      std::ranges::stable_sort(solutions, {}, [&](const CgnsSolution& solution) { return *number(solution); });
  }

  /// Returns the arrays of pointers of a kind, "GridCoordinates" or "FlowSolution": a name for each step, or an empty
  /// one.
  [[nodiscard]] std::vector<std::vector<std::string>> pointers(std::string_view kind) const {
    std::vector<std::vector<std::string>> names;
    Name ignored{};
    if (cg_ziter_read(file_, base_, zone_, ignored.data()) != CG_OK ||
        cg_goto(file_, base_, "Zone_t", zone_, "ZoneIterativeData_t", 1, "end") != CG_OK)
      return names;
    for (const NodeArray& array : node_arrays())
      if (array.name.starts_with(kind) && array.name.ends_with("Pointers")) names.push_back(read_names(array));
    return names;
  }

  /// The points or cells that a solution has values of; none: all.
  [[nodiscard]] std::optional<std::vector<vtkIdType>> places_of(const CgnsSolution& solution) const {
    CGNS_ENUMT(PointSetType_t) type{};
    cgsize_t count = 0;
    if (cg_sol_ptset_info(file_, base_, zone_, solution.number, &type, &count) != CG_OK ||
        type == CGNS_ENUMV(PointSetTypeNull))
      return std::nullopt;
    const std::array<cgsize_t, 3>& size = solution.of_cells ? cells_ : points_;
    const auto most = static_cast<cgsize_t>(count_of(size));
    const bool is_range = type == CGNS_ENUMV(PointRange);
    if ((!is_range && type != CGNS_ENUMV(PointList)) || count < 1 || count > most || (is_range && count != 2))
      throw ReaderError("CGNS: the PointList or PointRange of the solution {} is damaged", solution.name);
    if (solution.of_cells && !is_structured() && !has_cells_first())
      throw ReaderError("CGNS: the solution {} has values of some cells, and surfaces are numbered before these",
                        solution.name);
    std::vector<cgsize_t> numbers(static_cast<std::size_t>(count * axes_));
    check(cg_sol_ptset_read(file_, base_, zone_, solution.number, numbers.data()));
    std::vector<std::array<cgsize_t, 3>> indices;
    for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
      std::array<cgsize_t, 3> index = {1, 1, 1};
      for (std::size_t axis = 0; axis < static_cast<std::size_t>(axes_); ++axis) {
        index[axis] = numbers[i * static_cast<std::size_t>(axes_) + axis];
        if (index[axis] < 1 || index[axis] > size[axis])
          throw ReaderError("CGNS: the solution {} names a point or cell that is not there", solution.name);
      }
      indices.push_back(index);
    }
    std::vector<vtkIdType> places;
    const auto add = [&](cgsize_t i, cgsize_t j, cgsize_t k) {
      places.push_back(static_cast<vtkIdType>(i - 1 + size[0] * (j - 1 + size[1] * (k - 1))));
    };
    for (std::size_t axis = 0; is_range && axis < 3; ++axis)
      if (indices[0][axis] > indices[1][axis])
        throw ReaderError("CGNS: the PointRange of the solution {} ends before it begins", solution.name);
    if (!is_range) {
      for (const auto& [i, j, k] : indices) add(i, j, k);
      std::vector<vtkIdType> sorted = places;
      std::ranges::sort(sorted);
      if (std::ranges::adjacent_find(sorted) != sorted.end())
        throw ReaderError("CGNS: the solution {} has two values of a point or cell", solution.name);
      return places;
    }
    for (cgsize_t k = indices[0][2]; k <= indices[1][2]; ++k)
      for (cgsize_t j = indices[0][1]; j <= indices[1][1]; ++j)
        for (cgsize_t i = indices[0][0]; i <= indices[1][0]; ++i) add(i, j, k);
    return places;
  }

  /// `size`: values along each axis, unless there are `places`.
  void read_component(int solution, const std::string& field, const std::array<cgsize_t, 3>& size,
                      const std::optional<std::vector<vtkIdType>>& places, vtkDoubleArray& array, int component) const {
    std::vector<double> values(places ? places->size() : static_cast<std::size_t>(array.GetNumberOfTuples()));
    const std::array<cgsize_t, 3> first = {1, 1, 1};
    const std::array<cgsize_t, 3> last =
        places ? std::array<cgsize_t, 3>{static_cast<cgsize_t>(values.size()), 1, 1} : size;
    check(cg_field_read(file_, base_, zone_, solution, field.c_str(), CGNS_ENUMV(RealDouble), first.data(), last.data(),
                        values.data()));
    const auto components = static_cast<std::size_t>(array.GetNumberOfComponents());
    double* out = array.GetPointer(0) + component;
    for (std::size_t i = 0; i < values.size(); ++i)
      out[(places ? static_cast<std::size_t>((*places)[i]) : i) * components] = values[i];
  }

  int file_, base_, zone_;
  Name name_{};
  CGNS_ENUMT(ZoneType_t) type_{};
  int axes_ = 1;  // by which points are numbered
  std::array<cgsize_t, 9> size_{};
  std::array<cgsize_t, 3> points_ = {1, 1, 1}, cells_ = {1, 1, 1};  // along each axis
};

/// Goes to what a base states of its steps. Returns their number; 0 if there is no such node.
int go_to_steps(int file, int base) {
  Name name{};
  int steps = 0;
  const bool told = cg_biter_read(file, base, name.data(), &steps) == CG_OK &&
                    cg_goto(file, base, "BaseIterativeData_t", 1, "end") == CG_OK;
  return told ? steps : 0;
}

/// The times of a base's steps, or the numbers that it has instead; empty if it has no steps.
std::vector<double> times_of(int file, int base) {
  constexpr int most_steps = 1 << 20;  // if only their number is told
  const int steps = go_to_steps(file, base);
  if (steps < 1) return {};
  const std::vector<NodeArray> arrays = node_arrays();
  for (const char* name : {"TimeValues", "IterationValues"}) {
    const auto array = std::ranges::find(arrays, name, &NodeArray::name);
    if (array == arrays.end() || array->size.size() != 1 || array->size[0] < 1 || array->size[0] > most_entries)
      continue;
    std::vector<double> times(static_cast<std::size_t>(array->size[0]));
    check(cg_array_read_as(array->number, CGNS_ENUMV(RealDouble), times.data()));
    return times;
  }
  if (steps > most_steps) throw ReaderError("CGNS: {} steps without times: damaged", steps);
  std::vector<double> numbers(static_cast<std::size_t>(steps));
  std::iota(numbers.begin(), numbers.end(), 0.0);
  return numbers;
}

/// The zones that a base names for each of its steps; empty if it names none: then all zones belong to all steps.
std::vector<std::set<std::string>> zones_of_steps(int file, int base) {
  std::vector<std::set<std::string>> zones;
  if (go_to_steps(file, base) < 1) return zones;
  for (const NodeArray& array : node_arrays()) {
    if (array.name != "ZonePointers" || array.size.size() != 3) continue;
    const std::vector<std::string> names = read_names(array);
    const auto of_step = static_cast<std::size_t>(array.size[1]);
    zones.resize(names.size() / of_step);
    for (std::size_t i = 0; i < names.size(); ++i)
      if (!names[i].empty()) zones[i / of_step].insert(names[i]);
  }
  return zones;
}

}  // namespace

std::vector<ArrayShape> merge_cgns_vectors(const std::vector<std::string>& names) {
  std::vector<ArrayShape> shapes;
  std::set<std::string> merged;
  for (const std::string& name : names) {
    if (merged.contains(name)) continue;
    const std::string stem = name.substr(0, name.size() - (name.ends_with("_x") ? 2 : 1));
    const auto components = cgns_components(names, stem);
    const bool vector = components && components->front() == name && !std::ranges::binary_search(names, stem);
    shapes.push_back(vector ? ArrayShape{stem, 3} : ArrayShape{name, 1});
    if (vector) merged.insert(components->begin(), components->end());
  }
  return shapes;
}

CgnsZones::CgnsZones(const std::string& path) : path_(path) {
  int bases = 0;
  check(cg_nbases(file(), &bases));
  for (int base = 1; base <= bases; ++base) {
    int zones = 0;
    check(cg_nzones(file(), base, &zones));
    const std::vector<double> times = times_of(file(), base);
    const auto zones_of_each = zones_of_steps(file(), base);
    for (int zone = 1; zone <= zones; ++zone) {
      const ZoneReader reader(file(), base, zone);
      reader.check_coordinates();
      zones_.push_back({.base = base, .zone = zone, .name = reader.name(), .times = times, .not_at = {}});
      const bool is_named =
          std::ranges::any_of(zones_of_each, [&](const auto& names) { return names.contains(reader.name()); });
      for (std::size_t step = 0; is_named && step < zones_of_each.size(); ++step)
        if (!zones_of_each[step].contains(reader.name())) zones_.back().not_at.insert(step);
    }
    times_.insert(times_.end(), times.begin(), times.end());
  }
  std::ranges::sort(times_);
  times_.erase(std::ranges::unique(times_).begin(), times_.end());
}

int CgnsZones::file() {
  if (open_ != this) {
    close_file();
    check(cg_open(path_.c_str(), CG_MODE_READ, &file_));
    open_ = this;
  }
  return file_;
}

void CgnsZones::close_file() {
  if (open_) cg_close(open_->file_);
  open_ = nullptr;
}

CgnsZones::~CgnsZones() {
  if (open_ == this) close_file();
}

bool CgnsZones::reads_meshes() {
  float version = 0;
  check(cg_version(file(), &version));
  if (version > 2.99F && version < 3.05F) return true;  // its numbers of element types are not those of all others
  const auto defeats_vtk = [&](const Zone& of) {
    const ZoneReader zone(file(), of.base, of.zone);
    return zone.is_flat() || !zone.has_cells_first();
  };
  const auto is_known = [&](const Zone& of) {
    const ZoneReader zone(file(), of.base, of.zone);
    return zone.has_known_elements() && !zone.moves();
  };
  return std::ranges::any_of(zones_, defeats_vtk) || std::ranges::all_of(zones_, is_known);
}

std::optional<std::size_t> CgnsZones::step_of(const Zone& zone, std::optional<double> time) {
  const auto step = choose_step(zone.times, time);
  return step ? std::optional(step->index) : std::nullopt;
}

bool CgnsZones::is_there(int zone, std::optional<double> time) const {
  const Zone& of = zones_[static_cast<std::size_t>(zone)];
  const auto step = step_of(of, time);
  return !step || !of.not_at.contains(*step);
}

void CgnsZones::find_arrays(std::optional<double> time) {
  if (has_arrays_ && time == arrays_at_) return;
  has_arrays_ = true;
  arrays_at_ = time;
  losses_.clear();
  using Key = std::pair<bool, std::string>;  // of cells, field
  std::map<Key, std::string> owners;         // of names that several solutions of a zone have: the last in the file
  for (Zone& zone : zones_) {
    zone.arrays.clear();
    const ZoneReader reader(file(), zone.base, zone.zone);
    if (reader.is_flat()) continue;
    std::map<Key, std::size_t> counts;
    for (const CgnsSolution& solution : reader.solutions_at(step_of(zone, time), zone.times.size(), losses_)) {
      for (ArrayShape& shape : merge_cgns_vectors(reader.fields_of(solution.number))) {
        shape.of_cells = solution.of_cells;
        const std::string field = shape.name;
        if (++counts[{solution.of_cells, field}] > 1) owners[{solution.of_cells, field}] = solution.label;
        zone.arrays.push_back({solution, field, std::move(shape)});
      }
    }
  }
  for (Zone& zone : zones_)
    for (CgnsArray& array : zone.arrays)
      if (const auto owner = owners.find({array.solution.of_cells, array.field});
          owner != owners.end() && owner->second != array.solution.label)
        array.shape.name = fmt::format("{} ({})", array.field, array.solution.label);
}

std::vector<ArrayShape> CgnsZones::arrays(std::optional<double> time) {
  find_arrays(time);
  std::vector<ArrayShape> all;
  std::set<std::string> in_both;  // of a zone
  for (const Zone& zone : zones_)
    for (const CgnsArray& array : zone.arrays) {
      const ArrayShape& shape = array.shape;
      const auto is_twin = [&](const CgnsArray& other) {
        return other.shape.name == shape.name && other.shape.of_cells != shape.of_cells;
      };
      if (std::ranges::any_of(zone.arrays, is_twin)) in_both.insert(shape.name);
    }
  for (const Zone& zone : zones_)
    for (const CgnsArray& array : zone.arrays) {
      const bool is_apart = in_both.contains(array.shape.name);
      const auto known = std::ranges::find_if(all, [&](const ArrayShape& shape) {
        return shape.name == array.shape.name && (!is_apart || shape.of_cells == array.shape.of_cells);
      });
      if (known == all.end())
        all.push_back(array.shape);
      else if (known->of_cells != array.shape.of_cells)
        known->of_cells.reset();
    }
  return all;
}

std::vector<ArrayShape> CgnsZones::arrays_of(int zone) const {
  std::vector<ArrayShape> shapes;
  for (const CgnsArray& array : zones_[static_cast<std::size_t>(zone)].arrays) shapes.push_back(array.shape);
  return shapes;
}

CgnsValues CgnsZones::read_arrays(int zone, std::optional<double> time, const std::vector<std::string>& selection) {
  find_arrays(time);
  CgnsValues values;
  const Zone& of = zones_[static_cast<std::size_t>(zone)];
  const ZoneReader reader(file(), of.base, of.zone);
  for (const CgnsArray& array : of.arrays)
    if (wants_array(selection, array.shape.name))
      values.emplace_back(array.solution.of_cells, reader.read_array(array));
  return values;
}

void CgnsZones::read(int zone, std::optional<double> time, vtkMultiBlockDataSet& tree) {
  const Zone& of = zones_[static_cast<std::size_t>(zone)];
  Name name{};
  int cell_dimension = 0, dimension = 0;
  check(cg_base_read(file(), of.base, name.data(), &cell_dimension, &dimension));
  const ZoneReader reader(file(), of.base, of.zone);
  const vtkNew<vtkMultiBlockDataSet> block;
  block->SetBlock(0, reader.read(step_of(of, time)));
  block->GetMetaData(0u)->Set(vtkCompositeDataSet::NAME(), reader.name());
  tree.Initialize();
  tree.SetBlock(0, block);
  tree.GetMetaData(0u)->Set(vtkCompositeDataSet::NAME(), name.data());
}

}  // namespace splatvol
