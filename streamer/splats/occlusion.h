// Finds nodes that are hidden behind an opaque front. Internal to the streamer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/math.h"
#include "format/volume.h"
#include "scene/scene.h"
#include "streamer/splats/visibility.h"

namespace splatvol {

/// The nodes of the index's root page that material fills without a gap. The preamble tells: the mass of a node's
/// splats, at the finest resolution in the preamble, is the volume of its cube. A node smaller than these splats counts
/// as its parent does.
class FilledNodes {
 public:
  /// No nodes.
  FilledNodes() = default;

  /// Finds the filled nodes. Finds none if the file has no moments, or if points lack a value of an attribute, because
  /// these hide nothing. Reads only the preamble. Finds none if the preamble is damaged: reading it for a picture
  /// reports the damage.
  static FilledNodes find(const format::Volume& volume, const format::IndexPage& root,
                          const format::SummaryAttributes& attributes);

  [[nodiscard]] bool any() const { return !filled_.empty(); }
  [[nodiscard]] bool has(std::uint32_t node) const { return filled_[node]; }
  [[nodiscard]] std::uint64_t memory_bytes() const { return filled_.size() / 8; }

 private:
  std::vector<bool> filled_;  // [node of the root page]; empty: none
};

/// How far one can see into a view, along rays through a grid of pixels. A ray is closed behind material that lets at
/// most a thousandth of the light through.
class Occlusion {
  static constexpr int most_rays = 64;  // along the picture's longer side

 public:
  explicit Occlusion(const View& view);

  /// Adds a cube whose material has everywhere at least this extinction, per world unit of length. Requires that cubes
  /// come front to back.
  void add(const Cube& cube, double extinction);

  /// Whether the added cubes hide everything in this cube: the rays through it, and their neighbours, are all closed in
  /// front of it. False for a cube that reaches the eye's plane or is outside of the picture.
  [[nodiscard]] bool hides(const Cube& cube) const;

  /// Whether a cube is so small in the picture that a ray might miss it.
  [[nodiscard]] bool is_small(const Cube& cube) const;

  [[nodiscard]] const View& view() const { return view_; }

  /// The most memory of an Occlusion, whatever the view.
  static constexpr std::uint64_t most_memory_bytes = (most_rays + 1) * (most_rays + 1) * 2 * sizeof(double);

  /// Optical depth that closes a ray.
  static constexpr double closed = 7;

 private:
  struct Rays {
    int left, right, bottom, top;  // first and last column and row through the cube's rectangle in the picture
    double near;                   // least depth of the cube
    [[nodiscard]] bool empty() const { return right < left || top < bottom; }
  };
  [[nodiscard]] Rays rays_through(const Cube& cube, int margin) const;

  View view_;
  double spacing_;  // pixels
  int columns_, rows_;
  bool any_ = false;            // a ray is closed
  std::vector<double> depths_;  // [row][column]: optical depth so far
  std::vector<double> closed_;  // [row][column]: view depth at which the ray is closed; infinity: not closed
};

/// The occlusion for a view, with the index pages that it depends on: it stays valid while the same pages are there.
struct KeptOcclusion {
  /// A page that was asked for.
  struct Link {
    std::size_t from;    // 0: the root page; i: that of links[i - 1]
    std::uint32_t node;  // of that page
    bool found;          // it was there
  };

  ValueVisibility visibility;
  Occlusion occlusion;
  std::vector<Link> links;
  bool complete;  // every page that was asked for was there
};

}  // namespace splatvol
