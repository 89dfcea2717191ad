#include "builder/sources/openvdb/vdb_source.h"

#include <fmt/ranges.h>
#include <openvdb/io/File.h>
#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <utility>

#include "base/file.h"
#include "base/names.h"
#include "base/vdb_grid.h"
#include "base/vdb_share.h"
#include "builder/mesh/material_box.h"
#include "builder/sources/array_attributes.h"
#include "builder/sources/array_union.h"
#include "builder/sources/openvdb/vdb_fields.h"
#include "builder/sources/openvdb/vdb_geometry.h"
#include "builder/sources/openvdb/vdb_header.h"
#include "builder/sources/openvdb/vdb_library.h"
#include "builder/sources/piece_ahead.h"
#include "builder/sources/repeated_pieces.h"

namespace splatvol {
namespace {

using openvdb::Coord;

using TopologyAccessor = openvdb::tree::ValueAccessor<const openvdb::MaskTree, false>;

/// Runs `work`, and turns exceptions into errors.
template <class Work>
auto contain(const std::string& path, const Work& work) -> decltype(work()) {
  try {
    return work();
  } catch (const std::bad_alloc&) {
    return fail(ErrorCode::out_of_budget, "{}: not enough memory for its grids", path);
  } catch (const std::exception& error) {
    constexpr std::size_t longest = 200;  // the message may contain names from the file
    return fail(ErrorCode::invalid_data, "{}: {}", path, std::string(error.what()).substr(0, longest));
  }
}

/// An attribute, and the grid and component that it is read from.
struct Attribute {
  std::string name;
  std::optional<std::size_t> grid;  // its number in the file; none: the file lacks it
  int component = 0;
  int components = 1;  // as in Source::components()
};

/// The active voxels of a brick, which OpenVDB calls a leaf node, or a tile.
struct Region {
  Coord origin;
  int edge = 1;                                            // of a point's box, in voxels
  const openvdb::MaskTree::LeafNodeType* brick = nullptr;  // null: a tile
  std::uint32_t points = 1;
};

/// A region, the voxels of its samples, and the number of its first point in a piece.
struct RegionSamples {
  const Region& region;
  const SampleLayout& layout;
  std::vector<Coord> voxels;
  std::size_t first_point;
};

/// The grids of a file, and its points as pieces.
class VdbFile {
 public:
  /// Reads the attributes that the options select, or all.
  static Result<std::unique_ptr<VdbFile>> open(const std::string& path, const SourceOptions& options) {
    SPLATVOL_TRY(check(path));
    return contain(path, [&]() -> Result<std::unique_ptr<VdbFile>> {
      auto file = std::make_unique<VdbFile>(path, options);
      SPLATVOL_TRY(file->read());
      return file;
    });
  }

  /// Lists the grids of numbers, by the header.
  static Result<std::vector<ArrayShape>> list(const std::string& path) {
    SPLATVOL_TRY(check(path));
    return contain(path, [&]() -> Result<std::vector<ArrayShape>> {
      openvdb::io::File file(path);
      file.open(false);
      std::vector<ArrayShape> shapes;
      std::map<std::string, int> seen;
      const openvdb::GridPtrVecPtr grids = file.readAllGridMetadata();
      for (const openvdb::GridBase::Ptr& grid : *grids) {
        const std::string name = name_of(*grid, seen);
        if (const int components = vdb_components(*grid); components > 0) shapes.push_back({name, components, false});
      }
      return shapes;
    });
  }

  VdbFile(std::string path, const SourceOptions& options)
      : path_(std::move(path)),
        selection_(options.selection),
        may_lack_(options.may_lack),
        missing_(options.missing),
        pieces_(0, [this](std::size_t piece) { return make_piece(piece); }) {}

  [[nodiscard]] const std::vector<Attribute>& attributes() const { return attributes_; }
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const Attribute& attribute : attributes_) names.push_back(attribute.name);
    return names;
  }
  [[nodiscard]] std::size_t piece_count() const { return pieces_.count(); }
  [[nodiscard]] std::uint64_t point_count() const { return points_; }
  [[nodiscard]] Result<std::unique_ptr<Piece>> next() { return pieces_.next(); }

  [[nodiscard]] Box bounds() const {
    std::vector<Box> boxes(regions_.size());
    tbb::parallel_for(std::size_t{0}, regions_.size(), [&](std::size_t r) {
      visit_points(regions_[r], [&](std::size_t, std::size_t, const dvec3& p) {
        if (is_usable_position(p)) boxes[r].include({p, p});
      });
    });
    Box all;
    for (const Box& box : boxes) all.include(box);
    double edge = 0;
    for (const Region& region : regions_) edge = std::max(edge, static_cast<double>(region.edge));
    return grown_for_material(all, deviation_bound(transform_.box_moments(edge)));
  }

