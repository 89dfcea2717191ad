#include "builder/sources/openfoam/openfoam_reader.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <deque>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "builder/mesh/cell_kinds.h"
#include "builder/sources/block_numbers.h"
#include "builder/sources/mesh_data.h"
#include "builder/sources/openfoam/foam_case.h"
#include "builder/sources/openfoam/foam_fields.h"
#include "builder/sources/openfoam/foam_mesh.h"
#include "builder/sources/openfoam/foam_rounding.h"
#include "builder/sources/openfoam/shared_points.h"
#include "builder/sources/patch.h"
#include "builder/sources/piece_maker.h"
#include "builder/sources/time_steps.h"

namespace splatvol {
namespace {

using Label = std::uint32_t;

/// Makes the cells of a mesh: linear cells where the faces form one, and polyhedra.
class CellMaker {
 public:
  CellMaker(const FoamMesh& mesh, MeshData& data) : mesh_(mesh), faces_(faces_of_cells(mesh)), data_(data) {
    data.types.reserve(mesh.cell_count);
    data.offsets.reserve(std::size_t{mesh.cell_count} + 1);
    data.connectivity.reserve(2 * mesh.faces.values.size() / 3);  // three faces or more meet at a corner of a cell
    for (cell_ = 0; cell_ < mesh.cell_count; ++cell_) add_cell();
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
    if (all == 4 && triangles == 4 && make_cone(3)) return insert(vtk_cell::tetrahedron);
    if (all == 5 && triangles == 4 && quadrilaterals == 1 && make_cone(4)) return insert(vtk_cell::pyramid);
    if (all == 5 && triangles == 2 && quadrilaterals == 3 && make_prism(3)) {
      // The first triangle of a wedge turns the other way round in VTK's order.
      std::swap(corners_[1], corners_[2]);
      std::swap(corners_[4], corners_[5]);
      return insert(vtk_cell::wedge);
    }
    if (all == 6 && quadrilaterals == 6 && make_prism(4)) return insert(vtk_cell::hexahedron);
    insert_polyhedron();
  }

  [[nodiscard]] std::span<const Label> faces_of_cell() const { return faces_[cell_]; }
  [[nodiscard]] std::span<const Label> corners_of(Label face) const { return mesh_.faces[face]; }

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
    data_.add_cell(type, corners_);
    if (!data_.face_locations.empty()) data_.face_locations.push_back(-1);
  }

  void insert_polyhedron() {
    std::vector<std::int64_t>& stream = data_.faces;
    if (stream.empty()) {
      data_.face_locations.assign(cell_, -1);
      stream.reserve(2 * mesh_.faces.values.size() + faces_.values.size() + mesh_.cell_count);
    }
    data_.face_locations.push_back(static_cast<std::int64_t>(stream.size()));
    corners_.clear();
    stream.push_back(static_cast<std::int64_t>(faces_of_cell().size()));
    for (const Label face : faces_of_cell()) {
      const std::span<const Label> points = corners_of(face);
      stream.push_back(static_cast<std::int64_t>(points.size()));
      if (mesh_.owner[face] == cell_)
        stream.insert(stream.end(), points.begin(), points.end());
      else
        stream.insert(stream.end(), points.rbegin(), points.rend());
      corners_.insert(corners_.end(), points.begin(), points.end());
    }
    std::ranges::sort(corners_);
    corners_.erase(std::ranges::unique(corners_).begin(), corners_.end());
    data_.add_cell(vtk_cell::polyhedron, corners_);
  }

  const FoamMesh& mesh_;
  LabelLists faces_;  // of the cells
  MeshData& data_;
  Label cell_ = 0;
  std::vector<Label> corners_;  // of cell_
};

Patch make_patch(const std::string& name, const FoamMesh& mesh, const FoamPatch& patch) {
  std::vector<SurfaceCell> cells;
  for (std::uint64_t face = patch.first_face; face < patch.first_face + patch.face_count; ++face) {
    const auto corners = mesh.faces[face];
    const std::size_t count = corners.size();
    const int type = count == 3 ? vtk_cell::triangle : count == 4 ? vtk_cell::quadrilateral : vtk_cell::polygon;
    cells.push_back({type, {corners.begin(), corners.end()}});
  }
  Patch made{name, {}};
  append_cells_of(mesh.points, std::move(cells), made.mesh);
  return made;
}

/// A region of a processor.
class RegionDataSet final : public MeshDataSet {
 public:
  /// `shared` must outlive it.
  RegionDataSet(MeshData mesh, std::string region, const SharedPoints& shared)
      : MeshDataSet(std::move(mesh)), region_(std::move(region)), shared_(shared) {}

