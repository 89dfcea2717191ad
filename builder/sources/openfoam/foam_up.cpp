#include "builder/sources/openfoam/foam_up.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <optional>

#include "base/file.h"
#include "base/input_formats.h"
#include "builder/sources/openfoam/foam_dictionary.h"
#include "builder/sources/openfoam/foam_mesh.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

/// Returns the axis of the gravity of a case, such as "value (0 0 -9.81);".
std::optional<int> axis_of_gravity(const FoamPlace& place) {
  FoamReader reader(place);
  std::vector<FoamToken> words;
  FoamEntries entries(reader, [&](const std::string& key) {
    if (key == "value") words = entries.read_plain_words();
    return key == "value";
  });
  while (entries.read_next()) {
  }
  std::array<double, 3> gravity{};
  if (words.size() != gravity.size() + 2) return {};  // with their brackets
  for (std::size_t i = 0; i < gravity.size(); ++i) {
    const auto component = number_of<double>(words[i + 1].text);
    if (!component || !std::isfinite(*component)) return {};
    gravity[i] = std::abs(*component);
  }
  const auto largest = std::ranges::max_element(gravity);
  return *largest > 0 ? std::optional(static_cast<int>(largest - gravity.begin())) : std::nullopt;
}

/// Returns y for a case that is one cell thick: it has patches of the type `empty`. By OpenFOAM's convention it lies in
/// the plane of x and y.
std::optional<int> axis_of_flat_case(const FoamPlace& boundary) {
  const std::vector<FoamPatch> patches = read_foam_patches(boundary);
  const bool is_flat = std::ranges::any_of(patches, [](const FoamPatch& patch) { return patch.type == "empty"; });
  return is_flat ? std::optional(1) : std::nullopt;
}

int up_of_case(const std::filesystem::path& folder) {
  const auto read = [&](const char* name, const auto& axis_of) -> std::optional<int> {
    try {
      return axis_of({(folder / name).string(), name, folder.string()});
    } catch (const ReaderError&) {
      return {};  // whoever reads the case tells
    }
  };
  if (const auto axis = read("constant/g", axis_of_gravity)) return *axis;
  return read("constant/polyMesh/boundary", axis_of_flat_case).value_or(2);
}

}  // namespace

int usual_up(const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs) {
    if (is_openfoam_case(input)) return up_of_case(input);
    if (format_of_name(input) != InputFormat::openfoam) continue;
    const std::filesystem::path folder = folder_of(input);  // system/controlDict may be the input
    return up_of_case(folder.filename() == "system" ? folder.parent_path() : folder);
  }
  return -1;
}

}  // namespace splatvol
