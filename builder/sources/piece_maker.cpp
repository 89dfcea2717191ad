#include "builder/sources/piece_maker.h"

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "builder/mesh/cell_kinds.h"
#include "builder/mesh/cell_moments.h"
#include "builder/mesh/lattice.h"
#include "builder/mesh/tetrahedra.h"
#include "builder/sources/far_points.h"
#include "builder/sources/lent_arrays.h"

namespace splatvol {
namespace {

/// Divides a cell of `count` points into linear cells; empty if the points form no full lattice.
std::optional<std::vector<std::uint32_t>> linear_cells(const DataSet& data, const CellKind& kind, std::size_t count) {
  constexpr int quadratic_linear_wedge = 31;
  const bool linear_axis = kind.vtk_type == quadratic_linear_wedge;
  const auto order = lattice_order(kind.shape, linear_axis, count);
  if (!order) return std::nullopt;
  return divide_lattice(kind.shape, *order, linear_axis ? 1 : *order, data.parametric_points(kind.vtk_type, count));
}

class CellVolumes final : public NumberArray {
 public:
  [[nodiscard]] int components() const override { return 1; }
  [[nodiscard]] std::uint64_t size() const override { return volumes.size(); }
  void read(int /*component*/, std::span<const std::uint32_t> elements, std::span<double> values) const override {
    std::ranges::transform(elements, values.begin(), [&](std::uint32_t cell) { return volumes[cell]; });
  }

  std::vector<double> volumes;
};

/// Stands for an array that a data set does not have.
class NoArray final : public NumberArray {
 public:
  explicit NoArray(int components) : components_(components) {}
  [[nodiscard]] int components() const override { return components_; }
  [[nodiscard]] std::uint64_t size() const override { return 0; }
  void read(int /*component*/, std::span<const std::uint32_t> /*elements*/, std::span<double> values) const override {
    std::ranges::fill(values, missing_value);
  }

 private:
  int components_;
};

/// Makes one piece of one data set.
class PieceMaker {
 public:
  PieceMaker(const std::string& name, const DataSet& data, std::span<const ArrayAttribute> attributes, CellValues cells,
             const MissingValues& missing, bool lend, bool whole_cells)
      : name_(name),
        data_(data),
        attributes_(attributes),
        own_cells_(cells == CellValues::own),
        missing_(missing),
        lends_(lend),
        whole_cells_(whole_cells) {}

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
    // The cells of a grid are inverted if they turn the other way than most of them.
    CellCensus& census = piece_->census;
    if (data_.is_structured() && census.inverted > census.upright) std::swap(census.inverted, census.upright);
    return std::move(piece_);
  }

  Result<CellAverages> make_averages() {
    SPLATVOL_TRY(read_points());
    averages_ = true;
    SPLATVOL_TRY(find_arrays());
    SPLATVOL_TRY(read_cells());
    return averages();
  }

 private:
  enum Use : std::uint8_t { unused, by_hidden_cells, by_visible_cells };
  static constexpr std::uint64_t cells_ahead = 8;  // whose points are fetched before their turn

  Status read_points() {
    const std::uint64_t count = data_.point_count();
    if (count > std::numeric_limits<std::uint32_t>::max())
      return fail(ErrorCode::unsupported, "{}: a piece of {} points; at most 2^32 - 1 are supported", name_, count);
    piece_->points.resize(count);
    data_.read_points(piece_->points);
    drop_far_points(piece_->points);
    use_.assign(piece_->points.size(), unused);
    return read_ghosts();
  }

  Status read_ghosts() {
    cell_ghosts_ = data_.cell_ghosts();
    point_ghosts_ = data_.point_ghosts();
    if (!cell_ghosts_.empty() && cell_ghosts_.size() < data_.cell_count())
      return fail(ErrorCode::invalid_data, "{}: its cells' ghost array is too short", name_);
    if (!point_ghosts_.empty() && point_ghosts_.size() < data_.point_count())
      return fail(ErrorCode::invalid_data, "{}: its points' ghost array is too short", name_);
    return {};
  }

  /// Finds the array of each attribute, and whether the volumes of the cells are needed.
  Status find_arrays() {
    for (const ArrayAttribute& attribute : attributes_) {
      SPLATVOL_TRY_ASSIGN(found, find_array(attribute));
      averages_ = averages_ || (found.of_cells && !own_cells_);
      arrays_.push_back(std::move(found));
    }
    if (averages_ || cell_volumes_) volumes_.resize(data_.cell_count());
    if (own_cells_ && data_.cell_count() >= PointCells::no_point)
      return fail(ErrorCode::unsupported, "{}: a piece of {} cells; at most 2^32 - 2 are supported", name_,
                  data_.cell_count());
    return {};
  }

