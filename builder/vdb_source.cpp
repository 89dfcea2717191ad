#include "builder/vdb_source.h"

#include <fmt/ranges.h>
#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/util/logging.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <utility>

#include "base/file.h"
#include "base/names.h"
#include "base/vdb_share.h"
#include "builder/piece_ahead.h"
#include "builder/vdb_header.h"

namespace splatvol {
namespace {

using openvdb::Coord;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double missing = std::numeric_limits<double>::quiet_NaN();
constexpr int magnitude = -1;

using TopologyAccessor = openvdb::tree::ValueAccessor<const openvdb::MaskTree, false>;

constexpr int leaf_edge = 8;
constexpr std::size_t leaf_voxels = std::size_t{1} << 9;

/// Runs `work` where nothing that OpenVDB throws gets out.
template <class Work>
auto contain(const std::string& path, const Work& work) -> decltype(work()) {
  try {
    return work();
  } catch (const std::bad_alloc&) {
    return fail(ErrorCode::out_of_budget, "{}: not enough memory for its grids", path);
  } catch (const std::exception& error) {
    constexpr std::size_t longest = 200;  // names in it come from the file
    return fail(ErrorCode::invalid_data, "{}: {}", path, std::string(error.what()).substr(0, longest));
  }
}

/// A grid's values, whatever it holds. Thread-safe.
class Field {
 public:
  virtual ~Field() = default;
  virtual void add_topology(openvdb::MaskTree& topology) const = 0;

  /// values[i]: at places[i], of a component, or the magnitude; NaN where the grid is not active, or single precision
  /// cannot hold it.
  virtual void sample(std::span<const Coord> places, int component, std::span<double> values) const = 0;
};

template <class Grid>
class GridField final : public Field {
 public:
  explicit GridField(typename Grid::ConstPtr grid) : grid_(std::move(grid)) {}

  void add_topology(openvdb::MaskTree& topology) const override { topology.topologyUnion(grid_->tree()); }

  void sample(std::span<const Coord> places, int component, std::span<double> values) const override {
    const auto accessor = grid_->getConstUnsafeAccessor();
    for (std::size_t i = 0; i < places.size(); ++i) {
      typename Grid::ValueType stored;
      const double value = accessor.probeValue(places[i], stored) ? number(stored, component) : missing;
      values[i] = std::abs(value) <= std::numeric_limits<float>::max() ? value : missing;
    }
  }

 private:
  template <class T>
  static double number(const T& stored, int component) {
    if constexpr (openvdb::VecTraits<T>::IsVec) {
      if (component != magnitude) return static_cast<double>(stored[component]);
      return std::hypot(static_cast<double>(stored[0]), static_cast<double>(stored[1]), static_cast<double>(stored[2]));
    } else {
      return static_cast<double>(stored);
    }
  }

  typename Grid::ConstPtr grid_;
};

/// Calls visit.operator()<Grid>() with the type of a grid of numbers; false where it is none.
template <class Visit>
bool visit_type(const openvdb::GridBase& grid, const Visit& visit) {
  const auto try_type = [&]<class Grid>() {
    if (!grid.isType<Grid>()) return false;
    visit.template operator()<Grid>();
    return true;
  };
  return try_type.template operator()<openvdb::FloatGrid>() || try_type.template operator()<openvdb::DoubleGrid>() ||
         try_type.template operator()<openvdb::Int32Grid>() || try_type.template operator()<openvdb::Int64Grid>() ||
         try_type.template operator()<openvdb::Vec3SGrid>() || try_type.template operator()<openvdb::Vec3DGrid>() ||
         try_type.template operator()<openvdb::Vec3IGrid>();
}

/// A scalar of the file's grids.
struct Channel {
  std::string name;
  std::size_t grid;  // its number in the file
  int component = 0;
};

/// From indices to the world: place = edges * index + origin.
struct Placement {
  dmat3 edges{1};  // of a voxel, as columns
  dvec3 origin{0};

