// OpenFOAM's meshes and fields as data sets.
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDoubleArray.h>
#include <vtkIdTypeArray.h>
#include <vtkInformation.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <span>
#include <utility>

#include "builder/sources/openfoam/foam_case.h"
#include "builder/sources/openfoam/foam_fields.h"
#include "builder/sources/openfoam/foam_mesh.h"
#include "builder/sources/openfoam/foam_rounding.h"
#include "builder/sources/vtk/block_reader.h"
#include "builder/sources/vtk/patch.h"

namespace splatvol {
namespace {

using Label = std::uint32_t;

/// Makes the cells of a grid: VTK's linear cells where the faces form one, and polyhedra.
class CellMaker {
 public:
  explicit CellMaker(const FoamMesh& mesh) : mesh_(mesh), faces_(faces_of_cells(mesh)) {
    types_->Allocate(mesh.cell_count);
    cells_->AllocateEstimate(mesh.cell_count, 8);
    for (cell_ = 0; cell_ < mesh.cell_count; ++cell_) add_cell();
  }

  void give_to(vtkUnstructuredGrid& grid) {
    const bool has_polyhedra = stream_->GetNumberOfValues() > 0;
    grid.SetCells(types_, cells_, has_polyhedra ? locations_.Get() : nullptr, has_polyhedra ? stream_.Get() : nullptr);
  }

 private:
  void add_cell() {
    const std::span<const Label> faces = faces_of_cell();
    const auto sides = [&](std::size_t corners) {
      return std::ranges::count_if(faces, [&](Label face) { return corners_of(face).size() == corners; });
    };
    const auto triangles = sides(3), quadrilaterals = sides(4);
    const std::size_t all = faces.size();
    corners_.clear();
    if (all == 4 && triangles == 4 && make_cone(3)) return insert(VTK_TETRA);
    if (all == 5 && triangles == 4 && quadrilaterals == 1 && make_cone(4)) return insert(VTK_PYRAMID);
    if (all == 5 && triangles == 2 && quadrilaterals == 3 && make_prism(3)) {
      // The first triangle of VTK's wedge turns the other way round.
      std::swap(corners_[1], corners_[2]);
      std::swap(corners_[4], corners_[5]);
      return insert(VTK_WEDGE);
    }
    if (all == 6 && quadrilaterals == 6 && make_prism(4)) return insert(VTK_HEXAHEDRON);
    insert_polyhedron();
  }

  [[nodiscard]] std::span<const Label> faces_of_cell() const {
    return std::span(faces_.values).subspan(faces_.starts[cell_], faces_.starts[cell_ + 1] - faces_.starts[cell_]);
  }

  [[nodiscard]] std::span<const Label> corners_of(Label face) const {
    const LabelLists& all = mesh_.faces;
    return std::span(all.values).subspan(all.starts[face], all.starts[face + 1] - all.starts[face]);
  }

  /// Sets corners_ to those of the first face that has so many, in an order that turns right round the direction into
  /// the cell. Returns the face. Requires that there is one.
  Label take_base(std::size_t corners) {
    const auto base = *std::ranges::find_if(faces_of_cell(), [&](Label f) { return corners_of(f).size() == corners; });
    const std::span<const Label> points = corners_of(base);
    corners_.assign(points.begin(), points.end());
    if (mesh_.owner[base] == cell_) std::reverse(corners_.begin() + 1, corners_.end());
    return base;
  }

  /// Makes a cell of a base and an apex. Returns false if the faces form none.
  bool make_cone(std::size_t corners) {
    const Label base = take_base(corners);
    const auto in_base = [&](Label point) {
      return std::find(corners_.begin(), corners_.begin() + static_cast<std::ptrdiff_t>(corners), point) !=
             corners_.begin() + static_cast<std::ptrdiff_t>(corners);
    };
    for (const Label face : faces_of_cell()) {
      if (face == base) continue;
      std::size_t shared = 0;
      for (const Label point : corners_of(face)) {
        shared += in_base(point) ? 1 : 0;
        if (in_base(point)) continue;
        if (corners_.size() == corners) corners_.push_back(point);
        if (corners_[corners] != point) return false;
      }
      if (shared != 2) return false;
    }
    return true;
  }

  /// Makes a cell of two equal faces, one above the other, with quadrilaterals between them. Returns false if the faces
  /// form none.
  bool make_prism(std::size_t corners) {
    const Label base = take_base(corners);
    std::array<Label, 4> above{}, above_next{};
    for (std::size_t i = 0; i < corners; ++i)
      if (!find_side(base, corners_[i], corners_[(i + 1) % corners], above[i], above_next[i])) return false;
    for (std::size_t i = 0; i < corners; ++i)
      if (above_next[i] != above[(i + 1) % corners]) return false;
    const auto top = std::span(above).first(corners);
    const bool has_top = std::ranges::any_of(faces_of_cell(), [&](Label face) {
      const auto points = corners_of(face);
      return face != base && points.size() == corners &&
             std::ranges::all_of(points, [&](Label point) { return std::ranges::find(top, point) != top.end(); });
    });
    corners_.insert(corners_.end(), top.begin(), top.end());
    return has_top;
  }

