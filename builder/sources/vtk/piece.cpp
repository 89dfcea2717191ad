#include "builder/sources/vtk/piece.h"

#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkGenericCell.h>
#include <vtkHigherOrderHexahedron.h>
#include <vtkHigherOrderTetra.h>
#include <vtkHigherOrderWedge.h>
#include <vtkIdList.h>
#include <vtkIdTypeArray.h>
#include <vtkNew.h>
#include <vtkPolyData.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "builder/mesh/cell_moments.h"
#include "builder/mesh/tetrahedra.h"
#include "builder/sources/far_points.h"
#include "builder/sources/vtk/cell_averages.h"
#include "builder/sources/vtk/cells.h"
#include "builder/sources/vtk/lattice.h"
#include "builder/sources/vtk/lent_arrays.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

/// The positions of a cell's points in VTK's unit cell; empty if VTK has none.
std::vector<dvec3> parametric_points(int vtk_type, vtkIdType count) {
  const auto cell = vtkSmartPointer<vtkCell>::Take(vtkGenericCell::InstantiateCell(vtk_type));
  cell->GetPointIds()->SetNumberOfIds(count);
  cell->GetPoints()->SetNumberOfPoints(count);
  if (auto* hexahedron = vtkHigherOrderHexahedron::SafeDownCast(cell)) hexahedron->SetUniformOrderFromNumPoints(count);
  if (auto* wedge = vtkHigherOrderWedge::SafeDownCast(cell)) wedge->SetUniformOrderFromNumPoints(count);
  if (auto* tetrahedron = vtkHigherOrderTetra::SafeDownCast(cell)) tetrahedron->Initialize();
  const double* coordinates = cell->GetParametricCoords();
  std::vector<dvec3> points;
  for (vtkIdType i = 0; coordinates && i < count; ++i, coordinates += 3)
    points.emplace_back(coordinates[0], coordinates[1], coordinates[2]);
  return points;
}

/// Divides a cell of `count` points into linear cells; empty if the points form no full lattice.
std::optional<std::vector<std::uint32_t>> linear_cells(const CellKind& kind, std::size_t count) {
  const bool linear_axis = kind.vtk_type == VTK_QUADRATIC_LINEAR_WEDGE;
  const auto order = lattice_order(kind.shape, linear_axis, count);
  if (!order) return std::nullopt;
  const auto parametric = parametric_points(kind.vtk_type, static_cast<vtkIdType>(count));
  return divide_lattice(kind.shape, *order, linear_axis ? 1 : *order, parametric);
}

/// Makes one piece of one data set.
class PieceMaker {
 public:
  PieceMaker(const std::string& path, vtkDataSet& data, std::span<const VtkAttribute> attributes, CellValues cells,
             const MissingValues& missing, const ChangeMeans& change_means, bool lend)
      : path_(path),
        data_(data),
        attributes_(attributes),
        own_cells_(cells == CellValues::own),
        missing_(missing),
        change_means_(change_means),
        lends_(lend) {}

  Result<std::unique_ptr<Piece>> make() {
    SPLATVOL_TRY(read_points());
    SPLATVOL_TRY(find_arrays());
    SPLATVOL_TRY(read_cells());
    if (own_cells_) {
      use_cells_as_points();
      prepare_lending();
      read_values_of_cells();
    } else {
      drop_points();
      prepare_lending();
      read_values_of_points();
    }
    piece_->lent = std::move(lent_);
    return std::move(piece_);
  }

  Result<CellAverages> make_averages() {
    SPLATVOL_TRY(read_points());
    averages_ = true;
    SPLATVOL_TRY(find_arrays());
    SPLATVOL_TRY(read_cells());
    return CellAverages(data_, std::move(volumes_));
  }

 private:
  enum Use : std::uint8_t { unused, by_hidden_cells, by_visible_cells };

