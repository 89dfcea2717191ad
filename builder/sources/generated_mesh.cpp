#include <fmt/ranges.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>

#include "builder/sources/generated_field.h"
#include "builder/sources/generator.h"
#include "builder/sources/piece_ahead.h"

namespace splatvol {
namespace {

using generated::box_low;
using generated::box_size;
using generated::to_float;

/// The hexahedra of a piece: from begin[axis] to before end[axis] along each axis.
struct PieceBox {
  std::array<std::uint64_t, 3> begin, end;

  [[nodiscard]] std::size_t points(std::size_t axis) const {
    return static_cast<std::size_t>(end[axis] - begin[axis] + 1);
  }
};

class MeshGenerator final : public Source {
 public:
  /// Makes n^3 hexahedra, in parts[axis] pieces along each axis.
  MeshGenerator(std::uint64_t n, std::array<std::uint64_t, 3> parts)
      : n_(n),
        parts_(parts),
        pieces_(static_cast<std::size_t>(parts[0] * parts[1] * parts[2]),
                [this](std::size_t piece) { return make_piece(box_of(piece)); }) {
    for (int axis = 0; axis < 3; ++axis) {
      const double growth = std::exp2(axis);  // logarithm of the last spacing over the first
      for (std::uint64_t i = 0; i <= n; ++i) {
        const double u = static_cast<double>(i) / static_cast<double>(n);
        const double coordinate = box_low[axis] + box_size[axis] * (std::expm1(growth * u) / std::expm1(growth));
        coordinates_[static_cast<std::size_t>(axis)].push_back(coordinate);
      }
    }
  }

  const std::vector<std::string>& attributes() const override { return generated::attributes(); }
  std::size_t piece_count() const override { return pieces_.count(); }
  std::vector<std::uint64_t> part_sizes() override { return std::vector<std::uint64_t>(pieces_.count(), 1); }
  Status select(const std::vector<std::uint64_t>& parts) override {
    pieces_.select(parts);
    return {};
  }
  PieceNumber piece_number() const override { return {0, static_cast<std::uint32_t>(pieces_.last())}; }
  Result<std::unique_ptr<Piece>> next() override { return pieces_.next(); }
  Result<std::optional<Box>> bounds() override { return std::optional(Box{position(0, 0, 0), position(n_, n_, n_)}); }
  std::optional<std::uint64_t> point_count() const override {
    return (n_ + parts_[0]) * (n_ + parts_[1]) * (n_ + parts_[2]);
  }

 private:
  [[nodiscard]] dvec3 position(std::uint64_t x, std::uint64_t y, std::uint64_t z) const {
    return {coordinates_[0][x], coordinates_[1][y], coordinates_[2][z]};
  }

  [[nodiscard]] PieceBox box_of(std::uint64_t piece) const {
    PieceBox box{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::uint64_t part = piece % parts_[axis];
      piece /= parts_[axis];
      box.begin[axis] = n_ * part / parts_[axis];
      box.end[axis] = n_ * (part + 1) / parts_[axis];
    }
    return box;
  }

  [[nodiscard]] std::unique_ptr<Piece> make_piece(const PieceBox& box) const {
    const std::size_t width = box.points(0), height = box.points(1), depth = box.points(2);
    auto piece = std::make_unique<Piece>();
    piece->points.resize(width * height * depth);
    piece->values.assign(1, std::vector<double>(piece->points.size()));
    piece->tetrahedra.resize(6 * (width - 1) * (height - 1) * (depth - 1));
    tbb::parallel_for(std::size_t{0}, depth, [&](std::size_t z) {
      for (std::size_t y = 0; y < height; ++y) add_line(box, y, z, *piece);
    });
    piece->census.cells["tetrahedron"] = piece->census.tetrahedra = piece->tetrahedra.size();
    return piece;
  }

  /// Adds a line of points along x, and the hexahedra above it; the last lines have none.
  void add_line(const PieceBox& box, std::size_t y, std::size_t z, Piece& piece) const {
    const std::size_t width = box.points(0), height = box.points(1);
    const std::size_t first = (z * height + y) * width;
    for (std::size_t x = 0; x < width; ++x) {
      piece.points[first + x] = position(box.begin[0] + x, box.begin[1] + y, box.begin[2] + z);
      piece.values[0][first + x] = to_float(generated_field(piece.points[first + x]));
    }
    if (y + 1 == height || z + 1 == box.points(2)) return;
    auto* tetrahedron = &piece.tetrahedra[6 * (z * (height - 1) + y) * (width - 1)];
    // Each tetrahedron goes from the lowest corner to the highest along three edges, in one of the six orders of the
    // axes. Neighbours agree (Kuhn 1960).
    const std::array<std::size_t, 3> stride = {1, width, width * height};
    for (std::size_t x = 0; x + 1 < width; ++x)
      for (const auto& [a, b, is_even] :
           {std::tuple{0, 1, true}, {1, 2, true}, {2, 0, true}, {0, 2, false}, {2, 1, false}, {1, 0, false}}) {
        const std::size_t low = first + x, second = low + stride[static_cast<std::size_t>(a)];
        const std::size_t third = second + stride[static_cast<std::size_t>(b)],
                          high = low + stride[0] + stride[1] + stride[2];
        const auto index = [](std::size_t i) { return static_cast<std::uint32_t>(i); };
        *tetrahedron++ = {index(low), index(second), index(is_even ? third : high), index(is_even ? high : third)};
      }
  }

  std::uint64_t n_;
  std::array<std::uint64_t, 3> parts_;
  std::array<std::vector<double>, 3> coordinates_;  // [axis][point along it]
  PieceAhead pieces_;
};

/// Three factors of a number, in descending order, the largest as small as possible.
std::array<std::uint64_t, 3> most_cubic_factors(std::uint64_t number) {
  std::array<std::uint64_t, 3> best = {number, 1, 1};
  for (std::uint64_t a = 1; a * a * a <= number; ++a)
    for (std::uint64_t b = a; number % a == 0 && a * b * b <= number; ++b)
      if (number / a % b == 0 && number / a / b < best[0]) best = {number / a / b, b, a};
  return best;
}

}  // namespace

Result<std::unique_ptr<Source>> generate_mesh(const MeshRecipe& recipe) {
  const auto n =
      static_cast<std::uint64_t>(std::max(1.0, std::round(std::cbrt(static_cast<double>(recipe.cells) / 6))));
  std::array<std::uint64_t, 3> parts{};
  constexpr std::uint64_t most_along_an_axis = 63;
  static_assert((most_along_an_axis + 1) * (most_along_an_axis + 1) * (most_along_an_axis + 1) <= max_piece_points);
  parts.fill((n + most_along_an_axis - 1) / most_along_an_axis);
  constexpr std::uint64_t most_pieces = 1'000'000;
  if (recipe.pieces > most_pieces)
    return fail(ErrorCode::invalid_argument, "{} pieces; at most {} can be asked for", recipe.pieces, most_pieces);
  if (recipe.pieces > 0) parts = most_cubic_factors(recipe.pieces);
  if (parts[0] > n)
    return fail(ErrorCode::invalid_argument, "{} pieces of {}^3 hexahedra: too few for {} parts", recipe.pieces, n,
                fmt::join(parts, " x "));
  std::uint64_t largest = 6;  // tetrahedra in a piece
  for (const std::uint64_t count : parts) largest *= (n + count - 1) / count;
  if (largest > std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::invalid_argument, "pieces of {} tetrahedra are too large", largest);
  return std::make_unique<MeshGenerator>(n, parts);
}

}  // namespace splatvol