 private:
  static Status check(const std::string& path) {
    SPLATVOL_TRY_ASSIGN(bytes, open_file(path));
    SPLATVOL_TRY(check_vdb_header(*bytes));
    if (start_vdb()) return {};
    return fail(ErrorCode::unsupported, "{}: not read: this program cannot check the lengths of OpenVDB's blocks",
                path);
  }

  /// The name of a grid among others; `seen`: how many had it before.
  static std::string name_of(const openvdb::GridBase& grid, std::map<std::string, int>& seen) {
    const std::string name = grid.getName().empty() ? "value" : grid.getName();
    const int number = seen[name]++;
    return number > 0 ? fmt::format("{}[{}]", name, number) : name;
  }

  Status read() {
    // OpenVDB does not check that a read succeeded, so the stream throws at its end.
    std::ifstream file(path_, std::ios::binary);
    file.exceptions(std::ios::failbit | std::ios::badbit | std::ios::eofbit);
    const openvdb::GridPtrVecPtr grids = openvdb::io::Stream(file, false).getGrids();
    SPLATVOL_TRY(choose_attributes(*grids));
    for (const Attribute& attribute : attributes_)
      if (attribute.grid) SPLATVOL_TRY(add_field(*grids, *attribute.grid));
    if (share_grid_) SPLATVOL_TRY(add_field(*grids, *share_grid_));
    list_regions();
    divide_into_pieces();
    if (points_ == 0) return fail(ErrorCode::invalid_data, "{}: no active voxels", path_);
    return {};
  }

  /// Lists all attributes of the file, and finds the grid with the share of material.
  Result<std::vector<Attribute>> list_attributes(const openvdb::GridPtrVec& grids) {
    std::vector<Attribute> all;
    std::vector<std::string> others;
    std::map<std::string, int> seen;
    for (std::size_t g = 0; g < grids.size(); ++g) {
      const std::string called = name_of(*grids[g], seen);
      const int components = vdb_components(*grids[g]);
      if (components == 0) {
        others.push_back(fmt::format("{} ({})", called, grids[g]->valueType()));
        continue;
      }
      all.push_back({called, g, components == 1 ? 0 : VdbField::magnitude, components});
      for (int c = 0; c < components && components > 1; ++c) all.push_back({fmt::format("{}[{}]", called, c), g, c});
      if (grids[g]->getMetadata<openvdb::BoolMetadata>(vdb_share_metadata)) share_grid_ = g;
    }
    if (all.size() > AttributeCount::most) return fail_too_many_attributes(path_);
    if (all.empty() && others.empty()) return fail(ErrorCode::invalid_data, "{}: no grids", path_);
    if (all.empty())
      return fail(ErrorCode::invalid_data, "{}: no grid of numbers; there are: {}", path_, fmt::join(others, ", "));
    return all;
  }

  Status choose_attributes(const openvdb::GridPtrVec& grids) {
    SPLATVOL_TRY_ASSIGN(all, list_attributes(grids));
    std::vector<std::string> names;
    for (const Attribute& attribute : all) names.push_back(attribute.name);
    if (const auto duplicate = find_duplicate(names))
      return fail(ErrorCode::invalid_data, "{}: two attributes are called \"{}\"", path_, *duplicate);
    if (selection_.empty()) attributes_ = all;
    for (const std::string& name : selection_) {
      const auto attribute = std::ranges::find(all, name, &Attribute::name);
      if (attribute == all.end() && !may_lack_) return fail_no_attribute(path_, name, names);
      attributes_.push_back(attribute == all.end() ? Attribute{name, std::nullopt} : *attribute);
    }
    // Without any, it has no points.
    const bool has_any = std::ranges::any_of(attributes_, [](const Attribute& a) { return a.grid.has_value(); });
    return has_any ? Status{} : fail_no_attribute(path_, selection_.front(), names);
  }

  Status add_field(const openvdb::GridPtrVec& grids, std::size_t number) {
    if (fields_.contains(number)) return {};
    const openvdb::GridBase::Ptr& grid = grids[number];
    SPLATVOL_TRY_ASSIGN(transform, voxel_transform(path_, grid->getName(), *grid));
    if (!fields_.empty() && !transform.same_as(transform_))
      return fail(ErrorCode::unsupported,
                  "{}: the grids \"{}\" and \"{}\" have different transforms: build one of them (--attribute)", path_,
                  grids[fields_.begin()->first]->getName(), grid->getName());
    if (fields_.empty()) {
      transform_ = transform;
      to_gradient_ = glm::transpose(glm::inverse(transform.edges));
    }
    fields_[number] = make_vdb_field(grid);
    return {};
  }

