#include "builder/sources/vtk/data_set.h"

#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkDoubleArray.h>
#include <vtkFieldData.h>
#include <vtkGenericCell.h>
#include <vtkHigherOrderHexahedron.h>
#include <vtkHigherOrderTetra.h>
#include <vtkHigherOrderWedge.h>
#include <vtkIdList.h>
#include <vtkIdTypeArray.h>
#include <vtkInformation.h>
#include <vtkInformationStringKey.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <vtkSetGet.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "base/printable.h"
#include "builder/sources/data_sets.h"
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
  [[nodiscard]] std::uint64_t size() const override { return static_cast<std::uint64_t>(array_->GetNumberOfTuples()); }
  void read(int component, std::span<const std::uint32_t> elements, std::span<double> values) const override {
    const auto read = [&](const auto* data) {
      const auto stride = static_cast<std::size_t>(components());
      data += component;
      for (std::size_t i = 0; i < elements.size(); ++i) values[i] = static_cast<double>(data[elements[i] * stride]);
    };
    if (array_->HasStandardMemoryLayout()) {
      const void* data = array_->GetVoidPointer(0);
      switch (array_->GetDataType()) { vtkTemplateMacro(return read(static_cast<const VTK_TT*>(data))); }
    }
    for (std::size_t i = 0; i < elements.size(); ++i) values[i] = array_->GetComponent(elements[i], component);
  }

 private:
  vtkSmartPointer<vtkDataArray> array_;
};

class DataSetOfVtk final : public DataSet {
 public:
  explicit DataSetOfVtk(vtkDataSet& data)
      : data_(&data),
        grid_(vtkUnstructuredGrid::SafeDownCast(&data)),
        cell_ghosts_(ghost_flags(*data.GetCellData())),
        point_ghosts_(ghost_flags(*data.GetPointData())) {}

  [[nodiscard]] std::uint64_t point_count() const override {
    return static_cast<std::uint64_t>(data_->GetNumberOfPoints());
  }
  [[nodiscard]] std::uint64_t cell_count() const override {
    return static_cast<std::uint64_t>(data_->GetNumberOfCells());
  }

  void read_points(std::span<dvec3> points) const override {
    for (std::size_t i = 0; i < points.size(); ++i) data_->GetPoint(static_cast<vtkIdType>(i), &points[i].x);
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
    return data_->GetCellType(static_cast<vtkIdType>(cell));
  }

