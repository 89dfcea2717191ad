#include "builder/generator.h"

#include <fmt/ranges.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <tuple>

#include "base/names.h"
#include "builder/piece_ahead.h"

namespace splatvol {
namespace {

constexpr std::string_view prefix = "gen:";
constexpr double infinity = std::numeric_limits<double>::infinity();

constexpr dvec3 box_low{-2, -2, -1};
constexpr dvec3 box_size{4, 4, 2};

constexpr double ring_radius = 1.2;    // of the circle that the strands follow
constexpr double strand_radius = 0.5;  // of the strands' way round it
constexpr double core_width = 0.1;

// The vortex's points lie round the strands with a density of 1 / (1 + (d / near)^2)^2 up to the distance `far`, which
// B still holds.
constexpr double near = 0.05;
constexpr double far = 0.3;

/// Independent random numbers by their place, SplitMix64 (Steele, Lea and Flood 2014) entered anywhere.
class Random {
 public:
  explicit Random(std::uint64_t seed) : key_(mix(seed)) {}

  /// In [0, 1), a multiple of 2^-53. At most 8 to a point.
  [[nodiscard]] double at(std::uint64_t point, std::uint64_t number) const {
    constexpr std::uint64_t golden = 0x9E3779B97F4A7C15;
    return static_cast<double>(mix(key_ + golden * (8 * point + number)) >> 11) * 0x1p-53;
  }
  [[nodiscard]] dvec3 vector_at(std::uint64_t point) const { return {at(point, 0), at(point, 1), at(point, 2)}; }

 private:
  static std::uint64_t mix(std::uint64_t z) {
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9;
    z = (z ^ z >> 27) * 0x94D049BB133111EB;
    return z ^ z >> 31;
  }

  std::uint64_t key_;
};

/// The direction whose angle is half as large again.
struct Turn {
  double cos, sin;
  double cos_half, sin_half;

  [[nodiscard]] dvec2 one_and_a_half() const {
    return {cos * cos_half - sin * sin_half, sin * cos_half + cos * sin_half};
  }
};

/// Half angles without cancellation; which of both halves makes no difference, as the strands are opposite.
Turn turn_of(double x, double y, double r) {
  if (r == 0) return {1, 0, 1, 0};
  const double cos = x / r, sin = y / r;
  const double larger = std::sqrt((1 + std::abs(cos)) / 2), smaller = sin / (2 * larger);
  return cos >= 0 ? Turn{cos, sin, larger, smaller} : Turn{cos, sin, smaller, larger};
}

dvec3 vortex_point(const Random& random, std::uint64_t point) {
  if (random.at(point, 3) < 0.125) return box_low + box_size * random.vector_at(point);
  // Twice round: once along each strand.
  const double half = 2 * std::numbers::pi * random.at(point, 0);
  const double c = std::cos(half), s = std::sin(half);
  const Turn turn{c * c - s * s, 2 * s * c, c, s};
  // The share of points within d is d^2 / (d^2 + near^2), but for a factor.
  const double share = random.at(point, 1) * (far * far / (far * far + near * near));
  const double distance = near * std::sqrt(share / (1 - share));
  const double angle = 2 * std::numbers::pi * random.at(point, 2);
  const dvec2 across = strand_radius * turn.one_and_a_half() + distance * dvec2(std::cos(angle), std::sin(angle));
  const double r = ring_radius + across.x;
  return {r * turn.cos, r * turn.sin, across.y};
}

dvec3 point_of(Distribution distribution, const Random& random, std::uint64_t point) {
  constexpr dvec3 on_strand{ring_radius + strand_radius, 0, 0};
  const dvec3 u = random.vector_at(point);
  const bool second = random.at(point, 3) < 0.5;
  switch (distribution) {
    case Distribution::uniform:
      return box_low + box_size * u;
    case Distribution::vortex:
      return vortex_point(random, point);
    case Distribution::half_tiny:
      return second ? on_strand + 1e-3 * box_size * (u - 0.5) : box_low + box_size * u;
    case Distribution::equal:
      return on_strand;
    case Distribution::two_clusters:
      return box_low + box_size * u + dvec3(second ? 1e9 * box_size.x : 0, 0, 0);
    case Distribution::line:
      return dvec3(4, 2, 1) * (u.x - 0.5);  // without rounding
    case Distribution::layer:
      break;
  }
  return {box_low.x + box_size.x * u.x, box_low.y + box_size.y * u.y, std::exp(-8 * std::numbers::ln10 * u.z)};
}

/// Through memory, as GCC 12 leaves out the rounding of two neighbours to float and back (-ftree-slp-vectorize).
double to_float(double value) {
  const volatile float rounded = static_cast<float>(value);
  return static_cast<double>(rounded);
}

const std::vector<std::string>& value_only() {
  static const std::vector<std::string> names = {"value"};
  return names;
}

class PointGenerator final : public Source {
 public:
  explicit PointGenerator(const PointRecipe& recipe)
      : recipe_(recipe),
        random_(recipe.seed),
        pieces_(static_cast<std::size_t>((recipe.count + max_piece_points - 1) / max_piece_points),
                [this](std::size_t piece) { return make_piece(piece); }) {}

