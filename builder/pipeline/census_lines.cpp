#include "builder/pipeline/census_lines.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <set>
#include <utility>

namespace splatvol {
namespace {

// Coordinates have fewer steps between neighbouring points than this: cells would be visibly bent.
constexpr double fewest_steps = 64;

// Steps of double precision near this number.
double step_at(double number) {
  return std::nextafter(std::abs(number), std::numeric_limits<double>::infinity()) - std::abs(number);
}

void warn_of_positions(const InputSummary& input, std::vector<std::string>& warnings) {
  const dvec3 extent = input.box.high - input.box.low;
  const double edge = std::max({extent.x, extent.y, extent.z});
  const double spacing = edge / std::cbrt(static_cast<double>(std::max<std::uint64_t>(input.census.read, 1)));
  double farthest = 0;
  for (int axis = 0; axis < 3; ++axis)
    farthest = std::max({farthest, std::abs(input.box.low[axis]), std::abs(input.box.high[axis])});
  if (edge == 0 || step_at(farthest) * fewest_steps <= spacing) return;
  warnings.push_back(
      fmt::format("coordinates reach {:g}, where double precision has steps of {:.2g}, and points lie about {:.2g} "
                  "apart: subtract an offset from the coordinates before they are written",
                  farthest, step_at(farthest), spacing));
}

// A reader gave coordinates of single precision, though the file has more digits.
void warn_of_rounding(const InputSummary& input, std::vector<std::string>& warnings) {
  constexpr double bent_share = 1e-6;
  const CellCensus& cells = input.cells;
  const bool bent = cells.bent_volume > bent_share * cells.measured_volume;
  if (!bent && cells.flattened == 0) return;
  warnings.push_back(
      fmt::format("the reader rounds coordinates to single precision: that bends {} tetrahedra by more than 1/64 of "
                  "their heights and makes {} flat: subtract an offset from the coordinates before they are written",
                  bent ? cells.bent : 0, cells.flattened));
}

}  // namespace

std::vector<CensusLine> census_lines(const BuildReport& report) {
  const CellCensus& cells = report.cells;
  const PointCensus& points = report.points;
  std::vector<CensusLine> lines;
  for (const auto& [type, count] : cells.cells) lines.push_back({"cells: " + type, count});
  lines.push_back({"tetrahedra", cells.tetrahedra});
  lines.push_back({"tetrahedra inverted (absolute volume used)", cells.inverted, true});
  lines.push_back({"tetrahedra flat", cells.flat});
  lines.push_back({"cells without volume", cells.without_volume});
  lines.push_back({"cells of blocks that are surfaces (left out)", cells.left_out});
  lines.push_back({"cells without volume left out (flat)", cells.left_out_flat, true});
  lines.push_back({"cells hidden (blanked or ghost)", cells.hidden});
  lines.push_back({"points hidden (blanked or ghost)", cells.hidden_points});
  lines.push_back({"cells with more nodes than corners (corners taken)", cells.more_nodes, true});
  lines.push_back({"cells that are not star-shaped", cells.not_star_shaped, true});
  lines.push_back({"points with a coordinate that is not finite, a fill value, or far beyond all others (dropped)",
                   points.not_finite, true});
  lines.push_back({"cells with such a corner (left out)", cells.non_finite, true});
  lines.push_back({"points merged (same position and values, in cells)", points.merged - points.unlike});
  lines.push_back(
      {"points of several pieces merged though their values differ (the first one's kept)", points.unlike, true});
  lines.push_back({"points coincident with another (kept)", points.coincident});
  lines.push_back({"points in no cell (kept)", points.in_no_cell});
  lines.push_back({"points in no cell, outside of the box round all cells (dropped)", points.left_out, true});
  lines.push_back({"points joined without all that lies round them", report.uncertain, true});
  lines.push_back({"tetrahedra between such points and others, kept or left out in doubt", report.disputed, true});
  lines.push_back({"values written as stars, too wide for their columns (missing)", cells.unwritten, true});
  for (const auto& [name, count] : report.missing) lines.push_back({"missing values: " + name, count});
  for (const auto& [name, count] : report.fills)
    lines.push_back({"fill values taken as missing: " + name, count, true});
  std::erase_if(lines, [](const CensusLine& line) { return line.count == 0; });
  return lines;
}

std::vector<std::string> precision_warnings(const InputSummary& input) {
  std::vector<std::string> warnings;
  warn_of_positions(input, warnings);
  warn_of_rounding(input, warnings);
  return warnings;
}

// The file has numbers of single precision. Near 0 they have fewer digits, and less than half of the least is 0.
// Rounded values lose those with fewer digits, too.
LostValues lost_values(const InputSummary& input, bool exact) {
  using Stored = std::numeric_limits<float>;
  const double least_stored = exact ? 0.5 * double{Stored::denorm_min()} : double{Stored::min()};
  LostValues lost;
  for (std::size_t a = 0; a < input.attributes.size(); ++a) {
    const format::Attribute& attribute = input.attributes[a];
    const double below = attribute.scale * least_stored;
    if (attribute.offset == 0 && input.least[a] < below)
      add_lost({{attribute.name}, below, std::max(std::abs(attribute.min), std::abs(attribute.max))}, lost);
  }
  return lost;
}

void add_lost(const LostValues& more, LostValues& lost) {
  lost.attributes.insert(more.attributes.begin(), more.attributes.end());
  lost.below = std::max(lost.below, more.below);
  lost.largest = std::max(lost.largest, more.largest);
}

std::vector<std::string> warning_lines(const BuildReport& report) {
  std::vector<std::string> lines = report.warnings;
  if (const LostValues& lost = report.lost; !lost.attributes.empty())
    lines.push_back(fmt::format("{}: values nearer to 0 than {:.2g} are stored as 0 beside the largest, {:.2g}",
                                fmt::join(lost.attributes, ", "), lost.below, lost.largest));
  if (const std::uint64_t files = report.cells.open_ends; files > 0)
    lines.push_back(
        fmt::format("no line end follows the last number of {}: it may be cut off; if it is whole, add a "
                    "line end",
                    files == 1 ? "a file" : fmt::format("{} files", files)));
  constexpr std::size_t most_losses = 20;  // a file may have thousands of parts
  const std::set<std::string>& losses = report.cells.losses;
  const std::size_t told = losses.size() > most_losses ? most_losses - 1 : losses.size();
  lines.insert(lines.end(), losses.begin(), std::next(losses.begin(), static_cast<std::ptrdiff_t>(told)));
  if (told < losses.size()) lines.push_back(fmt::format("{} more of this kind", losses.size() - told));
  return lines;
}

Status check_unchanged(const BuildReport& report) {
  std::vector<std::string> changes;
  for (const CensusLine& line : census_lines(report))
    if (line.is_change) changes.push_back(fmt::format("{} {}", line.count, line.words));
  for (std::string& line : warning_lines(report)) changes.push_back(std::move(line));
  if (changes.empty()) return {};
  return fail(ErrorCode::invalid_data, "the file would not be the input as it is: {}", fmt::join(changes, "; "));
}

}  // namespace splatvol