  Result<FoundArray> find_array(const ArrayAttribute& attribute) {
    if (attribute.is_volume) {
      cell_volumes_ = std::make_shared<CellVolumes>();
      return FoundArray{cell_volumes_, true};
    }
    SPLATVOL_TRY_ASSIGN(found, splatvol::find_array(name_, data_, attribute));
    // Missing values are the same of points and of cells: nothing needs to be averaged.
    return found.array ? found : FoundArray{std::make_shared<NoArray>(attribute.components), own_cells_};
  }

  Status read_cells() {
    if (cell_volumes_) cell_volumes_->volumes.resize(data_.cell_count());
    if (const auto flat = data_.flat_cells()) {
      for (const DataSet::FlatCells& cells : *flat) count_flat(cells);  // their points need no check
      return {};
    }
    SPLATVOL_TRY(data_.check_cells(name_));
    TetrahedronSplitter splitter(piece_->points, piece_->tetrahedra, piece_->census);
    if (whole_cells_) splitter.list_whole_cells(piece_->whole_cells);
    piece_->tetrahedra.reserve(data_.cell_count());
    for (std::uint64_t cell = 0; cell < data_.cell_count(); ++cell) {
      const std::size_t first = piece_->tetrahedra.size();
      fetch_points(cell + cells_ahead);
      SPLATVOL_TRY(read_cell(cell, splitter));
      if (own_cells_) begins_.push_back(first);
      if (!volumes_.empty()) volumes_[cell] += volume_of(piece_->tetrahedra, first);
    }
    if (cell_volumes_) cell_volumes_->volumes = volumes_;
    return {};
  }

  /// Brings the positions of a cell's points into the cache: they lie anywhere.
  void fetch_points(std::uint64_t cell) {
    if (cell >= data_.cell_count()) return;
    ids_.clear();
    data_.append_points(cell, ids_);
    for (const std::int64_t point : ids_)
      if (point >= 0 && static_cast<std::uint64_t>(point) < piece_->points.size())
        __builtin_prefetch(&piece_->points[static_cast<std::size_t>(point)]);
  }

  [[nodiscard]] double volume_of(std::span<const Tetrahedron> tetrahedra, std::size_t first) const {
    double volume = 0;
    for (const Tetrahedron& corners : tetrahedra.subspan(first)) volume += tetrahedron_volume(piece_->points, corners);
    return volume;
  }

  void count_flat(const DataSet::FlatCells& cells) {
    if (cells.count == 0) return;
    piece_->census.cells[std::string(cells.name)] += cells.count;
    count_without_volume(cells.dimension, cells.count);
  }

  void count_without_volume(int dimension, std::uint64_t count) {
    CellCensus& census = piece_->census;
    census.without_volume += count;
    if (dimension == 1) census.lines += count;
    if (dimension == 2) census.surfaces += count;
  }

