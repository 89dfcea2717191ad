// The volume, contours and slices on a ray through the cells that a file keeps.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "player/pick.h"
#include "sampler/cell_line.h"
#include "scene/emission_absorption.h"
#include "scene/scene.h"
#include "streamer/cells/file_cells.h"

namespace splatvol {

/// The values along a ray, and how much light the volume takes: in double precision, by the rule of the exact picture.
/// Of cells that overlap, only one counts, as in follow_line().
class CellRay final : public VolumeOnRay {
 public:
  /// Follows a ray through the part of the cells that the clip region leaves. `cells`: with the scene's attributes.
  /// Fails as follow_line().
  [[nodiscard]] static Result<CellRay> follow(const KeptCells& cells, const Scene& scene, const ClipRegion& clip,
                                              const Ray& ray);

  [[nodiscard]] std::vector<Pick::Row> rows() const override;
  [[nodiscard]] double opacity_up_to(double distance) const override;
  [[nodiscard]] PickedValue value_at(double distance) const override;

  /// Returns the places where the value passes that of a contour which is drawn there.
  [[nodiscard]] std::vector<PickLayer> layers_of_contours() const;

 private:
  CellRay(const Scene& scene, LineRows rows, double start, double reach);
  void add_stretch(std::size_t row, double end, RayLight& light) const;

  std::string attribute_;
  Contours contours_;
  PiecewiseTransfer function_;
  std::optional<PiecewiseTransfer> opacity_;
  LineRows rows_;               // values: of the attribute, of the opacity's, and of that which colours contours
  double start_, reach_;        // distance of the first row; how far positions may be beside cells by rounding
  std::vector<double> depths_;  // [row]: optical depths up to it
};

/// Picks in a scene whose surfaces are there. Fails as CellRay::follow.
[[nodiscard]] Result<std::optional<Pick>> pick_cells(const KeptCells& cells, const Scene& scene,
                                                     std::span<const Surface> surfaces, const Ray& ray);

}  // namespace splatvol