  const std::vector<std::string>& attributes() const override { return value_only(); }
  std::size_t piece_count() const override { return pieces_.count(); }
  Result<std::unique_ptr<Piece>> next() override { return pieces_.next(); }
  std::optional<std::uint64_t> point_count() const override { return recipe_.count; }
  bool single_precision() const override { return recipe_.single_precision; }
  bool may_have_cells() const override { return false; }

  Result<std::optional<Box>> bounds() override {
    std::vector<Box> boxes(piece_count(), Box{dvec3(infinity), dvec3(-infinity)});
    tbb::parallel_for(std::size_t{0}, boxes.size(), [&](std::size_t piece) {
      Box& box = boxes[piece];
      for (std::uint64_t i = begin(piece); i < begin(piece + 1); ++i) {
        const dvec3 p = position(i);
        box = {glm::min(box.low, p), glm::max(box.high, p)};
      }
    });
    Box all = boxes.front();
    for (const Box& box : boxes) all = {glm::min(all.low, box.low), glm::max(all.high, box.high)};
    return std::optional(all);
  }

 private:
  [[nodiscard]] std::uint64_t begin(std::size_t piece) const {
    return std::min<std::uint64_t>(recipe_.count, std::uint64_t{piece} * max_piece_points);
  }

  [[nodiscard]] dvec3 position(std::uint64_t point) const {
    const dvec3 p = point_of(recipe_.distribution, random_, point);
    return recipe_.single_precision ? dvec3(to_float(p.x), to_float(p.y), to_float(p.z)) : p;
  }

  [[nodiscard]] std::unique_ptr<Piece> make_piece(std::size_t index) const {
    const std::uint64_t first = begin(index);
    const auto count = static_cast<std::size_t>(begin(index + 1) - first);
    auto piece = std::make_unique<Piece>();
    piece->points.resize(count);
    piece->values.assign(1, std::vector<double>(count));
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 4096), [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); ++i) {
        piece->points[i] = position(first + i);
        const double value = generated_field(piece->points[i]);
        piece->values[0][i] = recipe_.single_precision ? to_float(value) : value;
      }
    });
    return piece;
  }

  PointRecipe recipe_;
  Random random_;
  PieceAhead pieces_;
};

/// Hexahedra from one place to another along each axis.
struct Block {
  std::array<std::uint64_t, 3> begin, end;

  /// Vertices along an axis.
  [[nodiscard]] std::size_t vertices(std::size_t axis) const {
    return static_cast<std::size_t>(end[axis] - begin[axis] + 1);
  }
};

class MeshGenerator final : public Source {
 public:
  /// n^3 hexahedra in parts[axis] pieces along each axis.
  MeshGenerator(std::uint64_t n, std::array<std::uint64_t, 3> parts)
      : n_(n),
        parts_(parts),
        pieces_(static_cast<std::size_t>(parts[0] * parts[1] * parts[2]),
                [this](std::size_t piece) { return make_piece(block(piece)); }) {
    for (int axis = 0; axis < 3; ++axis) {
      const double growth = std::exp2(axis);  // logarithm of the last spacing over the first
      for (std::uint64_t i = 0; i <= n; ++i) {
        const double u = static_cast<double>(i) / static_cast<double>(n);
        const double place = box_low[axis] + box_size[axis] * (std::expm1(growth * u) / std::expm1(growth));
        coordinates_[static_cast<std::size_t>(axis)].push_back(place);
      }
    }
  }

  const std::vector<std::string>& attributes() const override { return value_only(); }
  std::size_t piece_count() const override { return pieces_.count(); }
  Result<std::unique_ptr<Piece>> next() override { return pieces_.next(); }
  Result<std::optional<Box>> bounds() override { return std::optional(Box{vertex(0, 0, 0), vertex(n_, n_, n_)}); }
  std::optional<std::uint64_t> point_count() const override {
    return (n_ + parts_[0]) * (n_ + parts_[1]) * (n_ + parts_[2]);
  }

 private:
  [[nodiscard]] dvec3 vertex(std::uint64_t x, std::uint64_t y, std::uint64_t z) const {
    return {coordinates_[0][x], coordinates_[1][y], coordinates_[2][z]};
  }

