#include "builder/sources/vtk/gmsh_reader.h"

#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDoubleArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkSmartPointer.h>
#include <vtkUnstructuredGrid.h>

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

#include "builder/sources/time_steps.h"
#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/gmsh_file.h"
#include "builder/sources/vtk/loaded_data_sets.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/patch.h"

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
constexpr std::array<QuadraticFace, 3> quadratic_faces = {
    {{9, VTK_QUADRATIC_TRIANGLE, 6}, {16, VTK_QUADRATIC_QUAD, 8}, {10, VTK_BIQUADRATIC_QUAD, 9}}};

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
    for (std::size_t i = 0; i < tags.size(); ++i) indices_.try_emplace(tags[i], static_cast<vtkIdType>(i));
  }

  /// Throws if there is no such tag.
  [[nodiscard]] vtkIdType find(std::uint64_t tag, const char* what) const {
    const auto found = indices_.find(tag);
    if (found == indices_.end()) throw ReaderError("{} {} is named, but not in the file", what, tag);
    return found->second;
  }

 private:
  std::unordered_map<std::uint64_t, vtkIdType> indices_;
};

/// Makes the grid of a file. Throws if a number in the file is out of range.
class GridMaker {
 public:
  explicit GridMaker(const GmshFile& file) : file_(file), nodes_(file.node_tags), elements_(file.elements.tags) {
    grid_->SetPoints(make_points(file.points));
    grid_->AllocateEstimate(static_cast<vtkIdType>(file.elements.types.size()), 8);
    add_cells();
  }

  void add_view(const GmshView& view) {
    switch (view.at) {
      case GmshView::At::nodes:
        grid_->GetPointData()->AddArray(plain_array(view, nodes_, grid_->GetNumberOfPoints(), "node"));
        break;
      case GmshView::At::elements:
        grid_->GetCellData()->AddArray(plain_array(view, elements_, grid_->GetNumberOfCells(), "element"));
        break;
      case GmshView::At::element_nodes:
        grid_->GetPointData()->AddArray(mean_array(view));
        break;
    }
  }

  [[nodiscard]] vtkSmartPointer<vtkUnstructuredGrid> grid() const { return grid_; }

  /// The physical groups of surfaces.
  [[nodiscard]] std::vector<Patch> patches() const {
    if (!file_.groups.empty() && file_.points.size() > std::numeric_limits<std::uint32_t>::max())
      throw ReaderError("a mesh of more than 2^32 - 1 nodes");
    std::vector<Patch> patches;
    for (const GmshGroup& group : file_.groups) {
      std::vector<SurfaceCell> cells;
      for (const std::size_t element : group.elements) cells.push_back(face_of(element));
      append_cells_of(file_.points, std::move(cells), patches.emplace_back(Patch{group.name, {}}).mesh);
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
    std::array<vtkIdType, 27> points{};
    const std::vector<bool> repeated = find_repeated();
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
      grid_->InsertNextCell(is_empty ? VTK_EMPTY_CELL : kind->vtk_type,
                            is_empty ? 0 : static_cast<vtkIdType>(kind->nodes), points.data());
      at += *gmsh_node_count(type);
    }
  }

  static vtkSmartPointer<vtkDoubleArray> make_array(const GmshView& view, vtkIdType count) {
    auto array = vtkSmartPointer<vtkDoubleArray>::New();
    array->SetName(view.name.c_str());
    array->SetNumberOfComponents(static_cast<int>(view.components));
    array->SetNumberOfTuples(count);
    return array;
  }

  static vtkSmartPointer<vtkDoubleArray> plain_array(const GmshView& view, const TagIndex& index, vtkIdType count,
                                                     const char* what) {
    auto array = make_array(view, count);
    array->Fill(missing_value);
    for (std::size_t i = 0; i < view.tags.size(); ++i) {
      const vtkIdType to = index.find(view.tags[i], what);
      for (std::size_t c = 0; c < view.components; ++c)
        array->SetTypedComponent(to, static_cast<int>(c), view.values[i * view.components + c]);
    }
    return array;
  }

  /// The means at the points of the values that the elements round them have there.
  vtkSmartPointer<vtkDoubleArray> mean_array(const GmshView& view) const {
    auto array = make_array(view, grid_->GetNumberOfPoints());
    array->Fill(0);
    std::vector<double> counts(file_.points.size());
    const double* value = view.values.data();
    for (std::size_t i = 0; i < view.tags.size(); ++i) {
      const auto element = static_cast<std::size_t>(elements_.find(view.tags[i], "element"));
      const std::size_t nodes = *gmsh_node_count(file_.elements.types[element]);
      // A view may have the corners of an element of higher order only.
      if (view.counts[i] > nodes)
        throw ReaderError("the view \"{}\" has {} values for the {} nodes of element {}", view.name, view.counts[i],
                          nodes, view.tags[i]);
      for (std::size_t n = 0; n < view.counts[i]; ++n) {
        const vtkIdType point = nodes_.find(file_.elements.nodes[first_node_[element] + n], "node");
        counts[static_cast<std::size_t>(point)] += 1;
        for (int c = 0; c < static_cast<int>(view.components); ++c)
          array->SetTypedComponent(point, c, array->GetTypedComponent(point, c) + *value++);
      }
    }
    for (vtkIdType p = 0; p < array->GetNumberOfTuples(); ++p)
      for (int c = 0; c < array->GetNumberOfComponents(); ++c)
        array->SetTypedComponent(p, c, array->GetTypedComponent(p, c) / counts[static_cast<std::size_t>(p)]);
    return array;
  }

  const GmshFile& file_;
  TagIndex nodes_;
  TagIndex elements_;
  std::vector<std::size_t> first_node_;  // [element], in elements.nodes
  vtkNew<vtkUnstructuredGrid> grid_;
};

/// A mesh whose volumes have physical groups.
class GmshDataSets final : public LoadedDataSets {
 public:
  GmshDataSets(const std::string& path, vtkSmartPointer<vtkDataSet> data, const std::optional<TimeStep>& step,
               std::vector<Patch> patches, GmshElements elements)
      : LoadedDataSets(path, {std::move(data)}, step, std::move(patches)), materials_(std::move(elements.materials)) {
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

Result<std::unique_ptr<VtkDataSets>> open_gmsh(const VtkFile& file, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(gmsh, read_gmsh(file.path, file.patches));
  if (gmsh.points.empty()) return fail(ErrorCode::invalid_data, "{}: no nodes in it, so no mesh", file.path);
  const std::optional<TimeStep> step = choose_step(gmsh, options.time);
  vtkSmartPointer<vtkDataSet> data;
  std::vector<Patch> patches;
  SPLATVOL_TRY(run_vtk(file.path, [&] {
    GridMaker maker(gmsh);
    for (const GmshView* view : views_at(gmsh.views, step ? step->time : 0))
      if (wants_array(options.selection, view->name)) maker.add_view(*view);
    data = maker.grid();
    patches = maker.patches();
  }));
  std::vector<ArrayShape> shapes = shapes_of(gmsh.views);
  auto data_sets = std::make_unique<GmshDataSets>(file.path, data, step, std::move(patches), std::move(gmsh.elements));
  data_sets->declare(std::move(shapes));
  return data_sets;
}

Result<std::vector<ArrayShape>> gmsh_arrays(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(views, read_gmsh_views(path));
  return shapes_of(views);
}

}  // namespace splatvol
