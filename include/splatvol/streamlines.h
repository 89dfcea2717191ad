// Streamlines through the cells of a .svol file.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "splatvol/export.h"
#include "splatvol/geometry.h"

namespace splatvol {

/// Seeds in equal steps on a line, both ends included. One seed is in the middle.
struct SeedLine {
  dvec3 start{0}, end{0};
  std::size_t count = 20;

  [[nodiscard]] bool operator==(const SeedLine&) const = default;
};

/// Seeds on the grid of a rectangle, or of any parallelogram, its sides included.
struct SeedRectangle {
  dvec3 corner{0}, first{0}, second{0};       // a corner, and its two neighbours
  std::array<std::size_t, 2> counts{10, 10};  // along the sides to `first` and to `second`

  [[nodiscard]] bool operator==(const SeedRectangle&) const = default;
};

/// Seeds evenly on patches of the boundary that the file holds, by their areas.
struct SeedPatch {
  std::string patch;  // `*` stands for any characters
  std::size_t count = 100;

  [[nodiscard]] bool operator==(const SeedPatch&) const = default;
};

/// Most seeds of a request.
inline constexpr std::size_t most_seeds = 1'000'000;

/// Where streamlines begin: at positions in world units, or at those of a shape.
using Seeds = std::variant<std::vector<dvec3>, SeedLine, SeedRectangle, SeedPatch>;

/// With the vectors, against them, or both.
enum class StreamlineDirection { both, forward, backward };

/// Which streamlines to follow, and how far.
struct StreamlineRequest {
  std::string vector;  // with the components `vector[0]`, `vector[1]` and `vector[2]`
  Seeds seeds = {};
  std::vector<std::string> attributes = {};  // to tell along the lines; empty: all
  StreamlineDirection direction = StreamlineDirection::both;
  std::optional<double> max_length = {};  // from the seed, each way; none: five diagonals of the mesh's box
  std::size_t max_steps = 10'000;         // from the seed, each way
};

/// Why a streamline ends.
enum class StreamlineEnd {
  seed,      // it was not to be followed beyond
  mesh,      // no cell is there
  missing,   // the vector has no value there
  no_speed,  // less than 1e-12 of the largest that the vector can have
  length,    // StreamlineRequest::max_length
  steps      // StreamlineRequest::max_steps
};

/// Returns the name of the enumerator: "mesh", for example.
[[nodiscard]] SPLATVOL_EXPORT std::string name_of(StreamlineEnd end);

/// A line that is everywhere parallel to a vector field. Rows follow each other with the vectors.
struct Streamline {
  std::size_t seed = 0;                     // its number
  std::vector<dvec3> positions;             // [row]; none: the seed is at an end
  std::vector<double> times;                // [row]: from the seed, lengths over speeds; negative against the vectors
  std::vector<std::vector<double>> values;  // [attribute][row]; NaN: missing
  StreamlineEnd begin = StreamlineEnd::seed, end = StreamlineEnd::seed;  // why it ends at its first and its last row
};

/// Streamlines of a file.
struct Streamlines {
  std::vector<std::string> names;  // [attribute]
  std::vector<Streamline> lines;   // [seed]
};

}  // namespace splatvol
