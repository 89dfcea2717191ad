#include "player/line_values.h"

#include <array>
#include <cstdint>
#include <optional>

#include "base/interruption.h"
#include "format/splat_reader.h"
#include "player/cell_ray.h"
#include "player/pick.h"
#include "sampler/cell_sampler.h"
#include "sampler/cell_tetrahedra.h"

namespace splatvol {
namespace {

constexpr std::uint64_t held_bytes = std::uint64_t{16} << 20;  // of parts of the file
constexpr const char* no_cells = "the file keeps no cells: build it from a mesh, without --drop-cells";

Result<std::unique_ptr<const CellTetrahedra>> open_cells(const format::Volume& volume,
                                                         const std::vector<std::string>& attributes) {
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(volume, {}, attributes, format::SplatSelection().box));
  SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(volume, selection.attributes, own_room(held_bytes)));
  if (!cells) return fail_without_cells(volume);
  return cells;
}

}  // namespace

std::string why_no_line(bool has_cells, const LineRequest& line) {
  if (!has_cells) return no_cells;
  if (!(line.length() > 0)) return "both ends are one place: a line has a length";
  return line.attributes.empty() ? "no attribute is chosen" : "";
}

std::string why_no_steps(bool has_cells, const std::vector<double>& times) {
  if (!has_cells) return no_cells;
  return times.size() < 2 ? "the file is no time series: it has one step" : "";
}

Result<LineRows> read_line(const format::Steps& steps, const LineRequest& line) {
  SPLATVOL_TRY_ASSIGN(volume, steps.volume(line.step));
  SPLATVOL_TRY_ASSIGN(cells, open_cells(*volume, line.attributes));
  return follow_line(*cells, line.start, line.end);
}

Result<std::vector<double>> read_steps(const format::Steps& steps, const std::string& attribute, const dvec3& position,
                                       std::atomic<std::size_t>& done) {
  std::vector<double> values;
  for (std::size_t step = 0; step < steps.times().size(); ++step) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(volume, steps.volume(step));
    SPLATVOL_TRY_ASSIGN(cells, open_cells(*volume, {attribute}));
    SPLATVOL_TRY_ASSIGN(value, sample_cells(*cells, std::array{position}));
    values.push_back(value.front());
    done = values.size();
  }
  return values;
}

Result<std::vector<double>> light_from(const KeptCells& cells, const Scene& scene, std::span<const Surface> surfaces,
                                       const View& view, std::span<const dvec3> places) {
  std::vector<double> lights;
  for (const dvec3& place : places) {
    const dvec3 at = view.to_view(place);
    lights.push_back(0);
    if (!(at.z > 0)) continue;
    const dvec3 eye = view.orthographic ? place - at.z * view.forward : view.eye;
    const Ray ray{eye, glm::normalize(place - eye)};
    ClipRegion in_front = view.clip;
    in_front.planes.push_back({place, -ray.direction});
    SPLATVOL_TRY_ASSIGN(on_ray, CellRay::follow(cells, scene, in_front, ray));
    lights.back() =
        light_from(ray, on_ray, on_ray.layers_of_contours(), scene, surfaces, in_front, glm::length(place - eye));
  }
  return lights;
}

}  // namespace splatvol