  [[nodiscard]] dvec3 place(const dvec3& index) const {
    return {edges[0].x * index.x + edges[1].x * index.y + edges[2].x * index.z + origin.x,
            edges[0].y * index.x + edges[1].y * index.y + edges[2].y * index.z + origin.y,
            edges[0].z * index.x + edges[1].z * index.y + edges[2].z * index.z + origin.z};
  }

  /// Up to what rounding makes of different ways to say the same.
  [[nodiscard]] bool same_as(const Placement& other) const {
    const auto far_apart = [](const dvec3& a, const dvec3& b, double scale) {
      return !(glm::length(a - b) <= 1e-6 * scale);
    };
    const double edge = glm::length(edges[0]) + glm::length(edges[1]) + glm::length(edges[2]);
    for (int k = 0; k < 3; ++k)
      if (far_apart(edges[k], other.edges[k], edge)) return false;
    return !far_apart(origin, other.origin, edge);
  }
};

Result<Placement> placement_of(const std::string& path, const std::string& name, const openvdb::GridBase& grid) {
  const openvdb::math::Transform& transform = grid.transform();
  if (!transform.isLinear())
    return fail(ErrorCode::unsupported, "{}: the transform of grid \"{}\" ({}) is not linear, which is not supported",
                path, name, transform.mapType());
  const openvdb::Mat4R matrix = transform.baseMap()->getAffineMap()->getMat4();  // of rows: index * matrix
  Placement placement;
  const auto row = [&](int r) { return dvec3(matrix[r][0], matrix[r][1], matrix[r][2]); };
  placement.edges = dmat3(row(0), row(1), row(2));
  placement.origin = row(3);
  const double volume = std::abs(glm::determinant(placement.edges));
  if (!(volume > 0) || !std::isfinite(volume + glm::dot(placement.origin, dvec3(1))))
    return fail(ErrorCode::invalid_data, "{}: the transform of grid \"{}\" gives its voxels no volume", path, name);
  return placement;
}

/// A leaf's active voxels, or a tile.
struct Region {
  Coord origin;
  int edge = 1;                                           // of a point's box, in voxels
  const openvdb::MaskTree::LeafNodeType* leaf = nullptr;  // null: a tile
  std::uint32_t points = 1;
};

/// The place of a point, from the origin of its region, and those beside it: [axis][side].
struct Stencil {
  std::size_t own;
  std::array<std::array<std::size_t, 2>, 3> beside;
};

/// The places of a region where values are asked for, and how the points' stencils lie in them.
struct Places {
  std::vector<Coord> offsets;
  std::vector<Stencil> stencils;  // [voxel of a leaf], or of the tile
};

/// A leaf's voxels in the order of its mask, and the layer round them, but for its edges.
Places leaf_places() {
  Places places;
  std::array<std::array<std::array<std::size_t, leaf_edge + 2>, leaf_edge + 2>, leaf_edge + 2> numbers{};
  const auto add = [&](int x, int y, int z) {
    const auto at = [](int i) { return static_cast<std::size_t>(i + 1); };
    numbers[at(x)][at(y)][at(z)] = places.offsets.size();
    places.offsets.emplace_back(x, y, z);
  };
  for (std::size_t voxel = 0; voxel < leaf_voxels; ++voxel) {
    const Coord offset = openvdb::MaskTree::LeafNodeType::offsetToLocalCoord(static_cast<openvdb::Index>(voxel));
    add(offset.x(), offset.y(), offset.z());
  }
  for (const int side : {-1, leaf_edge})
    for (int i = 0; i < leaf_edge; ++i)
      for (int j = 0; j < leaf_edge; ++j) add(side, i, j), add(i, side, j), add(i, j, side);
  for (std::size_t voxel = 0; voxel < leaf_voxels; ++voxel) {
    const Coord& at = places.offsets[voxel];
    Stencil stencil{voxel, {}};
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        std::array<std::size_t, 3> beside{};
        for (int k = 0; k < 3; ++k)
          beside[static_cast<std::size_t>(k)] = static_cast<std::size_t>(at[k] + 1 + (k == axis ? 2 * side - 1 : 0));
        stencil.beside[static_cast<std::size_t>(axis)][static_cast<std::size_t>(side)] =
            numbers[beside[0]][beside[1]][beside[2]];
      }
    places.stencils.push_back(stencil);
  }
  return places;
}

/// A tile's middle, and what lies beside the middles of its faces.
Places tile_places(int edge) {
  Places places;
  places.offsets.emplace_back(edge / 2, edge / 2, edge / 2);
  Stencil stencil{0, {}};
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side) {
      stencil.beside[static_cast<std::size_t>(axis)][static_cast<std::size_t>(side)] = places.offsets.size();
      Coord offset = places.offsets[0];
      offset[axis] = side == 0 ? -1 : edge;
      places.offsets.push_back(offset);
    }
  places.stencils.push_back(stencil);
  return places;
}

