#include "builder/sources/arrays_source.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/names.h"
#include "builder/sources/mesh_data.h"
#include "builder/sources/piece_maker.h"

namespace splatvol {
namespace {

std::size_t size_of(const Numbers& numbers) {
  return std::visit([](const auto& span) { return span.size(); }, numbers);
}

bool is_single(const Numbers& numbers) { return std::holds_alternative<std::span<const float>>(numbers); }

class ArraysSource final : public Source {
 public:
  ArraysSource(std::string name, const MeshArrays& mesh, std::vector<ArrayAttribute> attributes,
               const SourceOptions& options)
      : name_(std::move(name)),
        mesh_(mesh),
        attributes_(std::move(attributes)),
        names_(names_of(attributes_)),
        cells_(options.cells),
        missing_(options.missing) {}

  const std::vector<std::string>& attributes() const override { return names_; }
  std::vector<int> components() const override { return components_of(attributes_); }
  void lend_values() override { lends_ = true; }
  void tell_whole_cells() override { whole_cells_ = true; }
  bool may_have_cells() const override { return has_cells(); }
  std::size_t piece_count() const override { return has_cells() ? 1 : divide(points(), max_piece_points); }

  std::vector<std::string> units() const override {
    std::vector<std::string> units;
    for (const ArrayAttribute& attribute : attributes_)
      units.push_back(std::ranges::find(arrays_of(attribute), attribute.array, &ValueArray::name)->unit);
    return units;
  }

  std::optional<std::uint64_t> point_count() const override {
    if (has_cells() && cells_ == CellValues::own) return std::nullopt;
    return points();
  }

  std::vector<std::string> conversions() const override {
    const bool own = cells_ == CellValues::own;
    std::string names;
    for (const ArrayAttribute& attribute : attributes_)
      if (attribute.of_cells != own && (attribute.components == 1 || attribute.component == ArrayAttribute::magnitude))
        names += (names.empty() ? "" : ", ") + attribute.name;
    if (names.empty()) return {};
    return {names + (own ? ": of points, averaged to cells" : ": of cells, averaged to points")};
  }

  bool single_precision() const override {
    return is_single(mesh_.points) && std::ranges::all_of(attributes_, [&](const ArrayAttribute& attribute) {
             const auto array = std::ranges::find(arrays_of(attribute), attribute.array, &ValueArray::name);
             return !attribute.of_cells && is_single(array->values) && attribute.component != ArrayAttribute::magnitude;
           });
  }

  Result<std::unique_ptr<Piece>> next() override {
    if (next_point_ == points()) return std::unique_ptr<Piece>();
    const std::size_t first = next_point_;
    next_point_ = has_cells() ? points() : std::min(points(), first + max_piece_points);
    const MeshDataSet data(mesh_, first, next_point_ - first);
    SPLATVOL_TRY_ASSIGN(piece, make_piece(name_, data, attributes_, cells_, missing_, lends_, whole_cells_));
    if (has_cells() && cells_ == CellValues::own && piece->points.empty())
      return fail(ErrorCode::invalid_data, "{}: no cells with a volume, which cells of their own need", name_);
    return piece;
  }

 private:
  static std::size_t divide(std::size_t count, std::size_t by) { return (count + by - 1) / by; }
  [[nodiscard]] bool has_cells() const { return !mesh_.types.empty(); }
  [[nodiscard]] std::size_t points() const { return size_of(mesh_.points) / 3; }
  [[nodiscard]] const std::vector<ValueArray>& arrays_of(const ArrayAttribute& attribute) const {
    return attribute.of_cells ? mesh_.cell_values : mesh_.point_values;
  }

  std::string name_;
  const MeshArrays& mesh_;
  std::vector<ArrayAttribute> attributes_;
  std::vector<std::string> names_;
  CellValues cells_;
  MissingValues missing_;
  bool lends_ = false;
  bool whole_cells_ = false;
  std::size_t next_point_ = 0;
};

Status check_values(const std::string& name, const std::vector<ValueArray>& arrays, std::size_t count,
                    const char* what) {
  for (const ValueArray& array : arrays) {
    if (array.name.empty()) return fail(ErrorCode::invalid_argument, "{}: an array has no name: give it one", name);
    if (array.components < 1 || size_of(array.values) / static_cast<std::size_t>(array.components) != count ||
        size_of(array.values) % static_cast<std::size_t>(array.components) != 0)
      return fail(ErrorCode::invalid_argument, "{}: the array \"{}\" has {} numbers for {} {} with {} components", name,
                  array.name, size_of(array.values), count, what, array.components);
  }
  return {};
}

Status check_arrays(const std::string& name, const MeshArrays& mesh) {
  if (size_of(mesh.points) == 0) return fail(ErrorCode::invalid_argument, "{}: no points", name);
  if (size_of(mesh.points) % 3 != 0)
    return fail(ErrorCode::invalid_argument, "{}: {} coordinates are no points of 3", name, size_of(mesh.points));
  const std::size_t cells = mesh.types.size();
  const bool without_cells = cells == 0 && mesh.connectivity.empty() && mesh.offsets.size() <= 1;
  if (!without_cells && mesh.offsets.size() != cells + 1)
    return fail(ErrorCode::invalid_argument, "{}: {} offsets for {} cells: give one more than cells", name,
                mesh.offsets.size(), cells);
  if (!mesh.face_locations.empty() && mesh.face_locations.size() != cells)
    return fail(ErrorCode::invalid_argument, "{}: {} face locations for {} cells", name, mesh.face_locations.size(),
                cells);
  SPLATVOL_TRY(check_values(name, mesh.point_values, size_of(mesh.points) / 3, "points"));
  return check_values(name, mesh.cell_values, cells, "cells");
}

std::vector<NamedArray> named(const std::vector<ValueArray>& arrays) {
  std::vector<NamedArray> named;
  for (const ValueArray& array : arrays) named.push_back({array.name, array.components});
  return named;
}

}  // namespace

Result<std::unique_ptr<Source>> open_arrays(const std::string& name, const MeshArrays& mesh,
                                            const SourceOptions& options) {
  SPLATVOL_TRY(check_arrays(name, mesh));
  SPLATVOL_TRY(check_attribute_count(name, named(mesh.point_values), named(mesh.cell_values)));
  const auto all = attributes_of(named(mesh.point_values), named(mesh.cell_values), options.cells);
  if (all.empty()) return fail(ErrorCode::invalid_argument, "{}: no values at its points or cells", name);
  if (const auto duplicate = find_duplicate(names_of(all)))
    return fail(ErrorCode::invalid_argument, "{}: two attributes are called \"{}\"", name, *duplicate);
  std::string missing;
  auto attributes = select_attributes(all, options.selection, options.cells, missing);
  if (!missing.empty()) return fail_no_attribute(name, missing, names_of(all));
  return std::make_unique<ArraysSource>(name, mesh, std::move(attributes), options);
}

}  // namespace splatvol
