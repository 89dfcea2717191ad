// The volume on a ray through the splats of a frame: for files without cells.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "player/pick.h"
#include "renderer/common.h"
#include "scene/scene.h"
#include "splat/record.h"

namespace splatvol {

/// Splats of a frame that rays can be followed through. Holds the frame's rows: they stay in memory.
class PickedSplats {
 public:
  /// Looks at all splats once, for balls round some hundred neighbours each. `sliced`: those near the view's slices.
  /// `units`: of the splats.
  PickedSplats(DrawList list, DrawList sliced, const DrawingUnits& units, std::string attribute);

  /// Follows a ray. Splats, boundary planes and the spread of values count as in the picture, besides what the
  /// rasterizers round; a splat of the kernel octant is a round Gaussian. Where octants are flat, the `opacity` of the
  /// picture tells how much all optical depths are to be scaled. The result refers to the splats.
  class OnRay;
  [[nodiscard]] OnRay follow(const Transfer& transfer, const Looking& looking,
                             std::optional<double> opacity = {}) const;

 private:
  // Consecutive splats of a range, and a ball that holds their material.
  struct Chunk {
    dvec3 center;
    double radius;  // world units
    std::uint32_t range, begin, count;
  };
  template <class Shape, class Reach>
  void add_chunks(std::uint32_t number, const std::vector<Shape>& shapes, const Reach& reach);

  DrawList list_, sliced_;
  DrawingUnits units_;
  std::string attribute_;
  std::vector<Chunk> chunks_;
};

/// Rows are equally far from each other, from the first splat to the last. A value is the mean of the splats there,
/// weighted by their densities.
class PickedSplats::OnRay final : public VolumeOnRay {
 public:
  [[nodiscard]] std::vector<Pick::Row> rows() const override { return rows_; }
  [[nodiscard]] double opacity_up_to(double distance) const override;
  [[nodiscard]] PickedValue value_at(double distance) const override;
  [[nodiscard]] PickedValue value_on(const Plane& slice, double distance) const override;

 private:
  friend class PickedSplats;
  OnRay(const PickedSplats& splats, const Looking& looking, std::vector<Pick::Row> rows)
      : splats_(splats), looking_(looking), rows_(std::move(rows)) {}

  const PickedSplats& splats_;
  Looking looking_;
  std::vector<Pick::Row> rows_;
};

/// Picks in a scene whose surfaces are there. Shells of `function` stand for contours. `opacity`: as in follow.
[[nodiscard]] std::optional<Pick> pick_splats(const PickedSplats& splats, const Scene& scene,
                                              const TransferFunction& function, std::span<const Surface> surfaces,
                                              const Looking& looking, std::optional<double> opacity = {});

}  // namespace splatvol
