#include "builder/sources/gmsh/gmsh_reader.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <span>
#include <string_view>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "builder/mesh/cell_kinds.h"
#include "builder/sources/gmsh/gmsh_file.h"
#include "builder/sources/loaded_data_sets.h"
#include "builder/sources/mesh_data.h"
#include "builder/sources/patch.h"
#include "builder/sources/time_steps.h"

namespace splatvol {
namespace {

/// A type of element as a type of VTK's cells.
struct ElementKind {
  int gmsh_type;
  int vtk_type;
  std::array<std::uint8_t, 27> order;  // of the nodes of VTK's cell, as indices into Gmsh's
  std::size_t nodes;                   // of VTK's cell
};

constexpr ElementKind same_order(int gmsh_type, int vtk_type, std::size_t nodes) {
  ElementKind kind{gmsh_type, vtk_type, {}, nodes};
  for (std::size_t i = 0; i < kind.order.size(); ++i) kind.order[i] = static_cast<std::uint8_t>(i);
  return kind;
}

/// Lines and surfaces have no volume, so their corners will do.
constexpr std::array element_kinds = {
    same_order(15, 1, 1),
    same_order(1, 3, 2),
    same_order(2, 5, 3),
    same_order(3, 9, 4),
    same_order(4, 10, 4),
    same_order(5, 12, 8),
    same_order(6, 13, 6),
    same_order(7, 14, 5),
    ElementKind{11, 24, {0, 1, 2, 3, 4, 5, 6, 7, 9, 8}, 10},
    ElementKind{17, 25, {0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15}, 20},
    ElementKind{
        12, 29, {0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15, 22, 23, 21, 24, 20, 25, 26}, 27},
    ElementKind{18, 26, {0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11}, 15},
    ElementKind{13, 32, {0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11, 15, 17, 16}, 18},
    ElementKind{19, 27, {0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12}, 13},
    ElementKind{14, 27, {0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12}, 13},  // without the middle of its base
};

/// A surface element of order 2, as a type of VTK's cells with the same order of nodes.
struct QuadraticFace {
  int gmsh_type;
  int vtk_type;
  std::size_t nodes;
};
constexpr std::array<QuadraticFace, 3> quadratic_faces = {{{9, vtk_cell::quadratic_triangle, 6},
                                                           {16, vtk_cell::quadratic_quadrilateral, 8},
                                                           {10, vtk_cell::biquadratic_quadrilateral, 9}}};

constexpr bool is_line(int type) { return type == 8 || (type >= 26 && type <= 28); }
constexpr bool is_quadrilateral(int type) { return type == 10 || type == 16 || (type >= 36 && type <= 38); }
constexpr bool is_solid(int type) {
  return (type >= 4 && type <= 7) || (type >= 11 && type <= 14) || (type >= 17 && type <= 19) ||
         (type >= 29 && type <= 31) || type >= 92;
}

/// Null for elements with a volume and an order of 3 or more.
const ElementKind* find_kind(int type) {
  if (!is_solid(type)) type = type == 15 || type <= 3 ? type : is_line(type) ? 1 : is_quadrilateral(type) ? 3 : 2;
  const auto* found = std::ranges::find(element_kinds, type, &ElementKind::gmsh_type);
  return found == element_kinds.end() ? nullptr : found;
}

/// Finds the indices of things by their tags.
class TagIndex {
 public:
  explicit TagIndex(std::span<const std::uint64_t> tags) {
    indices_.reserve(tags.size());
    for (std::size_t i = 0; i < tags.size(); ++i) indices_.try_emplace(tags[i], i);
  }

  /// Throws if there is no such tag.
  [[nodiscard]] std::size_t find(std::uint64_t tag, const char* what) const {
    const auto found = indices_.find(tag);
    if (found == indices_.end()) throw ReaderError("{} {} is named, but not in the file", what, tag);
    return found->second;
  }

 private:
  std::unordered_map<std::uint64_t, std::size_t> indices_;
};

/// Makes the mesh of a file. Throws if a number in the file is out of range.
class MeshMaker {
 public:
  /// Takes the points of the file.
  explicit MeshMaker(GmshFile& file) : file_(file), nodes_(file.node_tags), elements_(file.elements.tags) {
    mesh_.points = std::move(file.points);
    add_cells();
  }

  void add_view(const GmshView& view) {
    const bool of_cells = view.at == GmshView::At::elements;
    std::vector<double> values = view.at == GmshView::At::element_nodes ? means(view)
                                 : of_cells ? values_of(view, elements_, mesh_.types.size(), "element")
                                            : values_of(view, nodes_, mesh_.points.size(), "node");
    mesh_.arrays.push_back({{view.name, static_cast<int>(view.components), of_cells}, std::move(values)});
  }

  [[nodiscard]] MeshData take_mesh() { return std::move(mesh_); }

