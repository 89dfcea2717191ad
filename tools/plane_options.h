// Options that add slices, clip planes and an isovalue to a scene.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "scene/scene.h"
#include "tools/command_line.h"

namespace splatvol {

/// A value, and the width of the peak round it.
struct IsovalueOption {
  double value = 0;
  std::optional<double> width;
};

/// Reads "VALUE" or "VALUE:WIDTH".
[[nodiscard]] Result<IsovalueOption> parse_isovalue(const std::string& text);

/// A plane, as scenes have them.
struct PlaneOption {
  dvec3 point, normal;
};

/// Reads "X,Y,Z:NX,NY,NZ": a point and the normal.
[[nodiscard]] Result<PlaneOption> parse_plane(const std::string& text);

struct PlaneOptions {
  std::vector<std::string> slices, clip_planes;  // parse_plane takes them
  std::string isovalue;                          // parse_isovalue takes it; empty: the scene's density

  [[nodiscard]] bool are_given() const { return !slices.empty() || !clip_planes.empty() || !isovalue.empty(); }
};

/// Adds the options to `app`. Parsing writes into `options`.
void add_plane_options(CommandLine& app, PlaneOptions& options);

/// Adds the planes to the scene's own, and shows the isovalue. `size`: of the data, in world units. Fails if the
/// scene's axis does not have the isovalue.
[[nodiscard]] Status apply(const PlaneOptions& options, double size, Scene& scene);

}  // namespace splatvol
