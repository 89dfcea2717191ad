#include "builder/sources/vtk/piece.h"

#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkGenericCell.h>
#include <vtkHigherOrderHexahedron.h>
#include <vtkHigherOrderTetra.h>
#include <vtkHigherOrderWedge.h>
#include <vtkIdList.h>
#include <vtkIdTypeArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

static_assert(ghost::duplicate == vtkDataSetAttributes::DUPLICATECELL &&
              ghost::duplicate == vtkDataSetAttributes::DUPLICATEPOINT &&
              ghost::refined_cell == vtkDataSetAttributes::REFINEDCELL &&
              ghost::hidden_cell == vtkDataSetAttributes::HIDDENCELL &&
              ghost::hidden_point == vtkDataSetAttributes::HIDDENPOINT);

/// Returns the ghost flags of points or of cells; none if there are none. Older files give levels (vtkGhostLevels): all
/// above 0 are copies. VTK itself knows flags of one type only, and levels of old file versions.
std::vector<std::uint8_t> ghost_flags(vtkDataSetAttributes& arrays) {
  const auto array_of = [&](const char* name) {
    vtkDataArray* array = arrays.GetArray(name);
    return array && array->GetNumberOfComponents() == 1 ? array : nullptr;
  };
  vtkDataArray* types = array_of("vtkGhostType");
  vtkDataArray* levels = types ? nullptr : array_of("vtkGhostLevels");
  vtkDataArray* array = types ? types : levels;
  std::vector<std::uint8_t> flags(array ? static_cast<std::size_t>(array->GetNumberOfTuples()) : 0);
  for (std::size_t i = 0; i < flags.size(); ++i) {
    const double number = array->GetComponent(static_cast<vtkIdType>(i), 0);
    if (types) flags[i] = number >= 0 && number < 256 ? static_cast<std::uint8_t>(number) : 0;
    if (levels) flags[i] = number > 0 ? ghost::duplicate : 0;
  }
  return flags;
}

class VtkArray final : public NumberArray {
 public:
  explicit VtkArray(vtkDataArray& array) : array_(&array) {}
  [[nodiscard]] int components() const override { return array_->GetNumberOfComponents(); }
  void read(int component, std::span<const std::uint32_t> elements, std::span<double> values) const override {
    read_component(*array_, component, elements, values);
  }

 private:
  vtkSmartPointer<vtkDataArray> array_;
};

/// Stands for an array that a data set does not have.
class NoArray final : public NumberArray {
 public:
  explicit NoArray(int components) : components_(components) {}
  [[nodiscard]] int components() const override { return components_; }
  void read(int /*component*/, std::span<const std::uint32_t> /*elements*/, std::span<double> values) const override {
    std::ranges::fill(values, missing_value);
  }

 private:
  int components_;
};

class DataSetOfVtk final : public DataSet {
 public:
  DataSetOfVtk(vtkDataSet& data, CellValues cells)
      : data_(data),
        grid_(vtkUnstructuredGrid::SafeDownCast(&data)),
        own_cells_(cells == CellValues::own),
        cell_ghosts_(ghost_flags(*data.GetCellData())),
        point_ghosts_(ghost_flags(*data.GetPointData())) {}

  [[nodiscard]] std::uint64_t point_count() const override {
    return static_cast<std::uint64_t>(data_.GetNumberOfPoints());
  }
  [[nodiscard]] std::uint64_t cell_count() const override {
    return static_cast<std::uint64_t>(data_.GetNumberOfCells());
  }

  void read_points(std::span<dvec3> points) const override {
    for (std::size_t i = 0; i < points.size(); ++i) data_.GetPoint(static_cast<vtkIdType>(i), &points[i].x);
  }

  // VTK's readers do not check the offsets against the connectivity, nor the types against the number of cells.
  [[nodiscard]] Status check_cells(const std::string& name) const override {
    if (!grid_ || grid_->GetNumberOfCells() == 0) return {};
    vtkUnsignedCharArray* types = grid_->GetCellTypesArray();
    if (!grid_->GetCells()->IsValid() || !types || types->GetNumberOfValues() < grid_->GetNumberOfCells())
      return fail(ErrorCode::invalid_data, "{}: its cells' offsets, types and connectivity do not fit together", name);
    return {};
  }

  [[nodiscard]] int cell_type(std::uint64_t cell) const override {
    return data_.GetCellType(static_cast<vtkIdType>(cell));
  }

  void append_points(std::uint64_t cell, std::vector<std::int64_t>& points) const override {
    vtkIdType count = 0;
    const vtkIdType* ids = nullptr;
    if (grid_) {
      grid_->GetCells()->GetCellAtId(static_cast<vtkIdType>(cell), count, ids);
    } else {
      data_.GetCellPoints(static_cast<vtkIdType>(cell), ids_);
      count = ids_->GetNumberOfIds();
      ids = ids_->GetPointer(0);
    }
    points.insert(points.end(), ids, ids + count);
  }

  [[nodiscard]] std::int64_t face_stream_length() const override {
    return grid_ && grid_->GetFaces() && grid_->GetFaceLocations() ? grid_->GetFaces()->GetNumberOfValues() : 0;
  }
  [[nodiscard]] std::int64_t face_location(std::uint64_t cell) const override {
    const auto number = static_cast<vtkIdType>(cell);
    if (face_stream_length() == 0 || number >= grid_->GetFaceLocations()->GetNumberOfValues()) return -1;
    return grid_->GetFaceLocations()->GetValue(number);
  }
  [[nodiscard]] std::int64_t face_number(std::int64_t at) const override { return grid_->GetFaces()->GetValue(at); }

