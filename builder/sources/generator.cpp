#include "builder/sources/generator.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/names.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr std::string_view prefix = "gen:";

/// Reads "key=value,key=value".
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

Result<PointRecipe> parse_points(std::string_view text) {
  SPLATVOL_TRY_ASSIGN(settings, parse_settings(text, {"count", "distribution", "seed", "type"}));
  PointRecipe recipe;
  SPLATVOL_TRY_ASSIGN(count, parse_count(settings["count"]));
  recipe.count = count;
  if (settings.contains("seed")) {
    const auto seed = number_of<std::uint64_t>(settings["seed"]);
    if (!seed) return fail(ErrorCode::invalid_argument, "'{}' is not a seed", settings["seed"]);
    recipe.seed = *seed;
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

const std::vector<std::string>& distribution_names() {
  static const std::vector<std::string> names = {"uniform",      "vortex", "half-tiny", "equal",
                                                 "two-clusters", "line",   "layer",     "clusters"};
  return names;
}

bool is_generated(std::string_view input) { return input.starts_with(prefix); }

Result<std::unique_ptr<Source>> open_generated(const std::string& input, const SourceOptions& options) {
  auto source = parse_input(input);
  if (!source) return fail_in(input, source.error());
  if (!options.columns.empty())
    return fail(ErrorCode::invalid_argument, "{}: not a .npy file, so its columns cannot be named", input);
  for (const std::string& name : options.selection)
    if (name != source.value()->attributes()[0]) return fail_no_attribute(input, name, source.value()->attributes());
  return source;
}

Result<std::uint64_t> parse_count(const std::string& text) {
  const double count = number_of<double>(text).value_or(0);
  if (!(count >= 1 && count <= 1e12) || count != std::floor(count))
    return fail(ErrorCode::invalid_argument, "'{}' is not a whole number from 1 to 1e12 such as 1000 or 1e8", text);
  return static_cast<std::uint64_t>(count);
}

}  // namespace splatvol
