#include "base/names.h"

#include <fmt/ranges.h>

#include <algorithm>

namespace splatvol {

tl::unexpected<Error> fail_no_attribute(const std::string& file, const std::string& name,
                                        std::span<const std::string> available) {
  return fail(ErrorCode::invalid_argument, "{}: no attribute \"{}\"; there are: {}", file, name,
              fmt::join(available, ", "));
}

std::optional<std::string> find_duplicate(std::vector<std::string> names) {
  std::ranges::sort(names);
  const auto duplicate = std::ranges::adjacent_find(names);
  return duplicate == names.end() ? std::nullopt : std::optional(*duplicate);
}

}  // namespace splatvol