  Status read_points() {
    const vtkIdType count = data_.GetNumberOfPoints();
    if (count > std::numeric_limits<std::uint32_t>::max())
      return fail(ErrorCode::unsupported, "{}: a piece of {} points; at most 2^32 - 1 are supported", path_, count);
    piece_->points.resize(static_cast<std::size_t>(count));
    for (vtkIdType i = 0; i < count; ++i) data_.GetPoint(i, &piece_->points[static_cast<std::size_t>(i)].x);
    drop_far_points(piece_->points);
    use_.assign(piece_->points.size(), unused);
    return read_ghosts();
  }

  Status read_ghosts() {
    cell_ghosts_ = data_.GetCellGhostArray();
    point_ghosts_ = data_.GetPointGhostArray();
    if (cell_ghosts_ && cell_ghosts_->GetNumberOfValues() < data_.GetNumberOfCells())
      return fail(ErrorCode::invalid_data, "{}: its cells' ghost array is too short", path_);
    if (point_ghosts_ && point_ghosts_->GetNumberOfValues() < data_.GetNumberOfPoints())
      return fail(ErrorCode::invalid_data, "{}: its points' ghost array is too short", path_);
    return {};
  }

  /// Finds the array of each attribute, and whether the volumes of the cells are needed.
  Status find_arrays() {
    for (std::size_t a = 0; a < attributes_.size(); ++a) {
      SPLATVOL_TRY_ASSIGN(values, find_values(path_, data_, attributes_, a));
      arrays_.push_back(values);
      averages_ = averages_ || (values.of_cells && !own_cells_);
    }
    if (averages_) volumes_.resize(static_cast<std::size_t>(data_.GetNumberOfCells()));
    if (own_cells_ && data_.GetNumberOfCells() >= PointCells::no_point)
      return fail(ErrorCode::unsupported, "{}: a piece of {} cells; at most 2^32 - 2 are supported", path_,
                  data_.GetNumberOfCells());
    return {};
  }

  Status read_cells() {
    if (auto* surface = vtkPolyData::SafeDownCast(&data_)) return count_surface(*surface);
    grid_ = vtkUnstructuredGrid::SafeDownCast(&data_);
    if (grid_ && grid_->GetNumberOfCells() > 0) SPLATVOL_TRY(check_cell_array());
    TetrahedronSplitter splitter(piece_->points, piece_->tetrahedra, piece_->census);
    for (vtkIdType cell = 0; cell < data_.GetNumberOfCells(); ++cell) {
      const std::size_t first = piece_->tetrahedra.size();
      SPLATVOL_TRY(read_cell(cell, splitter));
      if (own_cells_) begins_.push_back(first);
      if (averages_) volumes_[static_cast<std::size_t>(cell)] += volume_of(piece_->tetrahedra, first);
    }
    return {};
  }

  [[nodiscard]] double volume_of(std::span<const Tetrahedron> tetrahedra, std::size_t first) const {
    double volume = 0;
    for (const Tetrahedron& corners : tetrahedra.subspan(first)) volume += tetrahedron_volume(piece_->points, corners);
    return volume;
  }

  /// Counts cells without volume; their points need no check.
  Status count_surface(vtkPolyData& surface) {
    const auto add = [&](std::string_view name, int dimension, vtkIdType count) {
      if (count == 0) return;
      piece_->census.cells[std::string(name)] += static_cast<std::uint64_t>(count);
      count_without_volume(dimension, static_cast<std::uint64_t>(count));
    };
    add("vertex", 0, surface.GetNumberOfVerts());
    add("line", 1, surface.GetNumberOfLines());
    add("polygon", 2, surface.GetNumberOfPolys());
    add("triangle strip", 2, surface.GetNumberOfStrips());
    return {};
  }

  void count_without_volume(int dimension, std::uint64_t count) {
    CellCensus& census = piece_->census;
    census.without_volume += count;
    if (dimension == 1) census.lines += count;
    if (dimension == 2) census.surfaces += count;
  }

  /// VTK's readers do not check the offsets against the connectivity, nor the types against the number of cells.
  Status check_cell_array() {
    vtkUnsignedCharArray* types = grid_->GetCellTypesArray();
    if (!grid_->GetCells()->IsValid() || !types || types->GetNumberOfValues() < grid_->GetNumberOfCells())
      return fail(ErrorCode::invalid_data, "{}: its cells' offsets, types and connectivity do not fit together", path_);
    return {};
  }

