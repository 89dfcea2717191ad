#include "builder/opening/exodus_pieces.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

namespace splatvol {
namespace {

/// Takes ".NUMBER" off the end of a name. Returns its digits; none if there is no such end.
std::optional<std::string_view> take_number(std::string_view& name) {
  const std::size_t before = name.find_last_not_of("0123456789");
  if (before == std::string_view::npos || before + 1 == name.size() || name[before] != '.') return std::nullopt;
  const std::string_view digits = name.substr(before + 1);
  name = name.substr(0, before);
  return digits;
}

std::optional<std::uint32_t> number_of(std::string_view digits) {
  std::uint32_t number = 0;
  const auto parsed = std::from_chars(digits.data(), digits.data() + digits.size(), number);
  return parsed.ec == std::errc{} ? std::optional(number) : std::nullopt;
}

struct Pieces {
  std::string first;                // a path among them
  std::size_t digits = 0;           // of its number
  std::set<std::uint32_t> numbers;  // of those that are there
};

}  // namespace

Status check_exodus_pieces(std::span<const std::string> paths) {
  std::map<std::pair<std::string, std::uint32_t>, Pieces> meshes;  // by name, and number of pieces
  for (const std::string& path : paths) {
    std::string_view name = path;
    const auto piece = take_number(name);
    const auto count = piece ? take_number(name) : std::nullopt;
    const auto number = piece ? number_of(*piece) : std::nullopt, all = count ? number_of(*count) : std::nullopt;
    if (!number || !all || *number >= *all) continue;
    Pieces& pieces = meshes[{std::string(name), *all}];
    if (pieces.first.empty()) pieces = {path, piece->size(), {}};
    pieces.numbers.insert(*number);
  }
  constexpr std::size_t most_named = 4;
  for (const auto& [mesh, pieces] : meshes) {
    std::vector<std::string> missing;
    for (std::uint32_t i = 0; i < mesh.second && missing.size() < most_named; ++i)
      if (!pieces.numbers.contains(i))
        missing.push_back(fmt::format("{}.{}.{:0{}}", mesh.first, mesh.second, i, pieces.digits));
    if (missing.empty()) continue;
    const std::size_t others = mesh.second - pieces.numbers.size() - missing.size();
    return fail(ErrorCode::invalid_data,
                "{}: the mesh has {} pieces, and {}{} missing: give all of them, or a piece by itself another name",
                pieces.first, mesh.second, fmt::join(missing, ", "),
                others > 0           ? fmt::format(" and {} more are", others)
                : missing.size() > 1 ? " are"
                                     : " is");
  }
  return {};
}

}  // namespace splatvol