  /// The physical groups of surfaces.
  [[nodiscard]] std::vector<Patch> patches() const {
    if (!file_.groups.empty() && mesh_.points.size() > std::numeric_limits<std::uint32_t>::max())
      throw ReaderError("a mesh of more than 2^32 - 1 nodes");
    std::vector<Patch> patches;
    for (const GmshGroup& group : file_.groups) {
      std::vector<SurfaceCell> cells;
      for (const std::size_t element : group.elements) cells.push_back(face_of(element));
      append_cells_of(mesh_.points, std::move(cells), patches.emplace_back(Patch{group.name, {}}).mesh);
    }
    return patches;
  }

 private:
  /// A surface element as the face of a cell, with the nodes that cells have there.
  [[nodiscard]] SurfaceCell face_of(std::size_t element) const {
    const int type = file_.elements.types[element];
    const auto* quadratic = std::ranges::find(quadratic_faces, type, &QuadraticFace::gmsh_type);
    const ElementKind* linear = find_kind(type);  // not null: it has no volume
    SurfaceCell cell{linear->vtk_type, {}};
    std::size_t nodes = linear->nodes;
    if (quadratic != quadratic_faces.end()) cell.vtk_type = quadratic->vtk_type, nodes = quadratic->nodes;
    for (std::size_t n = 0; n < nodes; ++n)
      cell.points.push_back(
          static_cast<std::uint32_t>(nodes_.find(file_.elements.nodes[first_node_[element] + n], "node")));
    return cell;
  }

  /// Finds the elements with the nodes of an element before them.
  [[nodiscard]] std::vector<bool> find_repeated() const {
    const GmshElements& elements = file_.elements;
    std::vector<bool> repeated(elements.types.size());
    std::vector<std::tuple<std::uint64_t, std::uint64_t, std::size_t>> sorted;  // two hashes of the nodes, element
    std::size_t at = 0;
    for (std::size_t e = 0; e < elements.types.size() && file_.may_repeat; ++e) {
      const std::size_t nodes = *gmsh_node_count(elements.types[e]);
      std::uint64_t sum = 0, other = static_cast<std::uint64_t>(elements.types[e]);
      for (std::size_t n = 0; n < nodes; ++n) {
        const std::uint64_t mixed = (elements.nodes[at + n] + 1) * 0x9e3779b97f4a7c15ULL;
        sum += mixed ^ (mixed >> 32);
        other += (mixed ^ (mixed >> 29)) * 0xbf58476d1ce4e5b9ULL;
      }
      at += nodes;
      if (is_solid(elements.types[e])) sorted.emplace_back(sum, other, e);
    }
    std::ranges::sort(sorted);
    for (std::size_t i = 1; i < sorted.size(); ++i) {
      const auto& [sum, other, element] = sorted[i];
      repeated[element] = sum == std::get<0>(sorted[i - 1]) && other == std::get<1>(sorted[i - 1]);
    }
    return repeated;
  }

  /// Adds one cell for each element, so that both have the same numbers. Repeated elements become empty cells.
  void add_cells() {
    const GmshElements& elements = file_.elements;
    std::array<std::size_t, 27> points{};
    const std::vector<bool> repeated = find_repeated();
    mesh_.types.reserve(elements.types.size());
    mesh_.offsets.reserve(elements.types.size() + 1);
    mesh_.connectivity.reserve(elements.nodes.size());
    std::size_t at = 0;
    for (const int type : elements.types) {
      const ElementKind* kind = find_kind(type);
      if (!kind)
        throw ReaderError(
            "elements of Gmsh's type {} (order 3 or more) cannot be read; lower the order: "
            "gmsh IN.msh -order 2 -save -o OUT.msh",
            type);
      first_node_.push_back(at);
      for (std::size_t i = 0; i < kind->nodes; ++i)
        points[i] = nodes_.find(elements.nodes[at + kind->order[i]], "node");
      const bool is_empty = repeated[first_node_.size() - 1];
      mesh_.add_cell(is_empty ? vtk_cell::empty : kind->vtk_type, std::span(points).first(is_empty ? 0 : kind->nodes));
      at += *gmsh_node_count(type);
    }
  }

  static std::vector<double> values_of(const GmshView& view, const TagIndex& index, std::size_t count,
                                       const char* what) {
    std::vector<double> values(count * view.components, missing_value);
    for (std::size_t i = 0; i < view.tags.size(); ++i)
      std::copy_n(view.values.begin() + static_cast<std::ptrdiff_t>(i * view.components), view.components,
                  values.begin() + static_cast<std::ptrdiff_t>(index.find(view.tags[i], what) * view.components));
    return values;
  }