  Status read_cell(vtkIdType cell, TetrahedronSplitter& splitter) {
    const int type = data_.GetCellType(cell);
    const CellKind* kind = last_kind_ && last_kind_->vtk_type == type ? last_kind_ : find_cell_kind(type);
    if (!kind) return fail(ErrorCode::unsupported, "{}: cells of VTK type {} are not supported", path_, type);
    SPLATVOL_TRY(load_points(cell, *kind));

    // In a structured grid, a blanked cell has the type "empty".
    CellCensus& census = piece_->census;
    const bool hidden = is_hidden(cell, *kind) || (!grid_ && type == VTK_EMPTY_CELL);
    mark_points(*kind, hidden ? by_hidden_cells : by_visible_cells);
    if (hidden) {
      ++census.hidden;
      return weigh_hidden(cell, *kind);
    }
    if (last_kind_ != kind) {
      last_kind_ = kind;
      kind_count_ = &census.cells[std::string(kind->name)];
    }
    ++*kind_count_;
    if (kind->role == CellRole::no_volume) count_without_volume(dimension_of(*kind), 1);
    return split_cell(cell, *kind, splitter);
  }

  Status split_cell(vtkIdType cell, const CellKind& kind, TetrahedronSplitter& splitter) {
    if (kind.role == CellRole::polyhedron) splitter.split_polyhedron(cell_points_);
    if (kind.role == CellRole::shape) return split_shape(kind, splitter);
    if (kind.role == CellRole::lattice) return split_lattice(cell, kind, splitter);
    return {};
  }

  /// A ghost copy counts in the means at its points, so that they are the same in all pieces. Other hidden cells do not
  /// count.
  Status weigh_hidden(vtkIdType cell, const CellKind& kind) {
    if (!averages_) return {};
    double& volume = volumes_[static_cast<std::size_t>(cell)];
    volume = -1;
    const auto flags = cell_ghosts_ ? cell_ghosts_->GetValue(cell) : 0;
    if ((flags & vtkDataSetAttributes::DUPLICATECELL) == 0 || (flags & vtkDataSetAttributes::HIDDENCELL) != 0)
      return {};
    std::vector<Tetrahedron> tetrahedra;
    CellCensus census;  // of no interest
    TetrahedronSplitter splitter(piece_->points, tetrahedra, census);
    SPLATVOL_TRY(split_cell(cell, kind, splitter));
    volume = volume_of(tetrahedra, 0);
    return {};
  }

  Status split_shape(const CellKind& kind, TetrahedronSplitter& splitter) {
    const std::size_t expected = node_count(kind.shape);
    // Some programs give linear cells the nodes of quadratic ones. VTK's orders begin with the corners.
    const bool more_nodes = is_linear(kind.shape) && cell_points_.size() > expected;
    if (cell_points_.size() != expected && !more_nodes)
      return fail(ErrorCode::invalid_data, "{}: a {} of {} points instead of {}", path_, kind.name, cell_points_.size(),
                  expected);
    piece_->census.more_nodes += more_nodes ? 1 : 0;
    splitter.split(kind.shape, std::span(cell_points_).first(expected));
    return {};
  }

  Status split_lattice(vtkIdType cell, const CellKind& kind, TetrahedronSplitter& splitter) {
    auto& cells = lattice_cells_[{kind.vtk_type, cell_points_.size()}];
    if (!cells) cells = linear_cells(kind, cell_points_.size());
    if (!cells || !same_degrees(cell))
      return fail(ErrorCode::unsupported, "{}: a {} of {} points, which is not of one order in all directions", path_,
                  kind.name, cell_points_.size());
    const std::size_t stride = node_count(kind.shape);
    std::array<std::uint32_t, 8> linear{};
    for (std::size_t first = 0; first < cells->size(); first += stride) {
      for (std::size_t i = 0; i < stride; ++i) linear[i] = cell_points_[(*cells)[first + i]];
      splitter.split(kind.shape, std::span(linear).first(stride));
    }
    return {};
  }

