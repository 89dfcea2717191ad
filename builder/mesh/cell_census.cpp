#include "builder/mesh/cell_census.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string_view>

namespace splatvol {

CellCensus& CellCensus::operator+=(const CellCensus& other) {
  for (const auto& [name, count] : other.cells) cells[name] += count;
  std::apply(
      [&](auto&... sums) { std::apply([&](const auto&... numbers) { ((sums += numbers), ...); }, numbers_of(other)); },
      numbers_of(*this));
  rounded_by = std::max(rounded_by, other.rounded_by);
  losses.insert(other.losses.begin(), other.losses.end());
  return *this;
}

std::string describe_no_volume(const CellCensus& census) {
  constexpr std::array<std::string_view, 3> points = {"empty", "vertex", "poly-vertex"};
  std::uint64_t all = 0;
  std::string counts;
  for (const auto& [name, count] : census.cells) {
    all += count;
    if (std::ranges::find(points, name) != points.end()) continue;
    counts += fmt::format("{}{} {}{}", counts.empty() ? "" : ", ", count, name, count == 1 ? "" : "s");
  }
  if (census.tetrahedra > census.flat || counts.empty()) return {};
  if (census.non_finite > 0 && census.non_finite + census.without_volume == all)
    return fmt::format("every cell has coordinates beyond 1e50, or that are not finite ({})", counts);
  if (all > census.without_volume) return fmt::format("no cell fills a volume ({})", counts);
  const char* kinds = census.surfaces == 0 ? "lines" : census.lines == 0 ? "surface cells" : "surface cells and lines";
  return fmt::format("only {} ({})", kinds, counts);
}

}  // namespace splatvol
