#include "streamer/first/first_attribute.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include "base/names.h"
#include "streamer/first/survey.h"

namespace splatvol {
namespace {

// Better classes first.
enum class Interest { main, other, component, mostly_missing, whole_numbers, constant, no_values };

constexpr std::uint64_t enough_points = 5000;                            // to tell ids from quantities
constexpr double rounding_of_single = 1e-6, rounding_of_double = 1e-12;  // of the largest value, of some steps
constexpr std::size_t most_labels = 64;
constexpr std::array<std::string_view, 5> id_endings = {"Id", "ID", "Ids", "IDs", "_id"};

bool is_pressure(const std::string& name) {
  const std::string lower = in_lower_case(name);
  return lower == "p" || lower.starts_with("p_") || lower.find("press") != std::string::npos;
}

bool is_id_name(const std::string& name) {
  return std::ranges::any_of(id_endings, [&](std::string_view ending) { return name.ends_with(ending); });
}

// Values beyond 2^53 are whole by rounding.
bool is_whole(double value) { return std::floor(value) == value && std::abs(value) < 0x1p53; }

// Returns how many different labels make up most of some sorted values; 0 if none do. Labels of cells are averaged at
// the points where they meet.
std::size_t labels_of_most(const std::vector<double>& values) {
  std::size_t labels = 0, with_labels = 0;
  for (auto at = values.begin(); at != values.end();) {
    const auto behind = std::ranges::upper_bound(at, values.end(), *at);
    const auto count = static_cast<std::size_t>(behind - at);
    if (is_whole(*at) && 100 * count >= values.size()) ++labels, with_labels += count;
    at = behind;
  }
  return 10 * with_labels >= 6 * values.size() ? labels : 0;
}

Result<Interest> interest_of(const format::Volume& volume, int index) {
  const format::VolumeInfo& info = volume.info();
  const auto& attribute = info.attributes[static_cast<std::size_t>(index)];
  if (std::isnan(attribute.min)) return Interest::no_values;
  const double largest = std::max(std::abs(attribute.min), std::abs(attribute.max));
  SPLATVOL_TRY_ASSIGN(least_range, least_relative_range(volume, index));
  if (!(attribute.max - attribute.min > least_range * largest)) return Interest::constant;
  SPLATVOL_TRY_ASSIGN(kind, kind_of_numbers(volume, index));
  if (kind != NumberKind::other || is_id_name(attribute.name)) return Interest::whole_numbers;
  if (attribute.missing > info.point_count() / 2) return Interest::mostly_missing;
  if (attribute.name.ends_with(']')) return Interest::component;
  const bool is_magnitude = info.find_attribute(attribute.name + "[0]") >= 0;
  return is_magnitude || is_pressure(attribute.name) ? Interest::main : Interest::other;
}

}  // namespace

Result<NumberKind> kind_of_numbers(const format::Volume& volume, int index) {
  const auto& attribute = volume.info().attributes[static_cast<std::size_t>(index)];
  if (!is_whole(attribute.min) || !is_whole(attribute.max)) return NumberKind::other;
  SPLATVOL_TRY_ASSIGN(values, survey_values(volume, index, enough_points));
  std::erase_if(values, [](double value) { return std::isnan(value); });
  std::ranges::sort(values);
  const bool all_whole = !values.empty() && std::ranges::all_of(values, is_whole);
  std::size_t labels = labels_of_most(values);
  if (all_whole) {
    values.erase(std::ranges::unique(values).begin(), values.end());
    labels = values.size();
  }
  if (labels > 1 && labels <= most_labels) return NumberKind::labels;
  return all_whole ? NumberKind::whole : NumberKind::other;
}

Result<double> least_relative_range(const format::Volume& volume, int index) {
  const auto& attribute = volume.info().attributes[static_cast<std::size_t>(index)];
  const double largest = std::max(std::abs(attribute.min), std::abs(attribute.max));
  if (!(attribute.max - attribute.min <= rounding_of_single * largest)) return rounding_of_single;
  SPLATVOL_TRY_ASSIGN(values, survey_values(volume, index, enough_points));
  const double error = attribute.error + rounding_of_double * largest;
  const bool is_double = std::ranges::any_of(
      values, [&](double value) { return std::abs(value - double{static_cast<float>(value)}) > error; });
  return is_double ? rounding_of_double : rounding_of_single;
}

Result<int> choose_first_attribute(const format::Volume& volume) {
  const auto& attributes = volume.info().attributes;
  if (attributes.empty()) return fail(ErrorCode::invalid_data, "{}: has no attributes", volume.name());
  int best = 0;
  Interest most = Interest::no_values;
  for (int index = 0; index < static_cast<int>(attributes.size()) && most != Interest::main; ++index) {
    SPLATVOL_TRY_ASSIGN(interest, interest_of(volume, index));
    if (interest < most) most = interest, best = index;
  }
  if (most == Interest::no_values) return fail(ErrorCode::invalid_data, "{}: no attribute has values", volume.name());
  return best;
}

Result<std::vector<int>> other_quantities(const format::Volume& volume, int first, std::size_t most) {
  std::vector<int> chosen;
  for (int index = 0; index < static_cast<int>(volume.info().attributes.size()) && chosen.size() < most; ++index) {
    if (index == first) continue;
    SPLATVOL_TRY_ASSIGN(interest, interest_of(volume, index));
    if (interest <= Interest::other) chosen.push_back(index);
  }
  return chosen;
}

}  // namespace splatvol