  void list_regions() {
    topology_ = make_vdb_grid<openvdb::MaskGrid>();
    for (const auto& [number, field] : fields_) field->add_topology(topology_->tree());
    for (auto brick = topology_->constTree().cbeginLeaf(); brick; ++brick) {
      const auto points = static_cast<std::uint32_t>(brick->onVoxelCount());
      if (points > 0) regions_.push_back({brick->origin(), 1, brick.getLeaf(), points});
    }
    auto tile = topology_->constTree().cbeginValueOn();
    tile.setMaxDepth(openvdb::MaskTree::ValueOnCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile) {
      const openvdb::CoordBBox box = tile.getBoundingBox();
      regions_.push_back({box.min(), box.dim().x(), nullptr, 1});
      tile_layouts_.try_emplace(box.dim().x(), tile_layout(box.dim().x()));
    }
  }

  void divide_into_pieces() {
    piece_begins_ = {0};
    std::uint64_t held = 0;
    for (std::size_t r = 0; r < regions_.size(); ++r) {
      if (held + regions_[r].points > max_piece_points) piece_begins_.push_back(r), held = 0;
      held += regions_[r].points;
      points_ += regions_[r].points;
    }
    piece_begins_.push_back(regions_.size());
    pieces_ = PieceAhead(piece_begins_.size() - 1, [this](std::size_t piece) { return make_piece(piece); });
  }

  /// Calls visit(number in the region, number of its stencil, position) for each point.
  template <class Visit>
  void visit_points(const Region& region, const Visit& visit) const {
    const dvec3 corner(region.origin.x(), region.origin.y(), region.origin.z());
    if (region.brick == nullptr) {
      visit(std::size_t{0}, std::size_t{0}, transform_.position(corner + 0.5 * (region.edge - 1)));
      return;
    }
    std::size_t number = 0;
    for (auto voxel = region.brick->cbeginValueOn(); voxel; ++voxel) {
      const Coord offset = openvdb::MaskTree::LeafNodeType::offsetToLocalCoord(voxel.pos());
      visit(number++, std::size_t{voxel.pos()},
            transform_.position(corner + dvec3(offset.x(), offset.y(), offset.z())));
    }
  }

  Result<std::unique_ptr<Piece>> make_piece(std::size_t number) const {
    return contain(path_, [&]() -> Result<std::unique_ptr<Piece>> {
      const std::size_t begin = piece_begins_[number], end = piece_begins_[number + 1];
      std::vector<std::size_t> first_points;
      std::size_t points = 0;
      auto piece = std::make_unique<Piece>();
      for (std::size_t r = begin; r < end; ++r) {
        first_points.push_back(points);
        points += regions_[r].points;
        piece->census.cells[regions_[r].brick != nullptr ? "voxel" : "tile"] += regions_[r].points;
      }
      PointMaterial& material = piece->material.emplace();
      piece->points.resize(points);
      material.moments.resize(points);
      material.planes.resize(points);
      piece->values.assign(attributes_.size(), std::vector<double>(points));
      material.value_moments.assign(attributes_.size(), std::vector<ValueMoments>(points));
      material.gradients.assign(attributes_.size(), std::vector<dvec3>(points));
      piece->fills.assign(attributes_.size(), 0);
      tbb::parallel_for(begin, end, [&](std::size_t r) { fill(regions_[r], first_points[r - begin], *piece); });
      return piece;
    });
  }

  void fill(const Region& region, std::size_t first_point, Piece& piece) const {
    static const SampleLayout of_brick = brick_layout();
    RegionSamples samples{region, region.brick != nullptr ? of_brick : tile_layouts_.at(region.edge), {}, first_point};
    for (const Coord& offset : samples.layout.offsets) samples.voxels.push_back(region.origin + offset);
    fill_material(samples, piece);
    for (std::size_t a = 0; a < attributes_.size(); ++a) fill_attribute(samples, a, piece);
  }

