// What lies behind an opaque front. Internal to the streamer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/math.h"
#include "format/volume.h"
#include "scene/scene.h"
#include "streamer/visibility.h"

namespace splatvol {

/// Nodes of the index's root page that material fills without a gap, as far as the preamble tells: the mass of their
/// splats, at the finest resolution that it holds, comes to the volume of their cube. What is smaller than those splats
/// is taken to be as what it lies in.
class FilledNodes {
 public:
  /// None.
  FilledNodes() = default;

  /// None where the file has no moments, or points without a value of the attribute: these hide nothing. Reads nothing
  /// but the preamble; none either where that is damaged: reading it for a picture tells.
  static FilledNodes find(const format::Volume& volume, const format::IndexPage& root, int attribute);

  [[nodiscard]] bool any() const { return !filled_.empty(); }
  [[nodiscard]] bool has(std::uint32_t node) const { return filled_[node]; }
  [[nodiscard]] std::uint64_t memory_bytes() const { return filled_.size() / 8; }

 private:
  std::vector<bool> filled_;  // [node of the root page]; empty: none
};

/// How far one can see into a view, along rays through a grid of pixels. A ray is closed where no more than a
/// thousandth of the light comes through.
class Occlusion {
  static constexpr int most_rays = 64;  // along the picture's longer side

 public:
  explicit Occlusion(const View& view);

  /// Adds a cube whose material has an extinction of at least this (per world length unit) throughout. Requires that
  /// cubes come front to back.
  void add(const Cube& cube, double extinction);

  /// Whether nothing in the cube can be seen behind what was added: it lies behind where all rays through it, and those
  /// next to them, are closed. False of what reaches the eye's plane and of what lies outside of the picture.
  [[nodiscard]] bool hides(const Cube& cube) const;

  /// Whether a cube is so small in the picture that a ray might miss it.
  [[nodiscard]] bool is_small(const Cube& cube) const;

  [[nodiscard]] const View& view() const { return view_; }

  /// The most that one takes, whatever the view.
  static constexpr std::uint64_t most_memory_bytes = (most_rays + 1) * (most_rays + 1) * 2 * sizeof(double);

  /// Optical depth that closes a ray.
  static constexpr double closed = 7;

 private:
  struct Rays {
    int left, right, bottom, top;  // first and last column and row that pass through a cube's box on the screen
    double near;                   // least depth of the cube
    [[nodiscard]] bool empty() const { return right < left || top < bottom; }
  };
  [[nodiscard]] Rays rays_through(const Cube& cube, int margin) const;

  View view_;
  double spacing_;  // pixels
  int columns_, rows_;
  bool any_ = false;            // closed
  std::vector<double> depths_;  // [row][column]: optical, so far
  std::vector<double> closed_;  // [row][column]: view depth behind which nothing is seen; infinity: none
};

/// What was found for a view, with the pages of the index that told: it holds as long as the same of them are there.
struct KeptOcclusion {
  /// A page that was asked for.
  struct Link {
    std::size_t from;    // 0: the root page; i: that of links[i - 1]
    std::uint32_t node;  // of that page
    bool found;
  };

  ValueVisibility visibility;
  Occlusion occlusion;
  std::vector<Link> links;
  bool complete;  // all that were asked for were there
};

}  // namespace splatvol
