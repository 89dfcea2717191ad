// How far a picture is expected to be from the exact one. Internal to the streamer.
#pragma once

#include <cstddef>
#include <span>

#include "streamer/node_tree.h"

namespace splatvol {

/// The expected error of the nodes of a view, from the index alone.
///
/// A node of edge L has n splats at a resolution; their width h is the geometric mean of what n equal ones would have
/// (weight 2/3) and the bound on their sizes (1/3). The values in a splat are taken to spread over the share h / L of
/// the node's range, wherever in its occupied bins. What that does to colour times extinction is wrong by chance along
/// a ray of L / h splats, over all pixels that the node covers:
///   E = area (L / h) h^2 (contrast + emission^2 / 300) / (1 + extinction h)^2,
/// less where splats are smaller than pixels. The second term is for the splats' shape: they do not add up to the
/// material exactly. docs/accuracy.md has how far this is right.
class ErrorModel {
 public:
  /// Keeps a reference.
  explicit ErrorModel(const NodeTree& tree);

  /// For each resolution the node's part in the expected mean squared error of the picture's RGB, and what a resolution
  /// next to it that is one step finer adds where they meet: densities are fitted to one resolution. 0 below the
  /// node's first, and where no splat reaches into the picture. Both spans have one element for each resolution.
  void evaluate(const Node& node, std::span<float> errors, std::span<float> seams) const;

 private:
  struct Footprint {
    double area;   // pixels that a section of the cell covers
    double scale;  // pixels per world unit
  };
  [[nodiscard]] Footprint footprint_of(const Cube& cell) const;

  const NodeTree& tree_;
};

}  // namespace splatvol