  /// Fills in positions, moments and planes.
  void fill_material(const RegionSamples& samples, Piece& piece) const {
    std::vector<double> shares;
    if (share_grid_) {
      shares.resize(samples.voxels.size());
      fields_.at(*share_grid_)->sample(samples.voxels, 0, shares);
    }
    const TopologyAccessor active(topology_->constTree());
    const double edge = samples.region.edge;
    const SpatialMoments box = transform_.box_moments(edge);
    visit_points(samples.region, [&](std::size_t number, std::size_t voxel, const dvec3& position) {
      const std::size_t i = samples.first_point + number;
      const Stencil& stencil = samples.layout.stencils[voxel];
      piece.points[i] = position;
      SpatialMoments& moments = piece.material->moments[i];
      moments = box;
      if (!shares.empty()) moments.mass *= std::fmax(0.0, shares[stencil.own]);
      piece.material->planes[i] = plane(stencil, samples.voxels, active, edge);
    });
  }

  /// Fills in the values of an attribute, their moments and gradients. Requires the masses of fill_material.
  void fill_attribute(const RegionSamples& samples, std::size_t a, Piece& piece) const {
    std::vector<bool> filled(samples.voxels.size());
    const std::vector<double> values = sample(samples, attributes_[a], filled);
    std::uint64_t fills = 0;
    const double edge = samples.region.edge;
    visit_points(samples.region, [&](std::size_t number, std::size_t voxel, const dvec3&) {
      const std::size_t i = samples.first_point + number;
      const Stencil& stencil = samples.layout.stencils[voxel];
      const double value = piece.values[a][i] = values[stencil.own];
      fills += filled[stencil.own] ? 1 : 0;
      const double mass = piece.material->moments[i].mass;
      if (std::isnan(value) || !(mass > 0)) return;
      // In indices the box is a cube, with variance edge^2 / 12 along each axis.
      const LinearField field = fit_linear_field(stencil, values, edge);
      piece.material->gradients[a][i] = to_gradient_ * field.slope;
      ValueMoments& moments = piece.material->value_moments[a][i];
      moments.mass = mass;
      moments.mean = value;
      moments.covariance = edge * edge / 12 * (transform_.edges * field.slope);
      moments.variance = edge * edge / 12 * glm::dot(field.slope, field.slope);
      moments.min = field.min;
      moments.max = field.max;
    });
    std::atomic_ref(piece.fills[a]) += fills;  // regions are filled in parallel
  }

  /// Reads the values of an attribute. The missing ones are NaN; `filled` becomes true where a finite number stood for
  /// one. A vector with a missing component has no magnitude.
  [[nodiscard]] std::vector<double> sample(const RegionSamples& samples, const Attribute& attribute,
                                           std::vector<bool>& filled) const {
    if (!attribute.grid) return std::vector<double>(samples.voxels.size(), missing_value);
    const auto component = [&](int c) {
      std::vector<double> values(samples.voxels.size());
      fields_.at(*attribute.grid)->sample(samples.voxels, c, values);
      for (std::size_t i = 0; i < values.size(); ++i)
        if (missing_.has(values[i])) {
          filled[i] = filled[i] || std::isfinite(values[i]);
          values[i] = missing_value;
        }
      return values;
    };
    if (attribute.component != VdbField::magnitude) return component(attribute.component);
    std::vector<double> values = component(0);
    const std::vector<double> y = component(1), z = component(2);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = std::hypot(values[i], y[i], z[i]);
    return values;
  }

  /// The plane of a box's faces that have nothing active beside them.
  [[nodiscard]] BoundaryPlane plane(const Stencil& stencil, std::span<const Coord> voxels,
                                    const TopologyAccessor& active, double edge) const {
    std::vector<BoundaryPlane> faces;
    const dmat3 edges = edge * transform_.edges;
    const double volume = glm::determinant(edges);
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        if (active.isValueOn(voxels[stencil.beside[static_cast<std::size_t>(axis)][static_cast<std::size_t>(side)]]))
          continue;
        const dvec3 area = glm::cross(edges[(axis + 1) % 3], edges[(axis + 2) % 3]);
        faces.push_back({(side == 0) == (volume > 0) ? -area : area, std::abs(volume) / 2});
      }
    return faces.empty() ? BoundaryPlane{} : merge_planes(faces, std::vector<dvec3>(faces.size(), dvec3(0)));
  }

  std::string path_;
  std::vector<std::string> selection_;
  bool may_lack_;
  MissingValues missing_;
  std::vector<Attribute> attributes_;
  std::map<std::size_t, std::unique_ptr<VdbField>> fields_;  // by the number of their grid in the file
  std::optional<std::size_t> share_grid_;                    // holds the share of material in each box
  VoxelTransform transform_;
  dmat3 to_gradient_{1};             // from the slope for each index
  openvdb::MaskGrid::Ptr topology_;  // the union of all fields
  std::vector<Region> regions_;
  std::map<int, SampleLayout> tile_layouts_;  // by the tile's edge
  std::vector<std::size_t> piece_begins_;     // [piece]: its first region; then the number of regions
  std::uint64_t points_ = 0;
  PieceAhead pieces_;
};

