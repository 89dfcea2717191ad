// Values along a line between two places, and at one place over the steps of a series.
#pragma once

#include <atomic>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/steps.h"
#include "renderer/surfaces/surface.h"
#include "sampler/cell_line.h"
#include "scene/scene.h"
#include "streamer/cells/file_cells.h"

namespace splatvol {

/// A line through the cells of a step.
struct LineRequest {
  dvec3 start{0}, end{0};
  std::vector<std::string> attributes = {};
  std::size_t step = 0;

  [[nodiscard]] double length() const { return glm::length(end - start); }
  [[nodiscard]] bool operator==(const LineRequest&) const = default;
};

/// Returns why there are no values along a line; empty: there may be some. A line may be outside of all cells.
[[nodiscard]] std::string why_no_line(bool has_cells, const LineRequest& line);

/// Returns why there are no values over steps; empty: there may be some.
[[nodiscard]] std::string why_no_steps(bool has_cells, const std::vector<double>& times);

/// Reads the values along a line, as follow_line(). Holds up to 16 MiB of the file besides. Heeds an interruption.
/// Fails if the file keeps no cells, or has no such attribute.
[[nodiscard]] Result<LineRows> read_line(const format::Steps& steps, const LineRequest& line);

/// Reads the value of an attribute at a position in each step, as sample_cells(); NaN: none. Counts the steps that are
/// `done`. Heeds an interruption. Fails likewise.
[[nodiscard]] Result<std::vector<double>> read_steps(const format::Steps& steps, const std::string& attribute,
                                                     const dvec3& position, std::atomic<std::size_t>& done);

/// Returns how much of the light of each of some places reaches the eye of a view, [0, 1]: the volume, slices, contours
/// and surfaces in front of it take the rest. `scene`: of the view. 0 behind the eye. Heeds an interruption. Fails as
/// follow_line().
[[nodiscard]] Result<std::vector<double>> light_from(const KeptCells& cells, const Scene& scene,
                                                     std::span<const Surface> surfaces, const View& view,
                                                     std::span<const dvec3> places);

}  // namespace splatvol
