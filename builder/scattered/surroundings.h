// Points outside of those whose cells are estimated.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "base/math.h"

namespace splatvol {

/// A tree of boxes round all points of an input, and the points in them.
class Surroundings {
 public:
  struct Node {
    Box box;                         // round the points; empty if there are none
    std::size_t begin = 0, end = 0;  // children; of a bucket, nothing
    bool is_bucket = false;
  };

  virtual ~Surroundings() = default;

  [[nodiscard]] virtual std::size_t root() const = 0;
  [[nodiscard]] virtual Node node(std::size_t number) const = 0;

  /// Whether a node has points outside, and whether it has others too.
  enum class Part { none, some, all };
  [[nodiscard]] virtual Part outside(std::size_t number) const = 0;

  /// The distinct points of a bucket that lies outside, as long as this lives. Empty if they cannot be read.
  virtual std::span<const dvec3> read(std::size_t bucket) = 0;
};

}  // namespace splatvol
