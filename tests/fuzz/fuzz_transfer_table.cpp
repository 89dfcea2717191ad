// Tables of transfer functions with up to 4096 control points, equal and far apart, on each axis of any domain: numbers
// that stay within those of the function, and grow with its extinction.
#include <algorithm>
#include <cmath>

#include "renderer/transfer_table.h"
#include "tests/fuzz/fuzz.h"

using namespace splatvol;
using splatvol::fuzz::require;

namespace {

constexpr double most_light = 1e4, most_extinction = 1e30;

// A number of [0, most], over many decades; exactly 0 and `most` too.
double number(fuzz::Input& input, double most) {
  const auto byte = input.take<std::uint8_t>();
  if (byte % 4 == 0) return byte == 0 ? 0 : most;
  return most * std::pow(10.0, -0.25 * byte);
}

TransferFunction take_function(fuzz::Input& input) {
  TransferFunction function;
  function.axis = static_cast<ValueAxis>(input.take_in(0, 2));
  const double edge = number(input, 1e30), width = number(input, 1e30);
  function.lo = function.axis == ValueAxis::log ? edge + 1e-30 : -edge;
  function.hi = function.lo + width;
  function.linear_width = number(input, 1e30) + 1e-30;
  const auto count = [&] { return input.take_in(1, 1u << input.take_in(0, 12)); };  // often few: they are quick
  const auto colors = count(), densities = count();
  const auto step = [&](double t) {
    return std::min(1.0, t + input.take<std::uint8_t>() / 255.0 / (colors + densities));
  };
  double t = 0;
  for (std::uint32_t i = 0; i < colors; ++i, t = step(t))
    function.colors.push_back({t, {number(input, most_light), number(input, 1), number(input, 1)}});
  t = 0;
  for (std::uint32_t i = 0; i < densities; ++i, t = step(t))
    function.densities.push_back({t, number(input, most_extinction)});
  return function;
}

double largest_extinction(const TransferFunction& function) {
  return std::ranges::max(function.densities, {}, &TransferFunction::Density::extinction).extinction;
}

void check_entries(const TransferFunction& function, const TransferTable& table) {
  const double most = largest_extinction(function) * (1 + 1e-5);
  for (const vec4& entry : table.entries) {
    for (int i = 0; i < 4; ++i) require(std::isfinite(entry[i]) && entry[i] >= 0, "entries are finite");
    require(entry.a <= most, "a mean is not above the largest extinction");
    require(std::max({entry.r, entry.g, entry.b}) <= most_light * (1 + 1e-5), "a mean is not above all colours");
  }
}

// Four times the extinction: the same colours, and four times the means.
void check_growth(TransferFunction function, const TransferTable& table) {
  for (TransferFunction::Density& density : function.densities) density.extinction *= 4;
  const TransferTable grown = make_transfer_table(function, table.columns, table.rows);
  const double rounding = 1e-6 * largest_extinction(function);
  for (std::size_t i = 0; i < table.entries.size(); ++i) {
    require(std::abs(grown.entries[i].a - 4.0 * table.entries[i].a) <= rounding, "means grow with the extinction");
    require(glm::distance(vec3(grown.entries[i]), vec3(table.entries[i])) <= 1e-3 * most_light, "colours stay");
  }
}

void check_peaks(const TransferFunction& function) {
  const auto levels = make_peak_levels(function, 64);
  require(levels.size() == 7 && levels.back().size() == 1, "levels end in one entry");
  for (int i = 0; i < 1000; ++i) {
    const double t = i / 1000.0;
    const double extinction = function.extinction_at(t) * (1 - 1e-5);
    for (const auto& level : levels)
      require(level[static_cast<std::size_t>(t * static_cast<double>(level.size()))] >= extinction,
              "a peak is not below the extinction");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Input input(fuzz::bytes_of(data, size));
  const std::size_t columns = input.take_in(34, 80), rows = input.take_in(1, 8);
  const TransferFunction function = take_function(input);
  if (!(function.t_of(function.hi) > 0)) return 0;  // no interval of the axis: a scene with it is refused
  const TransferTable table = make_transfer_table(function, columns, rows);
  require(table.entries.size() == columns * rows, "a table has all entries");
  check_entries(function, table);
  check_growth(function, table);
  check_peaks(function);
  return 0;
}