  /// Whether a cell has the same degree in all directions; also if the file gives no degrees.
  [[nodiscard]] bool same_degrees(vtkIdType cell) const {
    vtkDataArray* degrees = data_.GetCellData()->GetArray("HigherOrderDegrees");
    if (!degrees) return true;
    if (degrees->GetNumberOfComponents() != 3 || cell >= degrees->GetNumberOfTuples()) return false;
    const double* degree = degrees->GetTuple3(cell);
    return degree[0] == degree[1] && degree[1] == degree[2];
  }

  /// Sets cell_points_ to a cell's points, or to a polyhedron's faces as "count, points, count, points, ...".
  Status load_points(vtkIdType cell, const CellKind& kind) {
    cell_points_.clear();
    if (kind.role == CellRole::polyhedron) return load_faces(cell);
    vtkIdType count = 0;
    const vtkIdType* ids = nullptr;
    if (grid_) {
      grid_->GetCells()->GetCellAtId(cell, count, ids);
    } else {
      data_.GetCellPoints(cell, id_list_);
      count = id_list_->GetNumberOfIds();
      ids = id_list_->GetPointer(0);
    }
    for (vtkIdType i = 0; i < count; ++i) SPLATVOL_TRY(append_point(cell, ids[i]));
    return {};
  }

  Status load_faces(vtkIdType cell) {
    vtkIdTypeArray* stream = grid_ ? grid_->GetFaces() : nullptr;
    vtkIdTypeArray* locations = grid_ ? grid_->GetFaceLocations() : nullptr;
    const auto fail_stream = [&] {
      return fail(ErrorCode::invalid_data, "{}: the faces of polyhedron {} are missing or damaged", path_, cell);
    };
    if (!stream || !locations || cell >= locations->GetNumberOfValues()) return fail_stream();
    const vtkIdType end = stream->GetNumberOfValues();
    vtkIdType at = locations->GetValue(cell);
    if (at < 0 || at >= end) return fail_stream();
    for (vtkIdType faces = stream->GetValue(at++); faces > 0; --faces) {
      if (at >= end) return fail_stream();
      const vtkIdType count = stream->GetValue(at++);
      if (count < 3 || count > end - at) return fail_stream();
      cell_points_.push_back(static_cast<std::uint32_t>(count));
      for (vtkIdType i = 0; i < count; ++i) SPLATVOL_TRY(append_point(cell, stream->GetValue(at++)));
    }
    return cell_points_.empty() ? fail_stream() : Status{};
  }

  Status append_point(vtkIdType cell, vtkIdType point) {
    if (point < 0 || point >= data_.GetNumberOfPoints())
      return fail(ErrorCode::invalid_data, "{}: cell {} names point {} of {}", path_, cell, point,
                  data_.GetNumberOfPoints());
    cell_points_.push_back(static_cast<std::uint32_t>(point));
    return {};
  }

  template <class Visit>
  void for_each_point(const CellKind& kind, const Visit& visit) const {
    if (kind.role != CellRole::polyhedron) std::ranges::for_each(cell_points_, visit);
    if (kind.role != CellRole::polyhedron) return;
    for (std::size_t at = 0; at < cell_points_.size(); at += cell_points_[at] + 1)
      std::ranges::for_each(std::span(cell_points_).subspan(at + 1, cell_points_[at]), visit);
  }

  [[nodiscard]] bool is_hidden(vtkIdType cell, const CellKind& kind) const {
    constexpr int skipped = vtkDataSetAttributes::DUPLICATECELL | vtkDataSetAttributes::HIDDENCELL;
    if (cell_ghosts_ && cell_ghosts_->GetValue(cell) & skipped) return true;
    if (!point_ghosts_) return false;
    bool hidden = false;
    for_each_point(kind, [&](std::uint32_t point) {
      hidden = hidden || (point_ghosts_->GetValue(point) & vtkDataSetAttributes::HIDDENPOINT);
    });
    return hidden;
  }

  void mark_points(const CellKind& kind, Use use) {
    for_each_point(kind, [&](std::uint32_t point) { use_[point] = std::max(use_[point], use); });
  }

