// How far a picture is expected to be from the exact one. Internal to the streamer.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "streamer/node_tree.h"
#include "streamer/visibility.h"

namespace splatvol {

/// The expected error of the nodes of a view, from the index alone.
///
/// A node of edge L has n splats at a resolution; their width h is the geometric mean of what n equal ones would have
/// (weight 2/3) and the bound on their sizes (1/3). The values in a splat are taken to spread over the share h / L of
/// the node's range, wherever in its occupied bins. What that does to colour times extinction is wrong by chance along
/// a ray of L / h splats, over all pixels that the node covers:
///   E = area (L / h) h^2 (contrast + squares / 300) / (1 + extinction h),
/// less where splats are smaller than pixels. The second term is for the splats' shape: they do not add up to the
/// material exactly. docs/accuracy.md has how far this is right.
class ErrorModel {
 public:
  struct Terms {
    double error = 0;  // the node's part in the expected mean squared error of the picture's RGB
    double seam = 0;   // what it adds where the node meets one that is one step finer: small splats beside large ones
                       // do not add up as among their like
  };

  /// A node as the model sees it. Keeps references to it and to the model.
  class OfNode {
   public:
    /// Requires a resolution from the node's first on, and the number of its splats.
    [[nodiscard]] Terms at(std::size_t resolution, std::uint64_t splats) const;

   private:
    friend class ErrorModel;
    OfNode(const ErrorModel& model, const Node& node);
    const ErrorModel& model_;
    const Node& node_;
    double area_;             // pixels that a section of the cube covers
    double pixels_per_edge_;  // of the cube
    ValueContrast::Node values_;
  };

  /// Keeps a reference.
  explicit ErrorModel(const NodeTree& tree);

  [[nodiscard]] OfNode of(const Node& node) const { return {*this, node}; }

 private:
  const NodeTree& tree_;
  double scaling_;
  static constexpr int samples_along_edge = 4;
  std::array<dvec3, samples_along_edge * samples_along_edge * samples_along_edge> samples_;  // of a cube of edge 1,
                                                                                             // from its centre; view
};

}  // namespace splatvol