/// A linear field within a box of indices.
struct Line {
  dvec3 slope{0};  // for each index
  double min = missing, max = missing;
};

/// `distance`: from the point to those beside it, in indices.
Line fit_line(const Stencil& stencil, std::span<const double> values, double edge) {
  const double own = values[stencil.own], distance = (edge + 1) / 2;
  Line line{dvec3(0), own, own};
  double reach = 0, low = own, high = own;
  for (int axis = 0; axis < 3; ++axis) {
    const auto& [below, above] = stencil.beside[static_cast<std::size_t>(axis)];
    const double down = own - values[below], up = values[above] - own;
    const double rise = std::isnan(down) ? up : std::isnan(up) ? down : (down + up) / 2;
    if (std::isnan(rise)) continue;
    line.slope[axis] = rise / distance;
    reach += std::abs(line.slope[axis]) * edge / 2;
    for (const double value : {values[below], values[above]})
      low = std::fmin(low, value), high = std::fmax(high, value);
  }
  line.min = std::max(low, own - reach);
  line.max = std::min(high, own + reach);
  return line;
}

/// A file's grids, and its points.
class VdbFile {
 public:
  /// `selection`: names of channels, or empty for all.
  static Result<std::unique_ptr<VdbFile>> open(const std::string& path, const std::vector<std::string>& selection) {
    SPLATVOL_TRY_ASSIGN(bytes, open_file(path));
    SPLATVOL_TRY(check_vdb_header(*bytes));
    return contain(path, [&]() -> Result<std::unique_ptr<VdbFile>> {
      openvdb::initialize();
      openvdb::logging::setLevel(openvdb::logging::Level::Fatal);  // what is wrong comes as exceptions
      openvdb::logging::setLevel(openvdb::logging::Level::Fatal);  // what is wrong comes as exceptions
      auto file = std::make_unique<VdbFile>(path);
      SPLATVOL_TRY(file->read(selection));
      return file;
    });
  }

  explicit VdbFile(std::string path)
      : path_(std::move(path)), pieces_(0, [this](std::size_t piece) { return make_piece(piece); }) {}

  [[nodiscard]] const std::vector<Channel>& channels() const { return channels_; }
  [[nodiscard]] std::size_t piece_count() const { return pieces_.count(); }
  [[nodiscard]] std::uint64_t point_count() const { return points_; }
  [[nodiscard]] Result<std::unique_ptr<Piece>> next() { return pieces_.next(); }

  [[nodiscard]] Box bounds() const {
    std::vector<Box> boxes(regions_.size());
    tbb::parallel_for(std::size_t{0}, regions_.size(), [&](std::size_t r) {
      visit_points(regions_[r], [&](std::size_t, std::size_t, const dvec3& place) {
        if (std::isfinite(place.x + place.y + place.z)) boxes[r].include({place, place});
      });
    });
    Box all;
    for (const Box& box : boxes) all.include(box);
    return all;
  }

 private:
  Status read(const std::vector<std::string>& selection) {
    // A stream that throws at its end: OpenVDB does not look whether there was what it asked for.
    std::ifstream file(path_, std::ios::binary);
    file.exceptions(std::ios::failbit | std::ios::badbit | std::ios::eofbit);
    const openvdb::GridPtrVecPtr grids = openvdb::io::Stream(file, false).getGrids();
    SPLATVOL_TRY(choose_channels(*grids, selection));
    for (const Channel& channel : channels_) SPLATVOL_TRY(add_field(*grids, channel.grid));
    if (share_grid_) SPLATVOL_TRY(add_field(*grids, *share_grid_));
    list_regions();
    if (points_ == 0) return fail(ErrorCode::invalid_data, "{}: no active voxels", path_);
    return {};
  }