  /// The means at the points of the values that the elements round them have there.
  [[nodiscard]] std::vector<double> means(const GmshView& view) const {
    std::vector<double> sums(mesh_.points.size() * view.components), counts(mesh_.points.size());
    const double* value = view.values.data();
    for (std::size_t i = 0; i < view.tags.size(); ++i) {
      const std::size_t element = elements_.find(view.tags[i], "element");
      const std::size_t nodes = *gmsh_node_count(file_.elements.types[element]);
      // A view may have the corners of an element of higher order only.
      if (view.counts[i] > nodes)
        throw ReaderError("the view \"{}\" has {} values for the {} nodes of element {}", view.name, view.counts[i],
                          nodes, view.tags[i]);
      for (std::size_t n = 0; n < view.counts[i]; ++n) {
        const std::size_t point = nodes_.find(file_.elements.nodes[first_node_[element] + n], "node");
        counts[point] += 1;
        for (std::size_t c = 0; c < view.components; ++c) sums[point * view.components + c] += *value++;
      }
    }
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] /= counts[i / view.components];
    return sums;
  }

  const GmshFile& file_;
  TagIndex nodes_;
  TagIndex elements_;
  std::vector<std::size_t> first_node_;  // [element], in elements.nodes
  MeshData mesh_;
};

/// A mesh whose volumes have physical groups.
class GmshDataSets final : public LoadedDataSets {
 public:
  GmshDataSets(const std::string& path, std::vector<std::unique_ptr<DataSet>> data, const std::optional<TimeStep>& step,
               std::vector<Patch> patches, GmshElements elements)
      : LoadedDataSets(path, std::move(data), step, std::move(patches)), materials_(std::move(elements.materials)) {
    for (std::size_t e = 0; e < materials_.size(); ++e)
      if (is_solid(elements.types[e])) known_.insert(materials_[e]);
  }

  std::size_t blocks() const override { return std::max<std::size_t>(known_.size(), 1); }
  std::string block_word() const override { return "material"; }
  std::span<const int> blocks_of_cells() const override { return materials_; }

 private:
  std::vector<int> materials_;
  std::set<int> known_;  // of the cells with a volume
};

/// Chooses among the times of all views.
std::optional<TimeStep> choose_step(const GmshFile& file, std::optional<double> time) {
  std::vector<double> times;
  for (const GmshView& view : file.views) times.push_back(view.time);
  std::ranges::sort(times);
  times.erase(std::ranges::unique(times).begin(), times.end());
  if (times.size() < 2) return std::nullopt;
  return splatvol::choose_step(times, time);
}

/// Of the views of each name and place, the one that is nearest to a time; of two, the later one. In the order in which
/// the names come in the file: it is the same at all times.
std::vector<const GmshView*> views_at(std::span<const GmshView> views, double time) {
  std::map<std::pair<GmshView::At, std::string_view>, std::size_t> indices;
  std::vector<const GmshView*> nearest;
  for (const GmshView& view : views) {
    const auto [known, is_new] = indices.try_emplace({view.at, view.name}, nearest.size());
    if (is_new)
      nearest.push_back(&view);
    else if (std::abs(view.time - time) <= std::abs(nearest[known->second]->time - time))
      nearest[known->second] = &view;
  }
  return nearest;
}

std::vector<ArrayShape> shapes_of(std::span<const GmshView> views) {
  std::vector<ArrayShape> shapes;
  for (const GmshView* view : views_at(views, 0))
    shapes.push_back({view->name, static_cast<int>(view->components), view->at == GmshView::At::elements});
  return shapes;
}

}  // namespace

Result<std::unique_ptr<DataSets>> open_gmsh(const InputFile& file, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(gmsh, read_gmsh(file.path, file.patches));
  if (gmsh.points.empty()) return fail(ErrorCode::invalid_data, "{}: no nodes in it, so no mesh", file.path);
  const std::optional<TimeStep> step = choose_step(gmsh, options.time);
  std::vector<std::unique_ptr<DataSet>> data;
  std::vector<Patch> patches;
  SPLATVOL_TRY(run_reader(file.path, [&] {
    MeshMaker maker(gmsh);
    for (const GmshView* view : views_at(gmsh.views, step ? step->time : 0))
      if (wants_array(options.selection, view->name)) maker.add_view(*view);
    patches = maker.patches();
    data.push_back(std::make_unique<MeshDataSet>(maker.take_mesh()));
  }));
  std::vector<ArrayShape> shapes = shapes_of(gmsh.views);
  auto data_sets =
      std::make_unique<GmshDataSets>(file.path, std::move(data), step, std::move(patches), std::move(gmsh.elements));
  data_sets->declare(std::move(shapes));
  return data_sets;
}

Result<ArraysOfParts> list_gmsh_arrays(const InputFile& file) {
  SPLATVOL_TRY_ASSIGN(views, read_gmsh_views(file.path));
  return ArraysOfParts(1, shapes_of(views));
}

}  // namespace splatvol