  void append_points(std::uint64_t cell, std::vector<std::int64_t>& points) const override {
    vtkIdType count = 0;
    const vtkIdType* ids = nullptr;
    if (grid_) {
      grid_->GetCells()->GetCellAtId(static_cast<vtkIdType>(cell), count, ids);
    } else {
      data_->GetCellPoints(static_cast<vtkIdType>(cell), ids_);
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

  [[nodiscard]] bool is_structured() const override { return !grid_ && !vtkPolyData::SafeDownCast(data_); }

  [[nodiscard]] std::optional<std::vector<FlatCells>> flat_cells() const override {
    auto* surface = vtkPolyData::SafeDownCast(data_);
    if (!surface) return std::nullopt;
    const auto count = [](vtkIdType cells) { return static_cast<std::uint64_t>(cells); };
    return std::vector<FlatCells>{{"vertex", 0, count(surface->GetNumberOfVerts())},
                                  {"line", 1, count(surface->GetNumberOfLines())},
                                  {"polygon", 2, count(surface->GetNumberOfPolys())},
                                  {"triangle strip", 2, count(surface->GetNumberOfStrips())}};
  }

  // Also if the file gives no degrees.
  [[nodiscard]] bool has_one_degree(std::uint64_t cell) const override {
    vtkDataArray* degrees = data_->GetCellData()->GetArray("HigherOrderDegrees");
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

  [[nodiscard]] std::vector<ArrayShape> arrays() const override {
    std::vector<ArrayShape> shapes;
    for (const bool of_cells : {false, true}) add_shapes(of_cells, shapes);
    return shapes;
  }

  [[nodiscard]] std::optional<std::shared_ptr<const NumberArray>> array(const std::string& name,
                                                                        bool of_cells) const override {
    vtkDataSetAttributes& all = arrays_of(*data_, of_cells);
    if (!all.HasArray(name.c_str())) return std::nullopt;
    vtkDataArray* array = all.GetArray(name.c_str());  // null for texts
    return array ? std::make_shared<VtkArray>(*array) : nullptr;
  }

  void add_cell_values(const std::string& name, std::vector<double> values) override {
    const vtkNew<vtkDoubleArray> array;
    array->SetName(name.c_str());
    array->SetNumberOfValues(static_cast<vtkIdType>(values.size()));
    std::ranges::copy(values, array->GetPointer(0));
    data_->GetCellData()->AddArray(array);
  }

  // As ParaView writes it (TimeValue) or older writers (TIME).
  [[nodiscard]] std::optional<double> stated_time() const override {
    for (const char* name : {"TimeValue", "TIME"}) {
      vtkDataArray* array = data_->GetFieldData()->GetArray(name);
      if (array && array->GetNumberOfValues() == 1 && std::isfinite(array->GetComponent(0, 0)))
        return array->GetComponent(0, 0);
    }
    return std::nullopt;
  }

  [[nodiscard]] Status guard(const std::string& path, const std::function<void()>& call) const override {
    return run_vtk(path, call);
  }

 private:
  /// Adds the arrays of the points, or of the cells, that give attributes, with units in VTK's own way.
  void add_shapes(bool of_cells, std::vector<ArrayShape>& shapes) const {
    vtkDataSetAttributes& all = arrays_of(*data_, of_cells);
    for (int i = 0; i < all.GetNumberOfArrays(); ++i) {
      vtkDataArray* array = all.GetArray(i);  // null for strings
      const int role = all.IsArrayAnAttribute(i);
      const bool ids = role == vtkDataSetAttributes::GLOBALIDS || role == vtkDataSetAttributes::PEDIGREEIDS;
      if (!array || !all.GetArrayName(i) || ids || is_bookkeeping(all.GetArrayName(i))) continue;
      ArrayShape& shape =
          shapes.emplace_back(ArrayShape{all.GetArrayName(i), array->GetNumberOfComponents(), of_cells});
      if (array->HasInformation() && array->GetInformation()->Has(vtkDataArray::UNITS_LABEL()))
        shape.unit = array->GetInformation()->Get(vtkDataArray::UNITS_LABEL());
    }
  }

  vtkSmartPointer<vtkDataSet> data_;
  vtkUnstructuredGrid* grid_;  // data_, if it is one
  std::vector<std::uint8_t> cell_ghosts_, point_ghosts_;
  vtkNew<vtkIdList> ids_;
};

}  // namespace

std::unique_ptr<DataSet> data_set_of(vtkDataSet& data) { return std::make_unique<DataSetOfVtk>(data); }

std::unique_ptr<DataSet> data_set_sharing_arrays(vtkDataSet& data) {
  const auto copy = vtkSmartPointer<vtkDataSet>::Take(data.NewInstance());
  copy->ShallowCopy(&data);
  return data_set_of(*copy);
}

vtkDataSetAttributes& arrays_of(vtkDataSet& data, bool of_cells) {
  return of_cells ? static_cast<vtkDataSetAttributes&>(*data.GetCellData()) : *data.GetPointData();
}

void name_in_utf8(vtkDataSet& data) {
  for (const bool of_cells : {false, true}) {
    vtkDataSetAttributes& arrays = arrays_of(data, of_cells);
    for (int i = 0; i < arrays.GetNumberOfArrays(); ++i)
      if (const char* name = arrays.GetArrayName(i)) arrays.GetAbstractArray(i)->SetName(as_utf8(name).c_str());
  }
}

}  // namespace splatvol
