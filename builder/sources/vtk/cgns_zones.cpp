#include "builder/sources/vtk/cgns_zones.h"

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
#include <set>
#include <span>
#include <string_view>

#include "builder/sources/read_text.h"
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

  vtkSmartPointer<vtkDataSet> read(const std::vector<std::string>& selection, std::optional<std::size_t> step) const {
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
    if (!is_flat()) read_solutions(*data, selection, step);
    return data;
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

  [[nodiscard]] vtkSmartPointer<vtkPoints> read_points() const {
    std::uint64_t count = 1;
    for (const cgsize_t points : points_) {
      if (points < 1 || static_cast<std::uint64_t>(points) > std::numeric_limits<std::uint32_t>::max() / count)
        throw ReaderError("CGNS: the zone {} has no points, or more than 2^32", name());
      count *= static_cast<std::uint64_t>(points);
    }
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

  /// The names of the solutions of a step; none: those of all steps.
  [[nodiscard]] std::vector<std::string> solutions_of(std::optional<std::size_t> step) const {
    constexpr std::size_t length = 32;
    std::vector<std::string> names;
    Name ignored{};
    int arrays = 0;
    if (!step || cg_ziter_read(file_, base_, zone_, ignored.data()) != CG_OK ||
        cg_goto(file_, base_, "Zone_t", zone_, "ZoneIterativeData_t", 1, "end") != CG_OK ||
        cg_narrays(&arrays) != CG_OK)
      return names;
    for (int array = 1; array <= arrays; ++array) {
      Name name{};
      CGNS_ENUMT(DataType_t) type{};
      int dimensions = 0;
      std::array<cgsize_t, 12> size{};
      check(cg_array_info(array, name.data(), &type, &dimensions, size.data()));
      const std::string_view view = name.data();
      const bool is_grid = view.starts_with("GridCoordinates"), is_solution = view.starts_with("FlowSolution");
      if (!(is_grid || is_solution) || !view.ends_with("Pointers")) continue;
      if (type != CGNS_ENUMV(Character) || dimensions != 2 || size[0] != cgsize_t{length} ||
          size[1] <= static_cast<cgsize_t>(*step) || size[1] > (cgsize_t{1} << 30))
        throw ReaderError("CGNS: {} is damaged", view);
      std::string text(length * static_cast<std::size_t>(size[1]), ' ');
      check(cg_array_read(array, text.data()));
      const std::string_view entry = trimmed(std::string_view(text).substr(length * *step, length));
      if (is_grid && entry != "GridCoordinates")
        throw ReaderError("CGNS: a zone that moves, and whose surfaces are numbered before its cells");
      if (is_solution) names.emplace_back(entry.substr(0, entry.find('\0')));
    }
    return names;
  }

  void read_solutions(vtkDataSet& data, const std::vector<std::string>& selection,
                      std::optional<std::size_t> step) const {
    const std::vector<std::string> wanted = solutions_of(step);
    int solutions = 0;
    check(cg_nsols(file_, base_, zone_, &solutions));
    for (int solution = 1; solution <= solutions; ++solution) {
      Name name{};
      CGNS_ENUMT(GridLocation_t) location{};
      check(cg_sol_info(file_, base_, zone_, solution, name.data(), &location));
      if (!wanted.empty() && std::ranges::find(wanted, name.data()) == wanted.end()) continue;
      if (location == CGNS_ENUMV(Vertex)) read_fields(solution, points_, *data.GetPointData(), selection);
      if (location != CGNS_ENUMV(CellCenter)) continue;
      if (!is_structured() && data.GetNumberOfCells() != cells_[0])
        throw ReaderError("CGNS: the zone {} has {} cells, and values of {}", this->name(), data.GetNumberOfCells(),
                          cells_[0]);
      read_fields(solution, cells_, *data.GetCellData(), selection);
    }
  }

  /// `size`: values along each axis.
  void read_fields(int solution, const std::array<cgsize_t, 3>& size, vtkDataSetAttributes& attributes,
                   const std::vector<std::string>& selection) const {
    std::vector<std::string> names;
    int fields = 0;
    check(cg_nfields(file_, base_, zone_, solution, &fields));
    for (int field = 1; field <= fields; ++field) {
      Name name{};
      CGNS_ENUMT(DataType_t) type{};
      check(cg_field_info(file_, base_, zone_, solution, field, &type, name.data()));
      names.emplace_back(name.data());
    }
    std::ranges::sort(names);
    for (const ArrayShape& shape : merge_cgns_vectors(names)) {
      if (!wants_array(selection, shape.name) || attributes.HasArray(shape.name.c_str())) continue;
      const vtkNew<vtkDoubleArray> array;
      array->SetName(shape.name.c_str());
      array->SetNumberOfComponents(shape.components);
      array->SetNumberOfTuples(size[0] * size[1] * size[2]);
      const auto components = cgns_components(names, shape.name);
      for (int c = 0; c < shape.components; ++c)
        read_component(solution, shape.components == 1 ? shape.name : components->at(static_cast<std::size_t>(c)), size,
                       *array, c);
      attributes.AddArray(array);
    }
  }

  void read_component(int solution, const std::string& name, const std::array<cgsize_t, 3>& size, vtkDoubleArray& array,
                      int component) const {
    std::vector<double> values(static_cast<std::size_t>(array.GetNumberOfTuples()));
    const std::array<cgsize_t, 3> first = {1, 1, 1};
    check(cg_field_read(file_, base_, zone_, solution, name.c_str(), CGNS_ENUMV(RealDouble), first.data(), size.data(),
                        values.data()));
    for (std::size_t i = 0; i < values.size(); ++i) array.SetComponent(static_cast<vtkIdType>(i), component, values[i]);
  }

  int file_, base_, zone_;
  Name name_{};
  CGNS_ENUMT(ZoneType_t) type_{};
  int axes_ = 1;  // by which points are numbered
  std::array<cgsize_t, 9> size_{};
  std::array<cgsize_t, 3> points_ = {1, 1, 1}, cells_ = {1, 1, 1};  // along each axis
};

/// The times of a base's steps; empty if it has none.
std::vector<double> times_of(int file, int base) {
  Name name{};
  int steps = 0, arrays = 0;
  if (cg_biter_read(file, base, name.data(), &steps) != CG_OK ||
      cg_goto(file, base, "BaseIterativeData_t", 1, "end") != CG_OK || cg_narrays(&arrays) != CG_OK)
    return {};
  for (int array = 1; array <= arrays; ++array) {
    CGNS_ENUMT(DataType_t) type{};
    int dimensions = 0;
    std::array<cgsize_t, 12> size{};
    check(cg_array_info(array, name.data(), &type, &dimensions, size.data()));
    if (std::string_view(name.data()) != "TimeValues" || dimensions != 1 || size[0] < 1 || size[0] > (1 << 30))
      continue;
    std::vector<double> times(static_cast<std::size_t>(size[0]));
    check(cg_array_read_as(array, CGNS_ENUMV(RealDouble), times.data()));
    return times;
  }
  return {};
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
  check(cg_open(path.c_str(), CG_MODE_READ, &file_));
  int bases = 0;
  check(cg_nbases(file_, &bases));
  for (int base = 1; base <= bases; ++base) {
    int zones = 0;
    check(cg_nzones(file_, base, &zones));
    for (int zone = 1; zone <= zones; ++zone) zones_.push_back({base, zone});
    if (times_.empty()) times_ = times_of(file_, base);
  }
}

CgnsZones::~CgnsZones() { cg_close(file_); }

bool CgnsZones::defeats_vtk() const {
  float version = 0;
  check(cg_version(file_, &version));
  if (version > 2.99F && version < 3.05F) return true;  // its numbers of element types are not those of all others
  return std::ranges::any_of(zones_, [&](const Zone& of) {
    const ZoneReader zone(file_, of.base, of.zone);
    return zone.is_flat() || !zone.has_cells_first();
  });
}

void CgnsZones::read(int zone, std::optional<std::size_t> step, const std::vector<std::string>& selection,
                     vtkMultiBlockDataSet& tree) const {
  const auto [base, number] = zones_[static_cast<std::size_t>(zone)];
  Name name{};
  int cell_dimension = 0, dimension = 0;
  check(cg_base_read(file_, base, name.data(), &cell_dimension, &dimension));
  const ZoneReader reader(file_, base, number);
  const vtkNew<vtkMultiBlockDataSet> block;
  block->SetBlock(0, reader.read(selection, step));
  block->GetMetaData(0u)->Set(vtkCompositeDataSet::NAME(), reader.name());
  tree.Initialize();
  tree.SetBlock(0, block);
  tree.GetMetaData(0u)->Set(vtkCompositeDataSet::NAME(), name.data());
}

}  // namespace splatvol