  [[nodiscard]] Block block(std::uint64_t piece) const {
    Block block{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::uint64_t part = piece % parts_[axis];
      piece /= parts_[axis];
      block.begin[axis] = n_ * part / parts_[axis];
      block.end[axis] = n_ * (part + 1) / parts_[axis];
    }
    return block;
  }

  [[nodiscard]] std::unique_ptr<Piece> make_piece(const Block& block) const {
    const std::size_t width = block.vertices(0), height = block.vertices(1), depth = block.vertices(2);
    auto piece = std::make_unique<Piece>();
    piece->points.resize(width * height * depth);
    piece->values.assign(1, std::vector<double>(piece->points.size()));
    piece->tetrahedra.resize(6 * (width - 1) * (height - 1) * (depth - 1));
    tbb::parallel_for(std::size_t{0}, depth, [&](std::size_t z) {
      for (std::size_t y = 0; y < height; ++y) add_row(block, y, z, *piece);
    });
    piece->census.cells["tetrahedron"] = piece->census.tetrahedra = piece->tetrahedra.size();
    return piece;
  }

  /// A row of vertices and the hexahedra above them, which the last rows have not.
  void add_row(const Block& block, std::size_t y, std::size_t z, Piece& piece) const {
    const std::size_t width = block.vertices(0), height = block.vertices(1);
    const std::size_t first = (z * height + y) * width;
    for (std::size_t x = 0; x < width; ++x) {
      piece.points[first + x] = vertex(block.begin[0] + x, block.begin[1] + y, block.begin[2] + z);
      piece.values[0][first + x] = to_float(generated_field(piece.points[first + x]));
    }
    if (y + 1 == height || z + 1 == block.vertices(2)) return;
    auto* tetrahedron = &piece.tetrahedra[6 * (z * (height - 1) + y) * (width - 1)];
    // From the lowest corner to the highest along three edges, in each order of the axes; neighbours agree (Kuhn 1960).
    const std::array<std::size_t, 3> step = {1, width, width * height};
    for (std::size_t x = 0; x + 1 < width; ++x)
      for (const auto& [a, b, is_even] :
           {std::tuple{0, 1, true}, {1, 2, true}, {2, 0, true}, {0, 2, false}, {2, 1, false}, {1, 0, false}}) {
        const std::size_t low = first + x, second = low + step[static_cast<std::size_t>(a)];
        const std::size_t third = second + step[static_cast<std::size_t>(b)], high = low + step[0] + step[1] + step[2];
        const auto index = [](std::size_t i) { return static_cast<std::uint32_t>(i); };
        *tetrahedron++ = {index(low), index(second), index(is_even ? third : high), index(is_even ? high : third)};
      }
  }

  std::uint64_t n_;
  std::array<std::uint64_t, 3> parts_;
  std::array<std::vector<double>, 3> coordinates_;  // [axis][vertex along it]
  PieceAhead pieces_;
};

/// Three factors, the largest as small as can be, in descending order.
std::array<std::uint64_t, 3> most_cubic_factors(std::uint64_t number) {
  std::array<std::uint64_t, 3> best = {number, 1, 1};
  for (std::uint64_t a = 1; a * a * a <= number; ++a)
    for (std::uint64_t b = a; number % a == 0 && a * b * b <= number; ++b)
      if (number / a % b == 0 && number / a / b < best[0]) best = {number / a / b, b, a};
  return best;
}

/// The settings in "key=value,key=value".
Result<std::map<std::string, std::string>> parse_settings(std::string_view text, const std::vector<std::string>& keys) {
  std::map<std::string, std::string> settings;
  for (bool more = true; more;) {
    const std::size_t end = text.find(',');
    const std::string_view setting = text.substr(0, end);
    more = end != std::string_view::npos;
    if (more) text.remove_prefix(end + 1);
    const std::size_t equal = setting.find('=');
    const std::string key(setting.substr(0, equal));
    if (equal == std::string_view::npos || std::ranges::find(keys, key) == keys.end())
      return fail(ErrorCode::invalid_argument, "'{}' is not one of the settings {}=...", setting,
                  fmt::join(keys, "=..., "));
    if (!settings.emplace(key, setting.substr(equal + 1)).second)
      return fail(ErrorCode::invalid_argument, "{} is set twice", key);
  }
  return settings;
}

Result<std::uint64_t> parse_seed(const std::string& text) {
  std::uint64_t seed = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, seed);
  if (error != std::errc{} || stop != end) return fail(ErrorCode::invalid_argument, "'{}' is not a seed", text);
  return seed;
}