  Status read_cell(std::uint64_t cell, TetrahedronSplitter& splitter) {
    const int type = data_.cell_type(cell);
    const CellKind* kind = last_kind_ && last_kind_->vtk_type == type ? last_kind_ : find_cell_kind(type);
    if (!kind) return fail(ErrorCode::unsupported, "{}: cells of VTK type {} are not supported", name_, type);
    SPLATVOL_TRY(load_points(cell, *kind));

    CellCensus& census = piece_->census;
    constexpr int empty_cell = 0;
    const bool hidden = is_hidden(cell, *kind) || (data_.is_structured() && type == empty_cell);
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

  Status split_cell(std::uint64_t cell, const CellKind& kind, TetrahedronSplitter& splitter) {
    if (kind.role == CellRole::polyhedron) splitter.split_polyhedron(cell_points_);
    if (kind.role == CellRole::shape) return split_shape(kind, splitter);
    if (kind.role == CellRole::lattice) return split_lattice(cell, kind, splitter);
    return {};
  }

  /// A ghost copy counts in the means at its points, so that they are the same in all pieces. Other hidden cells do not
  /// count.
  Status weigh_hidden(std::uint64_t cell, const CellKind& kind) {
    if (!averages_) return {};
    double& volume = volumes_[cell];
    volume = -1;
    const std::uint8_t flags = cell_ghosts_.empty() ? 0 : cell_ghosts_[cell];
    if ((flags & ghost::left_out_cell) != ghost::duplicate) return {};
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
      return fail(ErrorCode::invalid_data, "{}: a {} of {} points instead of {}", name_, kind.name, cell_points_.size(),
                  expected);
    piece_->census.more_nodes += more_nodes ? 1 : 0;
    splitter.split(kind.shape, std::span(cell_points_).first(expected));
    return {};
  }

  Status split_lattice(std::uint64_t cell, const CellKind& kind, TetrahedronSplitter& splitter) {
    auto& cells = lattice_cells_[{kind.vtk_type, cell_points_.size()}];
    if (!cells) cells = linear_cells(data_, kind, cell_points_.size());
    if (!cells || !data_.has_one_degree(cell))
      return fail(ErrorCode::unsupported, "{}: a {} of {} points, which is not of one order in all directions", name_,
                  kind.name, cell_points_.size());
    const std::size_t stride = node_count(kind.shape);
    std::array<std::uint32_t, 8> linear{};
    for (std::size_t first = 0; first < cells->size(); first += stride) {
      for (std::size_t i = 0; i < stride; ++i) linear[i] = cell_points_[(*cells)[first + i]];
      splitter.split(kind.shape, std::span(linear).first(stride));
    }
    return {};
  }

  /// Sets cell_points_ to a cell's points, or to a polyhedron's faces as "count, points, count, points, ...".
  Status load_points(std::uint64_t cell, const CellKind& kind) {
    cell_points_.clear();
    if (kind.role == CellRole::polyhedron) return load_faces(cell);
    ids_.clear();
    data_.append_points(cell, ids_);
    for (const std::int64_t point : ids_) SPLATVOL_TRY(append_point(cell, point));
    return {};
  }

  Status load_faces(std::uint64_t cell) {
    const auto fail_stream = [&] {
      return fail(ErrorCode::invalid_data, "{}: the faces of polyhedron {} are missing or damaged", name_, cell);
    };
    const std::int64_t end = data_.face_stream_length();
    std::int64_t at = data_.face_location(cell);
    if (at < 0 || at >= end) return fail_stream();
    for (std::int64_t faces = data_.face_number(at++); faces > 0; --faces) {
      if (at >= end) return fail_stream();
      const std::int64_t count = data_.face_number(at++);
      if (count < 3 || count > end - at) return fail_stream();
      cell_points_.push_back(static_cast<std::uint32_t>(count));
      for (std::int64_t i = 0; i < count; ++i) SPLATVOL_TRY(append_point(cell, data_.face_number(at++)));
    }
    return cell_points_.empty() ? fail_stream() : Status{};
  }

  Status append_point(std::uint64_t cell, std::int64_t point) {
    if (point < 0 || static_cast<std::uint64_t>(point) >= data_.point_count())
      return fail(ErrorCode::invalid_data, "{}: cell {} names point {} of {}", name_, cell, point, data_.point_count());
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

  [[nodiscard]] bool is_hidden(std::uint64_t cell, const CellKind& kind) const {
    if (!cell_ghosts_.empty() && (cell_ghosts_[cell] & ghost::left_out_cell) != 0) return true;
    if (point_ghosts_.empty()) return false;
    bool hidden = false;
    for_each_point(kind,
                   [&](std::uint32_t point) { hidden = hidden || (point_ghosts_[point] & ghost::hidden_point) != 0; });
    return hidden;
  }

  void mark_points(const CellKind& kind, Use use) {
    for_each_point(kind, [&](std::uint32_t point) { use_[point] = std::max(use_[point], use); });
  }

  /// A point of a visible cell stays; a point that only hidden cells use goes. A point of no cell stays unless it is a
  /// ghost copy or hidden itself.
  [[nodiscard]] bool keeps_point(std::size_t point) const {
    if (use_[point] != unused) return use_[point] == by_visible_cells;
    return point_ghosts_.empty() || (point_ghosts_[point] & (ghost::duplicate | ghost::hidden_point)) == 0;
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
    for (WholeCell& cell : piece_->whole_cells)
      for (std::uint32_t& point : std::span(cell.corners).first(format::corners_of(cell.shape)))
        point = new_index[point];
  }

  void prepare_lending() {
    if (lends_) lent_ = std::make_shared<LentArrays>(missing_, kept_);
  }

  /// Lends an attribute that is not converted.
  void lend(const ArrayAttribute& attribute, const FoundArray& found) {
    lent_->add(found.array, attribute.component);
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
    if (averages_) averages.emplace(this->averages());
    const std::vector<std::uint32_t> all = averages_ ? first_indices(data_.cell_count()) : kept_;
    for (std::size_t a = 0; a < attributes_.size(); ++a) {
      const FoundArray& found = arrays_[a];
      if (lent_ && !found.of_cells) {
        lend(attributes_[a], found);
        continue;
      }
      piece_->fills.push_back(0);
      add_values(attribute_values(attributes_[a], [&](int component) {
        if (!found.of_cells) return read_component(found, component, kept_);
        std::vector<double> means = averages->means(read_component(found, component, all));
        data_.share_means(attributes_[a].array, component, means);
        std::vector<double> of_kept(kept_.size());
        std::ranges::transform(kept_, of_kept.begin(), [&](std::uint32_t point) { return means[point]; });
        return of_kept;
      }));
    }
  }

  /// Reads a component of the current attribute. The missing ones are NaN; the fill values among them are counted. The
  /// components of a vector mostly lack the same ones, so the largest of their counts is that of the vector.
  std::vector<double> read_component(const FoundArray& found, int component, std::span<const std::uint32_t> indices) {
    std::vector<double> read(indices.size());
    found.array->read(component, indices, read);
    std::uint64_t& fills = piece_->fills.back();
    fills = std::max(fills, missing_.replace(read));
    return read;
  }

  CellAverages averages() {
    return {data_.point_count(), std::move(volumes_),
            [this](std::size_t cell, std::vector<std::int64_t>& points) { data_.append_points(cell, points); }};
  }

  static std::vector<std::uint32_t> first_indices(std::uint64_t count) {
    std::vector<std::uint32_t> indices(count);
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
    const std::vector<std::uint32_t> all = first_indices(data_.point_count());
    for (std::size_t a = 0; a < attributes_.size(); ++a) {
      const FoundArray& found = arrays_[a];
      if (lent_ && found.of_cells) {
        lend(attributes_[a], found);
        continue;
      }
      piece_->fills.push_back(0);
      add_values(attribute_values(attributes_[a], [&](int component) {
        if (found.of_cells) return read_component(found, component, kept_);
        const std::vector<double> of_corners = read_component(found, component, all);
        std::vector<double> means(kept_.size());
        for (std::size_t i = 0; i < kept_.size(); ++i)
          means[i] = cell_mean(piece_->cells->corners, tetrahedra_of(kept_[i]), of_corners);
        return means;
      }));
    }
  }

  const std::string& name_;
  const DataSet& data_;
  std::span<const ArrayAttribute> attributes_;
  bool own_cells_;
  const MissingValues& missing_;
  bool lends_;  // values
  bool whole_cells_;
  std::span<const std::uint8_t> cell_ghosts_;
  std::span<const std::uint8_t> point_ghosts_;

  std::unique_ptr<Piece> piece_ = std::make_unique<Piece>();
  std::shared_ptr<LentArrays> lent_;           // null: values are copied
  std::vector<Use> use_;                       // of each point
  std::vector<std::uint32_t> kept_;            // points that stay; or cells that are points
  std::vector<FoundArray> arrays_;             // [attribute]
  bool averages_ = false;                      // arrays of the cells to the points
  std::vector<double> volumes_;                // [cell], as CellAverages takes them; only if they are needed
  std::shared_ptr<CellVolumes> cell_volumes_;  // null: no attribute has them
  std::vector<std::size_t> begins_;            // [cell that is a point]: its tetrahedra
  std::vector<std::uint32_t> cell_points_;     // of the current cell
  std::vector<std::int64_t> ids_;              // the same, as they come
  const CellKind* last_kind_ = nullptr;
  std::uint64_t* kind_count_ = nullptr;
  std::map<std::pair<int, std::size_t>, std::optional<std::vector<std::uint32_t>>> lattice_cells_;
};

}  // namespace

Result<std::unique_ptr<Piece>> make_piece(const std::string& name, const DataSet& data,
                                          std::span<const ArrayAttribute> attributes, CellValues cells,
                                          const MissingValues& missing, bool lend, bool whole_cells) {
  return PieceMaker(name, data, attributes, cells, missing, lend, whole_cells).make();
}

Result<CellAverages> make_averages(const std::string& name, const DataSet& data) {
  return PieceMaker(name, data, {}, CellValues::averaged, {}, false, false).make_averages();
}

}  // namespace splatvol