class VdbSource final : public Source {
 public:
  /// `options`: for all files but the first.
  VdbSource(std::vector<std::string> paths, std::unique_ptr<VdbFile> first, SourceOptions options)
      : paths_(std::move(paths)), options_(std::move(options)) {
    use(std::move(first));
    attributes_ = file_->names();
    components_ = components_of(*file_);
  }

  const std::vector<std::string>& attributes() const override { return attributes_; }
  std::vector<int> components() const override { return components_; }
  std::size_t piece_count() const override { return opened_pieces_ + paths_.size() - opened_; }
  bool brings_material() const override { return true; }

  Result<std::unique_ptr<Piece>> next() override {
    for (;;) {
      SPLATVOL_TRY_ASSIGN(piece, file_->next());
      if (piece && paths_.size() > 1) SPLATVOL_TRY(repeats_.add(paths_[opened_ - 1], *piece));
      if (piece || opened_ == paths_.size()) return piece;
      file_.reset();  // frees its memory before the next file is read
      SPLATVOL_TRY_ASSIGN(file, VdbFile::open(paths_[opened_], options_));
      SPLATVOL_TRY(check_components(paths_[opened_], attributes_, components_of(*file), paths_[0], components_));
      use(std::move(file));
    }
  }

  std::vector<std::string> conversions() const override {
    std::vector<std::string> lacking = attributes_;
    std::erase_if(lacking, [&](const std::string& name) { return !lacking_.contains(name); });
    return lacking.empty() ? lacking : std::vector{describe_lacking(lacking)};
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
  static std::vector<int> components_of(const VdbFile& file) {
    std::vector<int> components;
    for (const Attribute& attribute : file.attributes()) components.push_back(attribute.components);
    return components;
  }

  void use(std::unique_ptr<VdbFile> file) {
    file_ = std::move(file);
    opened_pieces_ += file_->piece_count();
    ++opened_;
    for (const Attribute& attribute : file_->attributes())
      if (!attribute.grid) lacking_.insert(attribute.name);
  }

  std::vector<std::string> paths_;
  SourceOptions options_;
  std::vector<std::string> attributes_;
  std::vector<int> components_;    // [attribute]
  std::set<std::string> lacking_;  // in files so far
  std::unique_ptr<VdbFile> file_;
  std::size_t opened_ = 0;         // files so far
  std::size_t opened_pieces_ = 0;  // in these files
  RepeatedPieces repeats_;
};

Result<ArrayUnion> unite_grids(const std::vector<std::string>& paths) {
  ArrayUnion grids;
  for (const std::string& path : paths) {
    SPLATVOL_TRY_ASSIGN(shapes, VdbFile::list(path));
    SPLATVOL_TRY(grids.add(path, shapes));
  }
  return grids;
}

}  // namespace

Result<std::unique_ptr<Source>> open_vdb_files(const std::vector<std::string>& paths, const SourceOptions& options) {
  SourceOptions of_all = options;
  SPLATVOL_TRY_ASSIGN(grids, unite_grids(paths.size() > 1 ? paths : std::vector<std::string>()));
  SPLATVOL_TRY_ASSIGN(attributes, grids.attributes(paths[0], CellValues::averaged));
  const std::vector<std::string> all = names_of(attributes);
  const auto is_there = [&](const std::string& name) { return std::ranges::find(all, name) != all.end(); };
  of_all.may_lack = options.may_lack || (paths.size() > 1 && std::ranges::all_of(options.selection, is_there));

  SPLATVOL_TRY_ASSIGN(first, VdbFile::open(paths[0], of_all));
  of_all.selection = first->names();
  if (options.selection.empty()) {
    for (const std::string& name : all)
      if (std::ranges::find(of_all.selection, name) == of_all.selection.end()) of_all.selection.push_back(name);
    if (of_all.selection.size() > first->names().size()) {
      first.reset();  // frees its memory
      SPLATVOL_TRY_ASSIGN(with_all, VdbFile::open(paths[0], of_all));
      first = std::move(with_all);
    }
  }
  return std::make_unique<VdbSource>(paths, std::move(first), std::move(of_all));
}

Result<std::vector<ArrayShape>> list_vdb_grids(const std::vector<std::string>& paths) {
  SPLATVOL_TRY_ASSIGN(grids, unite_grids(paths));
  return grids.arrays();
}

}  // namespace splatvol