  Status choose_channels(const openvdb::GridPtrVec& grids, const std::vector<std::string>& selection) {
    std::vector<Channel> all;
    std::vector<std::string> others;
    std::map<std::string, int> seen;
    for (std::size_t g = 0; g < grids.size(); ++g) {
      std::string called = grids[g]->getName().empty() ? "value" : grids[g]->getName();
      if (const int number = seen[called]++; number > 0) called += fmt::format("[{}]", number);
      const bool numbers = visit_type(*grids[g], [&]<class Grid>() {
        all.push_back({called, g, 0});
        if constexpr (!openvdb::VecTraits<typename Grid::ValueType>::IsVec) return;
        all.back().component = magnitude;
        for (int c = 0; c < 3; ++c) all.push_back({fmt::format("{}[{}]", called, c), g, c});
      });
      if (!numbers) others.push_back(fmt::format("{} ({})", called, grids[g]->valueType()));
      if (numbers && grids[g]->getMetadata<openvdb::BoolMetadata>(vdb_share_metadata)) share_grid_ = g;
    }
    if (all.empty() && others.empty()) return fail(ErrorCode::invalid_data, "{}: no grids", path_);
    if (all.empty())
      return fail(ErrorCode::invalid_data, "{}: no grid of numbers; there are: {}", path_, fmt::join(others, ", "));
    std::vector<std::string> names;
    for (const Channel& channel : all) names.push_back(channel.name);
    if (const auto duplicate = find_duplicate(names))
      return fail(ErrorCode::invalid_data, "{}: two attributes are called \"{}\"", path_, *duplicate);
    if (selection.empty()) channels_ = all;
    for (const std::string& name : selection) {
      const auto channel = std::ranges::find(all, name, &Channel::name);
      if (channel == all.end()) return fail_no_attribute(path_, name, names);
      channels_.push_back(*channel);
    }
    return {};
  }

  Status add_field(const openvdb::GridPtrVec& grids, std::size_t number) {
    if (fields_.contains(number)) return {};
    const openvdb::GridBase::Ptr grid = grids[number];
    SPLATVOL_TRY_ASSIGN(placement, placement_of(path_, grid->getName(), *grid));
    if (!fields_.empty() && !placement.same_as(placement_))
      return fail(ErrorCode::unsupported,
                  "{}: the grids \"{}\" and \"{}\" have different transforms: build one of them (--attribute)", path_,
                  grids[fields_.begin()->first]->getName(), grid->getName());
    if (fields_.empty()) placement_ = placement;
    visit_type(*grid, [&]<class Grid>() {
      fields_[number] = std::make_unique<GridField<Grid>>(openvdb::gridConstPtrCast<Grid>(grid));
    });
    return {};
  }

  void list_regions() {
    for (const auto& [number, field] : fields_) field->add_topology(topology_);
    for (auto leaf = topology_.cbeginLeaf(); leaf; ++leaf) {
      const auto points = static_cast<std::uint32_t>(leaf->onVoxelCount());
      if (points > 0) regions_.push_back({leaf->origin(), 1, leaf.getLeaf(), points});
    }
    auto tile = topology_.cbeginValueOn();
    tile.setMaxDepth(openvdb::MaskTree::ValueOnCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile) {
      const openvdb::CoordBBox box = tile.getBoundingBox();
      regions_.push_back({box.min(), box.dim().x(), nullptr, 1});
      tiles_.try_emplace(box.dim().x(), tile_places(box.dim().x()));
    }
    std::vector<std::size_t>& begins = piece_begins_ = {0};
    std::uint64_t held = 0;
    for (std::size_t r = 0; r < regions_.size(); ++r) {
      if (held + regions_[r].points > max_piece_points) begins.push_back(r), held = 0;
      held += regions_[r].points;
      points_ += regions_[r].points;
    }
    begins.push_back(regions_.size());
    pieces_ = PieceAhead(begins.size() - 1, [this](std::size_t piece) { return make_piece(piece); });
  }