  /// Finds the quadrilateral at an edge of the base, and its corners above the edge's ends.
  [[nodiscard]] bool find_side(Label base, Label from, Label to, Label& above_from, Label& above_to) const {
    for (const Label face : faces_of_cell()) {
      const std::span<const Label> points = corners_of(face);
      const auto at = static_cast<std::size_t>(std::ranges::find(points, from) - points.begin());
      if (face == base || points.size() != 4 || at == 4) continue;
      const bool forwards = points[(at + 1) % 4] == to, backwards = points[(at + 3) % 4] == to;
      if (forwards == backwards) continue;
      above_from = points[(at + (forwards ? 3 : 1)) % 4];
      above_to = points[(at + 2) % 4];
      return true;
    }
    return false;
  }

  void insert(int type) {
    types_->InsertNextValue(static_cast<unsigned char>(type));
    points_.assign(corners_.begin(), corners_.end());
    cells_->InsertNextCell(static_cast<vtkIdType>(points_.size()), points_.data());
    if (locations_->GetNumberOfValues() > 0) locations_->InsertNextValue(-1);
  }

  void insert_polyhedron() {
    if (locations_->GetNumberOfValues() == 0)
      for (Label cell = 0; cell < cell_; ++cell) locations_->InsertNextValue(-1);
    const vtkIdType at = stream_->GetNumberOfValues();
    corners_.clear();
    stream_->InsertNextValue(static_cast<vtkIdType>(faces_of_cell().size()));
    for (const Label face : faces_of_cell()) {
      const std::span<const Label> points = corners_of(face);
      stream_->InsertNextValue(static_cast<vtkIdType>(points.size()));
      const bool turns = mesh_.owner[face] != cell_;
      for (std::size_t i = 0; i < points.size(); ++i)
        stream_->InsertNextValue(points[turns ? points.size() - 1 - i : i]);
      corners_.insert(corners_.end(), points.begin(), points.end());
    }
    std::ranges::sort(corners_);
    corners_.erase(std::ranges::unique(corners_).begin(), corners_.end());
    types_->InsertNextValue(VTK_POLYHEDRON);
    points_.assign(corners_.begin(), corners_.end());
    cells_->InsertNextCell(static_cast<vtkIdType>(points_.size()), points_.data());
    locations_->InsertNextValue(at);
  }

  const FoamMesh& mesh_;
  LabelLists faces_;  // of the cells
  Label cell_ = 0;
  std::vector<Label> corners_;     // of cell_
  std::vector<vtkIdType> points_;  // of cell_
  vtkNew<vtkUnsignedCharArray> types_;
  vtkNew<vtkCellArray> cells_;
  vtkNew<vtkIdTypeArray> locations_, stream_;  // empty: there are no polyhedra so far
};

void add_field(vtkUnstructuredGrid& grid, const FoamFieldFile& file, const FoamField& field) {
  const vtkNew<vtkDoubleArray> array;
  array->SetName(file.name.c_str());
  array->SetNumberOfComponents(file.kind.components);
  array->SetNumberOfTuples(static_cast<vtkIdType>(field.values.size()) / file.kind.components);
  if (!field.values.empty()) std::ranges::copy(field.values, array->GetPointer(0));
  file.kind.of_cells ? grid.GetCellData()->AddArray(array) : grid.GetPointData()->AddArray(array);
}

Patch make_patch(const std::string& name, const FoamMesh& mesh, const FoamPatch& patch) {
  std::vector<SurfaceCell> cells;
  for (std::uint64_t face = patch.first_face; face < patch.first_face + patch.face_count; ++face) {
    const auto first = mesh.faces.values.begin() + mesh.faces.starts[face];
    const auto last = mesh.faces.values.begin() + mesh.faces.starts[face + 1];
    const auto corners = last - first;
    cells.push_back({corners == 3 ? VTK_TRIANGLE : corners == 4 ? VTK_QUAD : VTK_POLYGON, {first, last}});
  }
  Patch made{name, {}};
  append_cells_of(mesh.points, std::move(cells), made.mesh);
  return made;
}

class OpenFoamReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm* open(const std::string& path) override {
    case_.emplace(path);
    return nullptr;
  }

  vtkMultiBlockDataSet* output() override { return tree_; }
  std::vector<double> times() const override { return case_->times(); }
  void want_patches() override { wants_patches_ = true; }
  void allow_rounding() override { may_round_ = true; }
  CellCensus take_changes() override {
    CellCensus changes;
    changes.rounded_by = std::exchange(rounded_by_, 0);
    changes.losses = std::exchange(losses_, {});
    return changes;
  }
  std::vector<Patch> take_patches() override { return std::exchange(patches_, {}); }
  void select(const std::vector<std::string>& selection) override { selection_ = selection; }

  /// Each processor has a part of each region.
  std::string block_name(const std::vector<std::string>& path) const override { return path.front(); }

