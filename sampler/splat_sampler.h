// Values of a field between its splats.
#pragma once

#include <span>
#include <vector>

#include "base/math.h"
#include "format/splat_reader.h"
#include "sampler/box_tree.h"
#include "splat/ellipsoid.h"

namespace splatvol {

/// Adds up the splats of a file at some positions. A value is the mean of the splats' linear fields, weighted by their
/// densities: those of the kernel `moments` (docs/accuracy.md), cut off at boundaries.
class SplatSampler {
 public:
  /// `positions` must outlive this.
  explicit SplatSampler(std::span<const dvec3> positions);

  /// Adds the splats of a group. Requires its material, of one attribute.
  void add(const format::SplatGroup& group);

  /// Returns the stored values at the positions; NaN where no material with a value is (DensitySums).
  [[nodiscard]] std::vector<double> values() const;

 private:
  // What the splats add up to at a position.
  struct Sums {
    DensitySums density;  // of material that has a value
    double value = 0;     // weighted by what is left of it
  };

  void add(const dvec3& centroid, const SplatShape& shape, const SplatValue& value);

  std::span<const dvec3> positions_;
  BoxTree tree_;
  std::vector<Sums> sums_;  // [position]
};

}  // namespace splatvol
