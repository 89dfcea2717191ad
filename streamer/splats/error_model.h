// The expected error of a picture against the exact one. Internal to the streamer.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "streamer/splats/node_tree.h"
#include "streamer/splats/visibility.h"

namespace splatvol {

/// The expected error of the nodes of a view, from the index alone. docs/accuracy.md says how accurate it is.
///
/// A node of edge L has n splats at a resolution. Their width h is the geometric mean of the width of n equal splats
/// (weight 2/3) and of the bound on their sizes (weight 1/3). The model assumes that the values in a splat spread over
/// the share h / L of the node's range, anywhere in its occupied bins. The contrast is the variance of colour times
/// extinction among such values. The errors of the L / h splats along a ray are independent, and add up over all pixels
/// of the node:
///   E = area (L / h) h^2 (contrast + squares / 50) / (1 + extinction h).
/// A slice through the node adds the area that splats cover on it, times opacity^2, times the contrast of colours among
/// such values.
/// Splats smaller than pixels have a smaller error. The term `squares` is for the splats' shape: they do not add up to
/// the material exactly.
class ErrorModel {
 public:
  struct Terms {
    double error = 0;  // the node's share of the expected mean squared error of the picture's RGB
    double seam = 0;   // added where the node meets a node that is one resolution finer: large and small splats side by
                       // side add up less exactly than equal ones
  };

  /// The errors of a node. Keeps references to the node and to the model.
  class OfNode {
   public:
    /// Returns the errors at a resolution, from the node's first on, with its number of splats there.
    [[nodiscard]] Terms at(std::size_t resolution, std::uint64_t splats) const;

   private:
    friend class ErrorModel;
    OfNode(const ErrorModel& model, const Node& node);
    const ErrorModel& model_;
    const Node& node_;
    double area_;             // pixels that a section of the cube covers
    double pixels_per_edge_;  // of the cube
    ShownContrast values_;
    ValueContrast::Node slice_values_;
  };

  /// Keeps a reference.
  explicit ErrorModel(const NodeTree& tree);

  [[nodiscard]] OfNode of(const Node& node) const { return {*this, node}; }

 private:
  const NodeTree& tree_;
  double scaling_;
  static constexpr int samples_along_edge = 4;

  // Offsets from the centre of a cube of edge 1, in view directions.
  std::array<dvec3, samples_along_edge * samples_along_edge * samples_along_edge> samples_;
};

}  // namespace splatvol