  std::vector<ArrayShape> arrays(std::optional<double> time) override {
    if (has_read_ && portions() == 1) return {};  // its blocks tell
    check_parts(time);
    std::vector<ArrayShape> shapes;
    for (int part = 0; part < portions(); ++part)
      for (const std::string& region : case_->regions())
        for (const FoamFieldFile& field : fields(part, region, time))
          if (std::ranges::find(shapes, field.name, &ArrayShape::name) == shapes.end())
            shapes.push_back({field.name, field.kind.components, field.kind.of_cells});
    std::ranges::sort(shapes, {}, &ArrayShape::name);
    return shapes;
  }

  int portions() override { return std::max(1, static_cast<int>(case_->processor_count())); }
  bool portions_share_points() const override { return case_->processor_count() > 1; }
  std::string unit(const std::string& array) const override {
    const auto found = units_.find(array);
    return found == units_.end() ? std::string() : found->second;
  }

  void read(int portion, std::optional<double> time) override {
    check_parts(time);
    tree_->Initialize();
    patches_.clear();
    unsigned int block = 0;
    for (const std::string& region : case_->regions()) {
      tree_->SetBlock(block, read_region(portion, region, time));
      // VTK's names.
      const bool alone = case_->regions().size() == 1;
      const std::string name = alone ? "internalMesh" : region.empty() ? "defaultRegion" : region;
      tree_->GetMetaData(block++)->Set(vtkCompositeDataSet::NAME(), name.c_str());
    }
    losses_.merge(case_->left_out(static_cast<std::size_t>(portion), time,
                                  [&](const std::string& name) { return wants_array(selection_, name); }));
    has_read_ = true;
  }

 private:
  void check_parts(std::optional<double> time) {
    if (!std::exchange(is_checked_, true)) case_->check_parts(time);
  }

  [[nodiscard]] std::vector<FoamFieldFile> fields(int part, const std::string& region, std::optional<double> time) {
    return case_->fields(
        static_cast<std::size_t>(part), region, time,
        [&](const std::string& name) { return wants_array(selection_, name); }, &losses_);
  }

  vtkSmartPointer<vtkUnstructuredGrid> read_region(int part, const std::string& region, std::optional<double> time) {
    const auto find = [&](const char* name) {
      return case_->mesh_file(static_cast<std::size_t>(part), region, time, name);
    };
    const FoamPlace boundary = find("boundary");
    const std::vector<FoamPatch> patches = read_foam_patches(boundary);
    auto grid = vtkSmartPointer<vtkUnstructuredGrid>::New();
    {
      FoamMesh mesh = read_foam_mesh(find);
      check_foam_patches(mesh, patches, boundary.name);
      round(mesh, time);
      if (wants_patches_) add_patches(region, mesh, patches);
      grid->SetPoints(make_points(mesh.points));
      CellMaker(mesh).give_to(*grid);
    }
    for (const FoamFieldFile& file : fields(part, region, time)) {
      const vtkIdType count = file.kind.of_cells ? grid->GetNumberOfCells() : grid->GetNumberOfPoints();
      const FoamField field = read_foam_field(file.place, file.kind, static_cast<std::uint64_t>(count));
      add_field(*grid, file, field);
      if (!field.unit.empty()) units_.emplace(file.name, field.unit);
    }
    return grid;
  }

  /// Rounds the points of a mesh if that may be. All meshes of a step decide together. Steps need not agree: of a mesh
  /// that moves, each has its own points.
  void round(FoamMesh& mesh, std::optional<double> time) {
    if (!may_round_) return;
    if (!rounding_) {
      rounding_.emplace();
      const bool is_only = portions() == 1 && case_->regions().size() == 1;
      if (is_only) rounding_->include(mesh);
      for (int part = 0; part < portions() && !is_only; ++part)
        for (const std::string& region : case_->regions())
          rounding_->include(read_foam_faces(
              [&](const char* name) { return case_->mesh_file(static_cast<std::size_t>(part), region, time, name); }));
    }
    const double step = rounding_->step();
    rounded_by_ = step / 2;
    if (step > 0) round_points(step, mesh.points);
  }

  /// Patches between processors lie inside. Those of a region have the name of the region in front.
  void add_patches(const std::string& region, const FoamMesh& mesh, const std::vector<FoamPatch>& patches) {
    const std::string of_region = case_->regions().size() == 1 ? "" : (region.empty() ? "defaultRegion" : region) + "/";
    for (const FoamPatch& patch : patches)
      if (!patch.is_between_processors() && patch.face_count > 0)
        patches_.push_back(make_patch(of_region + patch.name, mesh, patch));
  }

  std::optional<FoamCase> case_;
  std::vector<std::string> selection_;
  bool wants_patches_ = false, has_read_ = false, is_checked_ = false, may_round_ = false;
  std::optional<PointRounding> rounding_;  // of the step, once it is known
  double rounded_by_ = 0;                  // not taken yet
  vtkNew<vtkMultiBlockDataSet> tree_;
  std::map<std::string, std::string> units_;
  std::vector<Patch> patches_;    // not taken yet
  std::set<std::string> losses_;  // CellCensus::losses, not taken yet
};

}  // namespace

std::unique_ptr<BlockReader> make_openfoam_reader() { return std::make_unique<OpenFoamReader>(); }

}  // namespace splatvol
