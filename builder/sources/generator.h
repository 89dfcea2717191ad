// Inputs that are made up: point sets and meshes of any size with an analytic field, a piece at a time.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "builder/sources/source.h"

namespace splatvol {

/// The field that every generated point carries as "value", smooth everywhere: a vortex of two strands that wind one
/// and a half times round the circle of radius 1.2 in the plane z = 0 for each time they follow it, so that they are
/// one trefoil knot, on a slope. With r and t the polar coordinates of (x, y), w = 0.1:
///   value = exp(-|(r - 1.2, z) - c|^2 / w^2) + exp(-|(r - 1.2, z) + c|^2 / w^2) + x / (10 sqrt(4 + |p|^2)),
///   c = 0.5 (cos 1.5 t, sin 1.5 t).
[[nodiscard]] double generated_field(const dvec3& p);

/// Where generated points are. B is the box [-2, 2] x [-2, 2] x [-1, 1].
enum class Distribution {
  uniform,       // in B
  vortex,        // adaptive: an eighth uniform in B, the others round the strands, spacing down to 1/11 of that
  half_tiny,     // half of them uniform in B, half in a box of 1e-9 of its volume
  equal,         // all in one place
  two_clusters,  // half in B, half in B moved by 1e9 times its width
  line,          // uniform on a line, exactly
  layer,         // uniform in x and y, the logarithm of z uniform from 1e-8 to 1
};

/// The name of each, as in enum Distribution with "-" for "_".
[[nodiscard]] const std::vector<std::string>& distribution_names();

struct PointRecipe {
  std::uint64_t count = 0;
  Distribution distribution = Distribution::uniform;
  std::uint64_t seed = 1;
  bool single_precision = false;  // positions rounded to float, and their values too
};

/// Points in random order. Each depends on the seed and its own number only: not on threads, pieces or the count.
/// Pieces have max_piece_points, the last has the rest.
[[nodiscard]] std::unique_ptr<Source> generate_points(const PointRecipe& recipe);

struct MeshRecipe {
  std::uint64_t cells = 0;
  std::uint64_t pieces = 0;  // 0: as many as keep each within max_piece_points
};

/// A mesh of the box B: n^3 hexahedra in six tetrahedra each, 6 n^3 being about `cells`, that grow towards the upper
/// end of each axis, by e, e^2 and e^4 in all. Pieces are blocks of it that repeat their common vertices exactly;
/// values are rounded to float, as .vtu files of svgen have them. Fails where there are too few hexahedra for so many
/// pieces, or a piece would have 2^32 tetrahedra.
[[nodiscard]] Result<std::unique_ptr<Source>> generate_mesh(const MeshRecipe& recipe);

/// Whether an input is one for open_generated.
[[nodiscard]] bool is_generated(std::string_view input);

/// Opens "gen:points:count=1e8,distribution=vortex,seed=1,type=float32" (type: float32 or float64) or
/// "gen:mesh:cells=1e8,pieces=64"; what is left out is as in the recipes, float64, but count and cells are needed.
/// Fails with anything else in it.
[[nodiscard]] Result<std::unique_ptr<Source>> open_generated(const std::string& input, const SourceOptions& options);

/// Reads a whole number from 1 to 1e12, such as "1000" or "1e8".
[[nodiscard]] Result<std::uint64_t> parse_count(const std::string& text);

}  // namespace splatvol