  /// Calls visit(number in the region, stencil, place) for each point.
  template <class Visit>
  void visit_points(const Region& region, const Visit& visit) const {
    const dvec3 corner(region.origin.x(), region.origin.y(), region.origin.z());
    if (region.leaf == nullptr) {
      visit(std::size_t{0}, std::size_t{0}, placement_.place(corner + 0.5 * (region.edge - 1)));
      return;
    }
    std::size_t number = 0;
    for (auto voxel = region.leaf->cbeginValueOn(); voxel; ++voxel) {
      const Coord offset = openvdb::MaskTree::LeafNodeType::offsetToLocalCoord(voxel.pos());
      visit(number++, std::size_t{voxel.pos()}, placement_.place(corner + dvec3(offset.x(), offset.y(), offset.z())));
    }
  }

  Result<std::unique_ptr<Piece>> make_piece(std::size_t number) const {
    return contain(path_, [&]() -> Result<std::unique_ptr<Piece>> {
      const std::size_t begin = piece_begins_[number], end = piece_begins_[number + 1];
      std::vector<std::size_t> firsts;
      std::size_t points = 0;
      auto piece = std::make_unique<Piece>();
      for (std::size_t r = begin; r < end; ++r) {
        firsts.push_back(points);
        points += regions_[r].points;
        piece->census.cells[regions_[r].leaf != nullptr ? "voxel" : "tile"] += regions_[r].points;
      }
      PointMaterial& material = piece->material.emplace();
      piece->points.resize(points);
      material.moments.resize(points);
      material.planes.resize(points);
      piece->values.assign(channels_.size(), std::vector<double>(points));
      material.value_moments.assign(channels_.size(), std::vector<ValueMoments>(points));
      material.gradients.assign(channels_.size(), std::vector<dvec3>(points));
      tbb::parallel_for(begin, end, [&](std::size_t r) { fill(regions_[r], firsts[r - begin], *piece); });
      return piece;
    });
  }

  void fill(const Region& region, std::size_t first, Piece& piece) const {
    static const Places of_leaf = leaf_places();
    const Places& places = region.leaf != nullptr ? of_leaf : tiles_.at(region.edge);
    std::vector<Coord> at;
    for (const Coord& offset : places.offsets) at.push_back(region.origin + offset);
    std::vector<double> values(at.size()), shares;
    if (share_grid_) {
      shares.resize(at.size());
      fields_.at(*share_grid_)->sample(at, 0, shares);
    }
    const TopologyAccessor active(topology_);
    const double edge = region.edge;
    const SpatialMoments box = box_moments(edge);
    visit_points(region, [&](std::size_t number, std::size_t voxel, const dvec3& place) {
      const Stencil& stencil = places.stencils[voxel];
      piece.points[first + number] = place;
      SpatialMoments& moments = piece.material->moments[first + number];
      moments = box;
      if (!shares.empty()) moments.mass *= std::fmax(0.0, shares[stencil.own]);
      piece.material->planes[first + number] = plane(stencil, at, active, edge);
    });
    const dmat3 to_gradient = glm::transpose(glm::inverse(placement_.edges));
    for (std::size_t c = 0; c < channels_.size(); ++c) {
      fields_.at(channels_[c].grid)->sample(at, channels_[c].component, values);
      visit_points(region, [&](std::size_t number, std::size_t voxel, const dvec3&) {
        const std::size_t i = first + number;
        const double value = piece.values[c][i] = values[places.stencils[voxel].own];
        const SpatialMoments& of_point = piece.material->moments[i];
        if (std::isnan(value) || !(of_point.mass > 0)) return;
        // In indices the box is a cube, with variance edge^2 / 12 along each axis.
        const Line line = fit_line(places.stencils[voxel], values, edge);
        piece.material->gradients[c][i] = to_gradient * line.slope;
        ValueMoments& moments = piece.material->value_moments[c][i];
        moments.mass = of_point.mass;
        moments.mean = value;
        moments.covariance = edge * edge / 12 * (placement_.edges * line.slope);
        moments.variance = edge * edge / 12 * glm::dot(line.slope, line.slope);
        moments.min = line.min;
        moments.max = line.max;
      });
    }
  }