  /// A point of a visible cell stays; a point that only hidden cells use goes. A point of no cell stays unless it is a
  /// ghost copy or hidden itself.
  [[nodiscard]] bool keeps_point(std::size_t point) const {
    if (use_[point] != unused) return use_[point] == by_visible_cells;
    constexpr int skipped = vtkDataSetAttributes::DUPLICATEPOINT | vtkDataSetAttributes::HIDDENPOINT;
    return !point_ghosts_ || !(point_ghosts_->GetValue(static_cast<vtkIdType>(point)) & skipped);
  }

  void drop_points() {
    std::vector<std::uint32_t> new_index(use_.size());
    for (std::size_t i = 0; i < use_.size(); ++i) {
      if (!keeps_point(i)) continue;
      new_index[i] = static_cast<std::uint32_t>(kept_.size());
      kept_.push_back(static_cast<std::uint32_t>(i));
    }
    if (kept_.size() == use_.size()) return;
    piece_->census.hidden_points += use_.size() - kept_.size();
    for (std::size_t i = 0; i < kept_.size(); ++i) piece_->points[i] = piece_->points[kept_[i]];
    piece_->points.resize(kept_.size());
    for (auto& tetrahedron : piece_->tetrahedra)
      for (std::uint32_t& point : tetrahedron) point = new_index[point];
  }

  void prepare_lending() {
    if (lends_) lent_ = std::make_shared<LentArrays>(missing_, kept_);
  }

  /// Lends an attribute that is not converted.
  void lend(const VtkAttribute& attribute, const VtkValues& values) {
    lent_->add(*values.array, attribute.component);
    piece_->fills.push_back(lent_->fills());
  }

  void add_values(std::vector<double> values) {
    if (lent_)
      lent_->add(std::move(values));
    else
      piece_->values.push_back(std::move(values));
  }

  /// Reads the values of the points that are kept. Arrays of cells are averaged.
  void read_values_of_points() {
    std::optional<CellAverages> averages;
    if (averages_) averages.emplace(data_, std::move(volumes_));
    const std::vector<std::uint32_t> all = averages_ ? first_indices(data_.GetNumberOfCells()) : kept_;
    for (std::size_t a = 0; a < attributes_.size(); ++a) {
      const VtkValues& values = arrays_[a];
      if (lent_ && !values.of_cells) {
        lend(attributes_[a], values);
        continue;
      }
      piece_->fills.push_back(0);
      add_values(attribute_values(attributes_[a], [&](int component) {
        if (!values.of_cells) return read_component(values, component, kept_);
        std::vector<double> means = averages->means(read_component(values, component, all));
        if (change_means_) change_means_(attributes_[a].array, component, means);
        std::vector<double> of_kept(kept_.size());
        std::ranges::transform(kept_, of_kept.begin(), [&](std::uint32_t point) { return means[point]; });
        return of_kept;
      }));
    }
  }

  /// Reads a component of the current attribute. The missing ones are NaN; the fill values among them are counted. The
  /// components of a vector mostly lack the same ones, so the largest of their counts is that of the vector.
  std::vector<double> read_component(const VtkValues& values, int component, std::span<const std::uint32_t> indices) {
    std::vector<double> read = component_values(*values.array, component, indices);
    std::uint64_t& fills = piece_->fills.back();
    fills = std::max(fills, missing_.replace(read));
    return read;
  }

  static std::vector<std::uint32_t> first_indices(vtkIdType count) {
    std::vector<std::uint32_t> indices(static_cast<std::size_t>(count));
    std::iota(indices.begin(), indices.end(), 0u);
    return indices;
  }