  void share_means(const std::string& array, int component, std::span<double> means) const override {
    shared_.apply(points(), region_, array, component, means);
  }

 private:
  std::string region_;
  const SharedPoints& shared_;
};

/// A case: a portion for each processor, with a data set for each region.
class OpenFoamDataSets final : public DataSets {
 public:
  OpenFoamDataSets(const InputFile& file, const SourceOptions& options) : file_(file), options_(options) {}

  Status open() {
    return run_reader(file_.path, [&] {
      case_.emplace(file_.path);
      step_ = choose_step(case_->times(), options_.time);
      if (step_) time_ = step_->time;
    });
  }

  Status announce(ArrayUnion& arrays) override {
    std::vector<ArrayShape> announced;
    SPLATVOL_TRY(run_reader(file_.path, [&] { announced = list_arrays(); }));
    SPLATVOL_TRY(arrays.add(file_.path, announced));
    SPLATVOL_TRY(arrays.add(file_.path, shared_arrays_.arrays()));
    for (const Region& region : regions_) SPLATVOL_TRY(arrays.add(file_.path, region.data->arrays()));
    return {};
  }

  std::size_t count() const override { return returned_ + regions_.size() + (portions() - portion_); }
  const std::string& path() const override { return file_.path; }
  std::optional<TimeStep> time_step() const override { return step_; }
  std::uint64_t block() const override { return block_; }
  CellCensus take_changes() override {
    CellCensus changes;
    changes.rounded_by = std::exchange(rounded_by_, 0);
    changes.losses = std::exchange(losses_, {});
    return changes;
  }
  std::vector<Patch> take_patches() override { return std::exchange(patches_, {}); }
  bool averages_by_data_set() const override { return !shares_points(); }

  Result<std::unique_ptr<DataSet>> next() override {
    if (portion_ == 0 && options_.cells == CellValues::averaged && shares_points()) SPLATVOL_TRY(share_points());
    while (regions_.empty() && portion_ < portions())
      SPLATVOL_TRY(run_reader(file_.path, [&] { read(portion_++, false); }));
    if (regions_.empty()) return std::unique_ptr<DataSet>();
    Region region = std::move(regions_.front());
    regions_.pop_front();
    ++returned_;
    block_ = region.block;
    return std::move(region.data);
  }

 private:
  struct Region {
    std::unique_ptr<MeshDataSet> data;
    std::string name;
    std::uint64_t block = 0;   // as Piece::block
    std::vector<Label> outer;  // points; only for share_points()
  };

  [[nodiscard]] std::size_t portions() const { return std::max<std::size_t>(1, case_->processor_count()); }
  [[nodiscard]] bool shares_points() const { return case_->processor_count() > 1; }

  /// Reads all portions once, for the values at the points that several have.
  Status share_points() {
    for (std::size_t portion = 0; portion < portions(); ++portion) {
      SPLATVOL_TRY(run_reader(file_.path, [&] { read(portion, true); }));
      for (const Region& region : regions_) {
        const std::vector<ArrayShape> arrays = region.data->arrays();
        SPLATVOL_TRY(shared_arrays_.add(file_.path, arrays));
        if (std::ranges::none_of(arrays, [](const ArrayShape& array) { return *array.of_cells; })) continue;
        SPLATVOL_TRY_ASSIGN(averages, make_averages(file_.path, *region.data));
        shared_.add(*region.data, region.outer, region.name, averages, MissingValues(options_.missing));
      }
      regions_.clear();
    }
    shared_.finish();
    return {};
  }

  /// All arrays of a case of several processors, before any of them is read. The regions of others tell.
  std::vector<ArrayShape> list_arrays() {
    if (has_read_ && portions() == 1) return {};
    check_parts();
    std::vector<ArrayShape> shapes;
    for (std::size_t part = 0; part < portions(); ++part)
      for (const std::string& region : case_->regions())
        for (const FoamFieldFile& field : fields(part, region))
          if (std::ranges::find(shapes, field.name, &ArrayShape::name) == shapes.end())
            shapes.push_back({field.name, field.kind.components, field.kind.of_cells});
    std::ranges::sort(shapes, {}, &ArrayShape::name);
    return shapes;
  }

