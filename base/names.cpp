#include "base/names.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <numeric>

namespace splatvol {
namespace {

/// Returns how many letters must be added, left out or replaced to turn one word into the other (Levenshtein).
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = std::exchange(row[j + 1], std::min({row[j] + 1, row[j + 1] + 1, replaced}));
    }
  }
  return row.back();
}

}  // namespace

tl::unexpected<Error> fail_no_attribute(const std::string& file, const std::string& name,
                                        std::span<const std::string> available) {
  return fail(ErrorCode::invalid_argument, "{}: no attribute \"{}\"; there are: {}", file, name,
              fmt::join(available, ", "));
}

bool matches(std::string_view name, std::string_view pattern) {
  std::size_t at = 0, star = std::string_view::npos, after_star = 0;
  for (std::size_t i = 0; i < name.size();) {
    if (at < pattern.size() && pattern[at] == '*') {
      star = at++;
      after_star = i;
    } else if (at < pattern.size() && pattern[at] == name[i]) {
      ++at, ++i;
    } else if (star != std::string_view::npos) {
      at = star + 1;
      i = ++after_star;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', at) == std::string_view::npos;
}

bool is_patch_of_rest(std::string_view name) {
  const auto after = [&](std::string_view begin) {
    return name.starts_with(begin) ? name.substr(begin.size()) : std::string_view();
  };
  if (const std::string_view side = after("side "); side.size() == 2)
    return side[0] >= 'x' && side[0] <= 'z' && (side[1] == '-' || side[1] == '+');
  const std::string_view part = after("outer ");
  const bool is_number = !part.empty() && part.find_first_not_of("0123456789") == part.npos;
  return name == "outer" || part == "rest" || is_number;
}

Result<std::vector<std::size_t>> find_patches(const std::string& file, const std::string& pattern,
                                              std::span<const std::string> names) {
  const bool takes_rest = matches("outer", pattern) && std::ranges::find(names, "outer") == names.end();
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (names[i] == pattern || matches(names[i], pattern) || (takes_rest && is_patch_of_rest(names[i])))
      found.push_back(i);
  if (!found.empty()) return found;
  return fail(ErrorCode::invalid_argument, "{}: no patch \"{}\" in its boundary; there are: {}", file, pattern,
              fmt::join(names, ", "));
}

std::string_view nearest_name(std::string_view name, std::span<const std::string_view> known) {
  return *std::ranges::min_element(known, {}, [&](std::string_view other) { return edit_distance(name, other); });
}

std::string in_lower_case(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

std::string free_name(const std::string& name, const std::function<bool(const std::string&)>& is_taken) {
  if (!is_taken(name)) return name;
  std::string other = name + " (splat)";
  for (int number = 2; is_taken(other); ++number) other = fmt::format("{} (splat {})", name, number);
  return other;
}

std::optional<std::string> find_duplicate(std::vector<std::string> names) {
  std::ranges::sort(names);
  const auto duplicate = std::ranges::adjacent_find(names);
  return duplicate == names.end() ? std::nullopt : std::optional(*duplicate);
}

}  // namespace splatvol