  [[nodiscard]] std::span<const std::uint8_t> cell_ghosts() const override { return cell_ghosts_; }
  [[nodiscard]] std::span<const std::uint8_t> point_ghosts() const override { return point_ghosts_; }

  // Of a structured grid.
  [[nodiscard]] bool blanks_cells() const override { return !grid_; }

  [[nodiscard]] std::optional<std::vector<FlatCells>> flat_cells() const override {
    auto* surface = vtkPolyData::SafeDownCast(&data_);
    if (!surface) return std::nullopt;
    const auto count = [](vtkIdType cells) { return static_cast<std::uint64_t>(cells); };
    return std::vector<FlatCells>{{"vertex", 0, count(surface->GetNumberOfVerts())},
                                  {"line", 1, count(surface->GetNumberOfLines())},
                                  {"polygon", 2, count(surface->GetNumberOfPolys())},
                                  {"triangle strip", 2, count(surface->GetNumberOfStrips())}};
  }

  // Also if the file gives no degrees.
  [[nodiscard]] bool has_one_degree(std::uint64_t cell) const override {
    vtkDataArray* degrees = data_.GetCellData()->GetArray("HigherOrderDegrees");
    if (!degrees) return true;
    const auto number = static_cast<vtkIdType>(cell);
    if (degrees->GetNumberOfComponents() != 3 || number >= degrees->GetNumberOfTuples()) return false;
    const double* degree = degrees->GetTuple3(number);
    return degree[0] == degree[1] && degree[1] == degree[2];
  }

  [[nodiscard]] std::vector<dvec3> parametric_points(int type, std::size_t count) const override {
    const auto cell = vtkSmartPointer<vtkCell>::Take(vtkGenericCell::InstantiateCell(type));
    const auto points_count = static_cast<vtkIdType>(count);
    cell->GetPointIds()->SetNumberOfIds(points_count);
    cell->GetPoints()->SetNumberOfPoints(points_count);
    if (auto* hexahedron = vtkHigherOrderHexahedron::SafeDownCast(cell))
      hexahedron->SetUniformOrderFromNumPoints(points_count);
    if (auto* wedge = vtkHigherOrderWedge::SafeDownCast(cell)) wedge->SetUniformOrderFromNumPoints(points_count);
    if (auto* tetrahedron = vtkHigherOrderTetra::SafeDownCast(cell)) tetrahedron->Initialize();
    const double* coordinates = cell->GetParametricCoords();
    std::vector<dvec3> points;
    for (std::size_t i = 0; coordinates && i < count; ++i, coordinates += 3)
      points.emplace_back(coordinates[0], coordinates[1], coordinates[2]);
    return points;
  }

  [[nodiscard]] Result<FoundArray> find_array(const std::string& name, std::span<const ArrayAttribute> attributes,
                                              std::size_t number) const override {
    const ArrayAttribute& attribute = attributes[number];
    SPLATVOL_TRY_ASSIGN(values, find_values(name, data_, attribute));
    // Missing values are the same of points and of cells: nothing needs to be averaged.
    if (!values.array) return FoundArray{std::make_shared<NoArray>(attribute.components), own_cells_};
    return FoundArray{std::make_shared<VtkArray>(*values.array), values.of_cells};
  }

 private:
  vtkDataSet& data_;
  vtkUnstructuredGrid* grid_;  // data_, if it is one
  bool own_cells_;
  std::vector<std::uint8_t> cell_ghosts_, point_ghosts_;
  vtkNew<vtkIdList> ids_;
};

bool is_structured(vtkDataSet& data) {
  const int type = data.GetDataObjectType();
  return type == VTK_STRUCTURED_GRID || type == VTK_RECTILINEAR_GRID || type == VTK_IMAGE_DATA ||
         type == VTK_STRUCTURED_POINTS || type == VTK_UNIFORM_GRID;
}

/// The axes of a structured grid may be left-handed: coordinates that descend, a mirror in a matrix of directions. Its
/// cells are inverted if they turn the other way than most of them.
void count_from_most(CellCensus& census) {
  if (census.inverted > census.upright) std::swap(census.inverted, census.upright);
}

}  // namespace

Result<std::unique_ptr<Piece>> make_piece(const std::string& path, vtkDataSet& data,
                                          std::span<const ArrayAttribute> attributes, CellValues cells,
                                          const MissingValues& missing, const ChangeMeans& change_means, bool lend,
                                          bool whole_cells) {
  Result<std::unique_ptr<Piece>> piece;
  SPLATVOL_TRY(run_vtk(path, [&] {
    piece = make_piece(path, DataSetOfVtk(data, cells), attributes, cells, missing, change_means, lend, whole_cells);
  }));
  if (piece && is_structured(data)) count_from_most((*piece)->census);
  return piece;
}

Result<CellAverages> make_averages(const std::string& path, vtkDataSet& data) {
  std::optional<Result<CellAverages>> averages;
  SPLATVOL_TRY(run_vtk(path, [&] { averages = make_averages(path, DataSetOfVtk(data, CellValues::averaged)); }));
  return std::move(*averages);
}

}  // namespace splatvol