  void check_parts() {
    if (!std::exchange(is_checked_, true)) case_->check_parts(time_);
  }

  [[nodiscard]] bool wants(const std::string& name) const { return wants_array(options_.selection, name); }

  [[nodiscard]] std::vector<FoamFieldFile> fields(std::size_t part, const std::string& region) {
    return case_->fields(
        part, region, time_, [&](const std::string& name) { return wants(name); }, &losses_);
  }

  /// Appends the regions of a portion to regions_. `for_shared`: for share_points().
  void read(std::size_t portion, bool for_shared) {
    check_parts();
    BlockNumbers numbers;
    for (const std::string& name : case_->regions()) {
      // VTK's names.
      const bool alone = case_->regions().size() == 1;
      Region region = read_region(portion, name, for_shared);
      if (region.data->point_count() == 0) continue;
      region.block = numbers.next(alone ? "internalMesh" : name.empty() ? "defaultRegion" : name);
      regions_.push_back(std::move(region));
    }
    losses_.merge(case_->left_out(portion, time_, [&](const std::string& name) { return wants(name); }));
    has_read_ = true;
  }

  Region read_region(std::size_t part, const std::string& name, bool for_shared) {
    const auto find = [&](const char* file) { return case_->mesh_file(part, name, time_, file); };
    const FoamPlace boundary = find("boundary");
    const std::vector<FoamPatch> patches = read_foam_patches(boundary);
    Region region;
    region.name = name;
    MeshData data;
    {
      FoamMesh mesh = read_foam_mesh(find);
      check_foam_patches(mesh, patches, boundary.name);
      round(mesh);
      if (file_.patches && !for_shared) add_patches(name, mesh, patches);
      CellMaker(mesh, data);
      if (for_shared) region.outer = outer_points(mesh);
      data.points = std::move(mesh.points);
    }
    for (const FoamFieldFile& file : fields(part, name)) {
      const std::size_t count = file.kind.of_cells ? data.types.size() : data.points.size();
      FoamField field = read_foam_field(file.place, file.kind, count);
      data.arrays.push_back(
          {{file.name, file.kind.components, file.kind.of_cells, field.unit}, std::move(field.values)});
    }
    region.data = std::make_unique<RegionDataSet>(std::move(data), name, shared_);
    return region;
  }

  /// Rounds the points of a mesh if that may be. All meshes of a step decide together. Steps need not agree: of a mesh
  /// that moves, each has its own points.
  void round(FoamMesh& mesh) {
    if (!options_.may_round) return;
    if (!rounding_) {
      rounding_.emplace();
      const bool is_only = portions() == 1 && case_->regions().size() == 1;
      if (is_only) rounding_->include(mesh);
      for (std::size_t part = 0; part < portions() && !is_only; ++part)
        for (const std::string& region : case_->regions())
          rounding_->include(
              read_foam_faces([&](const char* name) { return case_->mesh_file(part, region, time_, name); }));
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

  InputFile file_;
  SourceOptions options_;
  std::optional<FoamCase> case_;
  std::optional<TimeStep> step_;
  std::optional<double> time_;             // of step_
  std::optional<PointRounding> rounding_;  // of the step, once it is known
  double rounded_by_ = 0;                  // not taken yet
  std::set<std::string> losses_;           // CellCensus::losses, not taken yet
  bool has_read_ = false, is_checked_ = false;
  ArrayUnion shared_arrays_;    // of portions that were read by share_points()
  SharedPoints shared_;         // of these
  std::size_t portion_ = 0;     // the next to be read
  std::deque<Region> regions_;  // read and not returned yet
  std::size_t returned_ = 0;    // regions
  std::uint64_t block_ = 0;     // of the last one
  std::vector<Patch> patches_;  // not taken yet
};

}  // namespace

Result<std::unique_ptr<DataSets>> open_openfoam(const InputFile& file, const SourceOptions& options) {
  auto data_sets = std::make_unique<OpenFoamDataSets>(file, options);
  SPLATVOL_TRY(data_sets->open());
  return data_sets;
}

}  // namespace splatvol