Result<PointRecipe> parse_points(std::string_view text) {
  SPLATVOL_TRY_ASSIGN(settings, parse_settings(text, {"count", "distribution", "seed", "type"}));
  PointRecipe recipe;
  SPLATVOL_TRY_ASSIGN(count, parse_count(settings["count"]));
  recipe.count = count;
  if (settings.contains("seed")) {
    SPLATVOL_TRY_ASSIGN(seed, parse_seed(settings["seed"]));
    recipe.seed = seed;
  }
  if (settings.contains("distribution")) {
    const auto& names = distribution_names();
    const auto name = std::ranges::find(names, settings["distribution"]);
    if (name == names.end())
      return fail(ErrorCode::invalid_argument, "'{}' is not one of the distributions {}", settings["distribution"],
                  fmt::join(names, ", "));
    recipe.distribution = static_cast<Distribution>(name - names.begin());
  }
  if (settings.contains("type")) {
    recipe.single_precision = settings["type"] == "float32";
    if (!recipe.single_precision && settings["type"] != "float64")
      return fail(ErrorCode::invalid_argument, "'{}' is neither float32 nor float64", settings["type"]);
  }
  return recipe;
}

Result<MeshRecipe> parse_mesh(std::string_view text) {
  SPLATVOL_TRY_ASSIGN(settings, parse_settings(text, {"cells", "pieces"}));
  MeshRecipe recipe;
  SPLATVOL_TRY_ASSIGN(cells, parse_count(settings["cells"]));
  recipe.cells = cells;
  if (settings.contains("pieces")) {
    SPLATVOL_TRY_ASSIGN(pieces, parse_count(settings["pieces"]));
    recipe.pieces = pieces;
  }
  return recipe;
}

Result<std::unique_ptr<Source>> parse_input(std::string_view text) {
  constexpr std::string_view points = "gen:points:", mesh = "gen:mesh:";
  if (text.starts_with(points)) {
    SPLATVOL_TRY_ASSIGN(recipe, parse_points(text.substr(points.size())));
    return generate_points(recipe);
  }
  if (text.starts_with(mesh)) {
    SPLATVOL_TRY_ASSIGN(recipe, parse_mesh(text.substr(mesh.size())));
    return generate_mesh(recipe);
  }
  return fail(ErrorCode::invalid_argument, "neither {}... nor {}...", points, mesh);
}

}  // namespace

double generated_field(const dvec3& p) {
  const double r = std::sqrt(p.x * p.x + p.y * p.y);
  const dvec2 place(r - ring_radius, p.z);
  const dvec2 strand = strand_radius * turn_of(p.x, p.y, r).one_and_a_half();
  const auto core = [](dvec2 offset) { return std::exp(-glm::dot(offset, offset) / (core_width * core_width)); };
  return core(place - strand) + core(place + strand) + p.x / (10 * std::sqrt(4 + glm::dot(p, p)));
}

const std::vector<std::string>& distribution_names() {
  static const std::vector<std::string> names = {"uniform",      "vortex", "half-tiny", "equal",
                                                 "two-clusters", "line",   "layer"};
  return names;
}

std::unique_ptr<Source> generate_points(const PointRecipe& recipe) { return std::make_unique<PointGenerator>(recipe); }

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
    return fail(ErrorCode::invalid_argument, "{} pieces of {}^3 hexahedra: no blocks of {}", recipe.pieces, n,
                fmt::join(parts, " x "));
  std::uint64_t largest = 6;  // tetrahedra in a piece
  for (const std::uint64_t count : parts) largest *= (n + count - 1) / count;
  if (largest > std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::invalid_argument, "pieces of {} tetrahedra are too large", largest);
  return std::make_unique<MeshGenerator>(n, parts);
}

bool is_generated(std::string_view input) { return input.starts_with(prefix); }

Result<std::unique_ptr<Source>> open_generated(const std::string& input, const SourceOptions& options) {
  auto source = parse_input(input);
  if (!source) return fail_in(input, source.error());
  if (!options.columns.empty())
    return fail(ErrorCode::invalid_argument, "{}: not a .npy file, so its columns cannot be named", input);
  for (const std::string& name : options.selection)
    if (name != "value") return fail_no_attribute(input, name, value_only());
  return source;
}

Result<std::uint64_t> parse_count(const std::string& text) {
  double count = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, count);
  if (error != std::errc{} || stop != end || !(count >= 1 && count <= 1e12) || count != std::floor(count))
    return fail(ErrorCode::invalid_argument, "'{}' is not a whole number from 1 to 1e12 such as 1000 or 1e8", text);
  return static_cast<std::uint64_t>(count);
}

}  // namespace splatvol