  /// Makes each cell with a volume a point at its centroid. Requires the tetrahedra of all cells.
  void use_cells_as_points() {
    PointCells& cells = piece_->cells.emplace();
    cells.corners = std::move(piece_->points);
    cells.tetrahedra = std::move(piece_->tetrahedra);
    cells.points.assign(cells.tetrahedra.size(), PointCells::no_point);
    piece_->points.clear();
    piece_->tetrahedra.clear();
    begins_.push_back(cells.tetrahedra.size());
    for (std::size_t cell = 0; cell + 1 < begins_.size(); ++cell) {
      const auto tetrahedra = tetrahedra_of(cell);
      const CellMoments moments = cell_moments(cells.corners, tetrahedra);
      if (!(moments.moments.mass > 0)) {
        piece_->census.left_out_flat += tetrahedra.empty() ? 0 : 1;
        continue;
      }
      std::fill_n(cells.points.begin() + static_cast<std::ptrdiff_t>(begins_[cell]), tetrahedra.size(),
                  static_cast<std::uint32_t>(kept_.size()));
      kept_.push_back(static_cast<std::uint32_t>(cell));
      piece_->points.push_back(moments.centroid);
      cells.moments.push_back(moments.moments);
    }
  }

  [[nodiscard]] std::span<const Tetrahedron> tetrahedra_of(std::size_t cell) const {
    return std::span(piece_->cells->tetrahedra).subspan(begins_[cell], begins_[cell + 1] - begins_[cell]);
  }

  /// Reads the values of the cells that are kept. Arrays of points become means over the cells.
  void read_values_of_cells() {
    const std::vector<std::uint32_t> all = first_indices(data_.GetNumberOfPoints());
    for (std::size_t a = 0; a < attributes_.size(); ++a) {
      const VtkValues& values = arrays_[a];
      if (lent_ && values.of_cells) {
        lend(attributes_[a], values);
        continue;
      }
      piece_->fills.push_back(0);
      add_values(attribute_values(attributes_[a], [&](int component) {
        if (values.of_cells) return read_component(values, component, kept_);
        const std::vector<double> of_corners = read_component(values, component, all);
        std::vector<double> means(kept_.size());
        for (std::size_t i = 0; i < kept_.size(); ++i)
          means[i] = cell_mean(piece_->cells->corners, tetrahedra_of(kept_[i]), of_corners);
        return means;
      }));
    }
  }

  const std::string& path_;
  vtkDataSet& data_;
  std::span<const VtkAttribute> attributes_;
  bool own_cells_;
  const MissingValues& missing_;
  const ChangeMeans& change_means_;
  bool lends_;                           // values
  vtkUnstructuredGrid* grid_ = nullptr;  // data_, if it is one
  vtkUnsignedCharArray* cell_ghosts_ = nullptr;
  vtkUnsignedCharArray* point_ghosts_ = nullptr;

  std::unique_ptr<Piece> piece_ = std::make_unique<Piece>();
  std::shared_ptr<LentArrays> lent_;        // null: values are copied
  std::vector<Use> use_;                    // of each point
  std::vector<std::uint32_t> kept_;         // points that stay; or cells that are points
  std::vector<VtkValues> arrays_;           // [attribute]
  bool averages_ = false;                   // arrays of the cells to the points
  std::vector<double> volumes_;             // [cell], as CellAverages takes them; only if it averages
  std::vector<std::size_t> begins_;         // [cell that is a point]: its tetrahedra
  std::vector<std::uint32_t> cell_points_;  // of the current cell
  vtkNew<vtkIdList> id_list_;
  const CellKind* last_kind_ = nullptr;
  std::uint64_t* kind_count_ = nullptr;
  std::map<std::pair<int, std::size_t>, std::optional<std::vector<std::uint32_t>>> lattice_cells_;
};

}  // namespace

Result<std::unique_ptr<Piece>> make_piece(const std::string& path, vtkDataSet& data,
                                          std::span<const VtkAttribute> attributes, CellValues cells,
                                          const MissingValues& missing, const ChangeMeans& change_means, bool lend) {
  Result<std::unique_ptr<Piece>> piece;
  const auto make = [&] { piece = PieceMaker(path, data, attributes, cells, missing, change_means, lend).make(); };
  SPLATVOL_TRY(run_vtk(path, make));
  return piece;
}

Result<CellAverages> make_averages(const std::string& path, vtkDataSet& data) {
  std::optional<Result<CellAverages>> averages;
  SPLATVOL_TRY(run_vtk(
      path, [&] { averages = PieceMaker(path, data, {}, CellValues::averaged, {}, {}, false).make_averages(); }));
  return std::move(*averages);
}

}  // namespace splatvol
