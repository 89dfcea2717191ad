#include "builder/sources/mesh_data.h"

#include <algorithm>
#include <string_view>
#include <variant>

#include "builder/mesh/cell_kinds.h"
#include "builder/sources/data_sets.h"

namespace splatvol {
namespace {

/// Some elements of an array: those from `first` on, of `components` numbers each.
class Elements final : public NumberArray {
 public:
  /// `values`: the numbers, if the array holds them itself.
  Elements(const Numbers& numbers, int components, std::size_t first = 0, std::vector<double> values = {})
      : values_(std::move(values)), numbers_(numbers), components_(components), first_(first) {}
  [[nodiscard]] int components() const override { return components_; }
  [[nodiscard]] std::uint64_t size() const override {
    return std::visit([](const auto& span) { return span.size(); }, numbers_) / static_cast<std::size_t>(components_) -
           first_;
  }

  void read(int component, std::span<const std::uint32_t> elements, std::span<double> values) const override {
    const auto stride = static_cast<std::size_t>(components_), offset = static_cast<std::size_t>(component);
    std::visit(
        [&](const auto& numbers) {
          for (std::size_t i = 0; i < elements.size(); ++i)
            values[i] = static_cast<double>(numbers[(first_ + elements[i]) * stride + offset]);
        },
        numbers_);
  }

 private:
  std::vector<double> values_;
  Numbers numbers_;
  int components_;
  std::size_t first_;
};

}  // namespace

MeshDataSet::MeshDataSet(MeshData mesh) : own_(std::move(mesh)), count_(own_.points.size()) {
  view_.points = std::span(count_ == 0 ? nullptr : &own_.points[0].x, 3 * count_);
  view_.connectivity = own_.connectivity;
  view_.offsets = own_.offsets;
  view_.types = own_.types;
  view_.faces = own_.faces;
  view_.face_locations = own_.face_locations;
  for (auto& [shape, values] : std::exchange(own_.arrays, {})) add_array(std::move(shape), std::move(values));
}

MeshDataSet::MeshDataSet(const MeshArrays& mesh, std::size_t first, std::size_t count)
    : view_(mesh), first_(first), count_(count) {
  for (const bool of_cells : {false, true})
    for (const ValueArray& array : of_cells ? mesh.cell_values : mesh.point_values)
      arrays_.emplace_back(ArrayShape{array.name, array.components, of_cells, array.unit},
                           std::make_shared<Elements>(array.values, array.components, of_cells ? 0 : first));
}

void MeshDataSet::read_points(std::span<dvec3> points) const {
  std::visit(
      [&](const auto& numbers) {
        for (std::size_t i = 0; i < points.size(); ++i) {
          const auto* position = numbers.data() + 3 * (first_ + i);
          points[i] = {position[0], position[1], position[2]};
        }
      },
      view_.points);
}

Status MeshDataSet::check_cells(const std::string& name) const {
  const auto& offsets = view_.offsets;
  const bool fit = offsets.empty() || (offsets.front() >= 0 && std::ranges::is_sorted(offsets) &&
                                       static_cast<std::uint64_t>(offsets.back()) <= view_.connectivity.size());
  if (fit) return {};
  return fail(ErrorCode::invalid_argument,
              "{}: the offsets of the cells do not rise up to the {} numbers of the connectivity", name,
              view_.connectivity.size());
}

void MeshDataSet::append_points(std::uint64_t cell, std::vector<std::int64_t>& points) const {
  const auto begin = view_.connectivity.begin();
  points.insert(points.end(), begin + view_.offsets[cell], begin + view_.offsets[cell + 1]);
}

// In halves: a digit for each axis, in VTK's order.
std::vector<dvec3> MeshDataSet::parametric_points(int type, std::size_t count) const {
  constexpr std::string_view hexahedron =
      "000200220020002202222022100210120010102212122012001201221021011211101121110112111";
  constexpr std::string_view wedge = "000200020002202022100110010102112012001201021101111011";
  const std::string_view digits = type == vtk_cell::triquadratic_hexahedron ? hexahedron
                                  : type == vtk_cell::biquadratic_wedge     ? wedge
                                                                            : std::string_view();
  std::vector<dvec3> points;
  for (std::size_t at = 0; digits.size() == 3 * count && at < digits.size(); at += 3) {
    const auto half = [&](std::size_t axis) { return (digits[at + axis] - '0') / 2.0; };
    points.emplace_back(half(0), half(1), half(2));
  }
  return points;
}

std::vector<ArrayShape> MeshDataSet::arrays() const {
  std::vector<ArrayShape> shapes;
  for (const auto& [shape, numbers] : arrays_)
    if (!is_bookkeeping(shape.name)) shapes.push_back(shape);
  return shapes;
}

std::optional<std::shared_ptr<const NumberArray>> MeshDataSet::array(const std::string& name, bool of_cells) const {
  for (const auto& [shape, numbers] : arrays_)
    if (shape.of_cells == of_cells && shape.name == name) return numbers;
  return std::nullopt;
}

void MeshDataSet::add_cell_values(const std::string& name, std::vector<double> values) {
  add_array({.name = name, .of_cells = true}, std::move(values));
}

void MeshDataSet::add_array(ArrayShape shape, std::vector<double> values) {
  const std::span<const double> numbers = values;  // they stay where they are
  auto array = std::make_shared<Elements>(numbers, shape.components, 0, std::move(values));
  for (auto& [known, of_known] : arrays_)
    if (known.of_cells == shape.of_cells && known.name == shape.name) {
      of_known = std::move(array);
      return;
    }
  arrays_.emplace_back(std::move(shape), std::move(array));
}

}  // namespace splatvol
