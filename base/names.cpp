#include "base/names.h"

#include <fmt/ranges.h>

#include <algorithm>

namespace splatvol {

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

Result<std::vector<std::size_t>> find_patches(const std::string& file, const std::string& pattern,
                                              std::span<const std::string> names) {
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (names[i] == pattern || matches(names[i], pattern)) found.push_back(i);
  if (!found.empty()) return found;
  return fail(ErrorCode::invalid_argument, "{}: no patch \"{}\" in its boundary; there are: {}", file, pattern,
              fmt::join(names, ", "));
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
