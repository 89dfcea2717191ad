// Options that add slices, clip planes and contours to a scene.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "scene/scene.h"
#include "tools/command_line.h"

namespace splatvol {

/// A plane, as scenes have them.
struct PlaneOption {
  dvec3 point, normal;
};

/// Reads "X,Y,Z:NX,NY,NZ": a point and the normal.
[[nodiscard]] Result<PlaneOption> parse_plane(const std::string& text);

/// Reads the value of a contour.
[[nodiscard]] Result<double> parse_contour(const std::string& text);

struct PlaneOptions {
  std::vector<std::string> slices, clip_planes;  // parse_plane takes them
  std::vector<std::string> contours;             // parse_contour takes them

  [[nodiscard]] bool are_given() const { return !slices.empty() || !clip_planes.empty() || !contours.empty(); }
};

/// Adds the options to `app`. Parsing writes into `options`.
void add_plane_options(CommandLine& app, PlaneOptions& options);

/// Adds the planes and contours to the scene's own. A value of which the scene has a contour stays as it is.
[[nodiscard]] Status apply(const PlaneOptions& options, Scene& scene);

}  // namespace splatvol
