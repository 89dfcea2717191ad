// Generated inputs: point sets and meshes of any size with an analytic field, a piece at a time.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "builder/sources/source.h"

namespace splatvol {

/// The field that every generated point carries as "value": a vortex of two strands on a slope, smooth everywhere. Both
/// strands follow the circle of radius 1.2 in the plane z = 0, and wind round it one and a half times in each turn, so
/// together they are one trefoil knot. With r and t the polar coordinates of (x, y), w = 0.1:
///   value = exp(-|(r - 1.2, z) - c|^2 / w^2) + exp(-|(r - 1.2, z) + c|^2 / w^2) + x / (10 sqrt(4 + |p|^2)),
///   c = 0.5 (cos 1.5 t, sin 1.5 t).
[[nodiscard]] double generated_field(const dvec3& p);

/// Where generated points are. B is the box [-2, 2] x [-2, 2] x [-1, 1].
enum class Distribution {
  uniform,       // in B
  vortex,        // an eighth uniform in B; the others round the strands, with a spacing down to 1/11 of that
  half_tiny,     // half uniform in B, half in a box of 1e-9 of B's volume
  equal,         // all at one position
  two_clusters,  // half in B, half in B moved by 1e9 times B's width
  line,          // uniform on a line, without rounding
  layer,         // uniform in x and y, the logarithm of z uniform from 1e-8 to 1
  clusters,      // half uniform in [0, 1]^3, half normal round 200 centres there; the logarithm of a cluster's
                 // deviation is uniform from 1e-3 to 1e-1
};

/// The names of the distributions in the order of the enum, with "-" for "_".
[[nodiscard]] const std::vector<std::string>& distribution_names();

struct PointRecipe {
  std::uint64_t count = 0;
  Distribution distribution = Distribution::uniform;
  std::uint64_t seed = 1;
  bool single_precision = false;  // rounds positions to float, and their values too
};

/// Generates points in random order. Each depends on the seed and its own number only: not on threads, pieces or the
/// count. Every piece has max_piece_points, the last has the rest.
[[nodiscard]] std::unique_ptr<Source> generate_points(const PointRecipe& recipe);

struct MeshRecipe {
  std::uint64_t cells = 0;
  std::uint64_t pieces = 0;  // 0: as many as keep each within max_piece_points
};

/// Generates a mesh of the box B: n^3 hexahedra, each cut into six tetrahedra, with 6 n^3 close to `cells`. Hexahedra
/// grow along each axis: the last is e, e^2 and e^4 times as long as the first along x, y and z. A piece is a box of
/// hexahedra; pieces repeat their common points exactly. Values are rounded to float, as in the .vtu files of svgen.
/// Fails if there are too few hexahedra for the number of pieces, or if a piece would have 2^32 tetrahedra.
[[nodiscard]] Result<std::unique_ptr<Source>> generate_mesh(const MeshRecipe& recipe);

/// Whether an input is for open_generated.
[[nodiscard]] bool is_generated(std::string_view input);

/// Opens "gen:points:count=1e8,distribution=vortex,seed=1,type=float32" (type: float32 or float64) or
/// "gen:mesh:cells=1e8,pieces=64". `count` and `cells` are required; the other settings default to the recipes' values,
/// and the type to float64. Fails if the text has anything else.
[[nodiscard]] Result<std::unique_ptr<Source>> open_generated(const std::string& input, const SourceOptions& options);

/// Reads a whole number from 1 to 1e12, such as "1000" or "1e8".
[[nodiscard]] Result<std::uint64_t> parse_count(const std::string& text);

}  // namespace splatvol