  [[nodiscard]] SpatialMoments box_moments(double edge) const {
    const dmat3 s = edge * edge / 12 * placement_.edges * glm::transpose(placement_.edges);
    return {edge * edge * edge * std::abs(glm::determinant(placement_.edges)),
            dvec3(0),
            {s[0][0], s[1][1], s[2][2], s[1][0], s[2][0], s[2][1]}};
  }

  /// Of the faces beside which nothing is active.
  [[nodiscard]] BoundaryPlane plane(const Stencil& stencil, std::span<const Coord> at, const TopologyAccessor& active,
                                    double edge) const {
    std::vector<BoundaryPlane> faces;
    const dmat3 edges = edge * placement_.edges;
    const double volume = glm::determinant(edges);
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        if (active.isValueOn(at[stencil.beside[static_cast<std::size_t>(axis)][static_cast<std::size_t>(side)]]))
          continue;
        const dvec3 area = glm::cross(edges[(axis + 1) % 3], edges[(axis + 2) % 3]);
        faces.push_back({(side == 0) == (volume > 0) ? -area : area, std::abs(volume) / 2});
      }
    return faces.empty() ? BoundaryPlane{} : merge_planes(faces, std::vector<dvec3>(faces.size(), dvec3(0)));
  }

  std::string path_;
  std::vector<Channel> channels_;
  std::map<std::size_t, std::unique_ptr<Field>> fields_;  // of grids, by their number in the file
  std::optional<std::size_t> share_grid_;                 // the one that says how much of a box is material
  Placement placement_;
  openvdb::MaskTree topology_;  // the union of all
  std::vector<Region> regions_;
  std::map<int, Places> tiles_;            // by their edge
  std::vector<std::size_t> piece_begins_;  // regions; and their number
  std::uint64_t points_ = 0;
  PieceAhead pieces_;
};

class VdbSource final : public Source {
 public:
  VdbSource(std::vector<std::string> paths, std::unique_ptr<VdbFile> first) : paths_(std::move(paths)) {
    take(std::move(first));
    for (const Channel& channel : file_->channels()) attributes_.push_back(channel.name);
  }

  const std::vector<std::string>& attributes() const override { return attributes_; }
  std::size_t piece_count() const override { return opened_pieces_ + paths_.size() - opened_; }
  bool brings_material() const override { return true; }

  Result<std::unique_ptr<Piece>> next() override {
    for (;;) {
      SPLATVOL_TRY_ASSIGN(piece, file_->next());
      if (piece || opened_ == paths_.size()) return piece;
      file_.reset();  // before the next one takes its memory
      SPLATVOL_TRY_ASSIGN(file, VdbFile::open(paths_[opened_], attributes_));
      take(std::move(file));
    }
  }

  Result<std::optional<Box>> bounds() override {
    if (paths_.size() > 1) return std::optional<Box>();
    const Box box = file_->bounds();
    return box.low.x <= box.high.x ? std::optional(box) : std::nullopt;
  }

  std::optional<std::uint64_t> point_count() const override {
    return paths_.size() == 1 ? std::optional(file_->point_count()) : std::nullopt;
  }

 private:
  void take(std::unique_ptr<VdbFile> file) {
    file_ = std::move(file);
    opened_pieces_ += file_->piece_count();
    ++opened_;
  }

  std::vector<std::string> paths_;
  std::vector<std::string> attributes_;
  std::unique_ptr<VdbFile> file_;
  std::size_t opened_ = 0;         // paths
  std::size_t opened_pieces_ = 0;  // of these
};

}  // namespace

Result<std::unique_ptr<Source>> open_vdb_files(const std::vector<std::string>& paths,
                                               const std::vector<std::string>& selection) {
  SPLATVOL_TRY_ASSIGN(first, VdbFile::open(paths[0], selection));
  return std::make_unique<VdbSource>(paths, std::move(first));
}

}  // namespace splatvol
