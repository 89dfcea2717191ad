// Values of a field between its splats.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "format/splat_reader.h"
#include "splat/ellipsoid.h"

namespace splatvol {

/// Adds up the splats of a file at some positions. A value is the mean of the splats' linear fields, weighted by their
/// densities: those of the kernel `moments` (docs/accuracy.md), cut off at boundaries.
class FieldSampler {
 public:
  /// `positions` must outlive this.
  explicit FieldSampler(std::span<const dvec3> positions);

  /// Adds the splats of a group. Requires its material, of one attribute.
  void add(const format::SplatGroup& group);

  /// Returns the stored values at the positions; NaN where no material with a value is (DensitySums).
  [[nodiscard]] std::vector<double> values() const;

 private:
  // A node of a k-d tree over the positions, depth first: a node's children follow it, up to `next`.
  struct Node {
    Box box;
    std::uint32_t begin, end;  // of `order_`
    std::uint32_t next;        // the node that follows all below this one
  };

  // What the splats add up to at a position.
  struct Sums {
    DensitySums density;  // of material that has a value
    double value = 0;     // weighted by what is left of it
  };

  void make_node(std::uint32_t begin, std::uint32_t end);
  void add(const dvec3& centroid, const SplatShape& shape, const SplatValue& value);

  std::span<const dvec3> positions_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
  std::vector<Sums> sums_;  // [position]
};

}  // namespace splatvol
